"""How a network can be compiled: strategies, dials and their settings, and the grid to explore.

A *dial* is a choice of the compiler for which there are several values, such as the weight bits. A
*setting* is one value for each dial. ``locsnn-compile`` takes a setting from its options, ``auto``
searches for one within error bounds, and ``locsnn explore`` compares a whole grid of them. *Error
bounds*, or the error budget, limit how much the program may differ from the network (:class:`ErrorBudget`
of ``verification/error_bounds.py``); the ``bounds`` of a dial are the ends of its range of values.

The first dial is the *strategy*: how spike response (SRM) neurons become compartments of a chip.
Strategies are tried in the order given here.

To add a dial, write its row in :data:`DIALS`, which also says how ``auto`` and explore vary it, and
its field in :class:`Setting`, and read it in the pass that it changes. This module imports nothing
heavy, because help and completion show the names.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import TYPE_CHECKING, Any

from locsnn_compile.errors import InputError, TargetError, check_known, check_range

NATIVE = "native"
"""The strategy that a setting has for neurons that the chip has as they are. It is no choice of a user."""
AUTO = "auto"
"""Stands for the cheapest strategy within the error budget. Settings that are compiled have a strategy in its place, or
``NATIVE`` if the network has no neurons to lay out."""
SPIKE_WORTH = 5.0
"""What ``auto`` pays for exact spikes if no error bounds are given: a setting that loses another percent of the spikes
has to save this many percent of the cost.

Chosen by hand on the shipped networks. At 5, ``auto`` pays 2.5 % more energy for a setting with half the spike errors,
and gives up no spikes to save the last cycles of an open core. But it takes a strategy that saves a third of the cost
and loses a few percent of the spikes.
"""


@dataclass(frozen=True)
class Strategy:
    """A way to lay out a spike response neuron in compartments.

    - ``layout``: the compartments of a neuron, in words for the report
    - ``dendrites``: how many dendrites a neuron has of each kind
    - ``trainable``: networks can be trained on its integers
    - ``last_resort``: it costs more than any other, even with split weights, so that it is tried only if no other
      strategy keeps the budget, or if asked for
    """

    layout: str
    dendrites: int = 1
    trainable: bool = True
    last_resort: bool = False


STRATEGIES = {
    "dendrite": Strategy(
        "three joined compartments per neuron: alpha dendrite, refractory dendrite, memoryless soma"
    ),
    "delay-line": Strategy(
        "two joined compartments per neuron, the refractory kernel through delayed self-synapses"
    ),
    "reset": Strategy("one compartment per neuron with the chip's own reset, an approximation"),
    "paired-dendrite": Strategy(
        "five joined compartments per neuron: dendrite with two dendrites of each kind, at a finer scale",
        dendrites=2,
        trainable=False,
        last_resort=True,
    ),
}
LAYOUTS = {name: strategy.layout for name, strategy in STRATEGIES.items()} | {
    NATIVE: "one compartment per neuron, as the model has it"
}
"""The compartments of a neuron in words, by strategy."""
TRAINABLE = tuple(name for name, strategy in STRATEGIES.items() if strategy.trainable)
"""The strategies that ``locsnn train --target`` takes."""
USUAL = tuple(name for name, strategy in STRATEGIES.items() if not strategy.last_resort)
"""The strategies that are tried first."""


if TYPE_CHECKING:
    from hw_model.description.chip import Chip
    from locsnn_compile.network.network import Network

Value = str | int | float


@dataclass(frozen=True)
class Search:
    """How ``auto`` varies a dial, if at all.

    - ``starts``: returns the values to begin with, given a network and the value asked for; None to
      begin with the value asked for
    - ``last_resorts``: those of the first values that are tried only if no other keeps the error
      bounds
    - ``finer``: values that lose less and cost more, tried in turn until one keeps the error bounds;
      they are not tried if the user gave a value
    - ``coarser``: returns, given a chip and a value, the values that lose more and cost less, the
      nearest first; they are tried with the cheapest setting that keeps the error bounds
    """

    starts: Callable[[Network, Any], Sequence[Value]] | None = None
    last_resorts: Collection[Value] = ()
    finer: tuple[Value, ...] = ()
    coarser: Callable[[Chip, Any], Sequence[Value]] | None = None


@dataclass(frozen=True)
class Dial:
    """A choice of the compiler that ``auto`` and explore can vary: one row of :data:`DIALS`.

    ``name`` is its keyword in ``compile`` and its field in :class:`Setting`. ``search`` says how
    ``auto`` varies it.

    For explore:

    - ``values``: tried for a network that has what the dial needs
    - ``needs``: the name of the property of ``Network`` without which the dial changes nothing
    - ``neutral``: the only value that is tried for a network without that property, such as ``auto`` for
      the strategy, which then becomes ``NATIVE``
    - ``bounds``: the least and the largest value that a user may ask for; by default, a user may ask for
      ``values`` only
    - ``width``: values are widths of weights: only those that the chip has are tried, and the neutral
      one is the widest of these
    - ``tried``: says in the help what is tried
    - ``words``: returns a value as the name of a setting shows it
    - ``unsaid``: the value that the name of a setting leaves out

    For ``locsnn-compile``:

    - ``help``, ``choices``, ``bounds``, ``default``: of the option
    - ``value``: what the help calls its value
    - ``read``: parses the text of a value
    - ``usual``: returns the value for a chip if none is given; by default it is the neutral one
    - ``refuse``: raises an error for a value that the chip does not have
    - ``idle``: why the dial would change nothing for a network without what it needs; if empty, the
      compiler itself finds out
    """

    name: str
    values: tuple[Value, ...]
    neutral: Value
    needs: str
    tried: str
    help: str
    value: str
    read: Callable[[str], Value]
    choices: tuple[str, ...] = ()
    default: Value | None = None
    words: Callable[[Any], str] = str
    unsaid: Value | None = None
    bounds: tuple[float, float] | None = None
    usual: Callable[[Chip], Value] | None = None
    refuse: Callable[[Chip, Any], None] | None = None
    idle: str = ""
    width: bool = False
    search: Search = Search()

    @property
    def option(self) -> str:
        """The option of the command lines."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def taken_key(self) -> str:
        """The key in ``strategy_choice`` of a report for the value that was taken."""
        return "taken" if self.name == "strategy" else f"taken_{self.name}"

    def matters(self, network: Network) -> bool:
        """Return whether the dial changes anything for a network."""
        return bool(getattr(network, self.needs))

    def check(self, chip: Chip, value: Any) -> None:
        """Refuse a value out of bounds, or one that the chip does not have."""
        if self.bounds is not None:
            check_range(value, *self.bounds, self.name)
        if self.refuse is not None:
            self.refuse(chip, value)

    def usual_of(self, chip: Chip) -> Value:
        """Return the value for a chip where none is given."""
        return self.neutral if self.usual is None else self.usual(chip)

    def explored(self, network: Network, most_bits: int) -> tuple[Value, ...]:
        """Return the values that explore tries if none are asked for.

        ``most_bits`` is the width of the chip's widest weights.
        """
        if not self.width:
            return self.values if self.matters(network) else (self.neutral,)
        widths = tuple(value for value in self.values if int(value) <= most_bits)
        return widths if self.matters(network) else widths[-1:]


def part(text: str) -> float:
    """Parse a share of the weights: ``none``, ``all`` or a number.

    argparse shows the name of this function if the text is none of these: "invalid part value".
    """
    share_of_word = {"none": 0.0, "all": 1.0}
    return share_of_word[text] if text in share_of_word else float(text)


def _widest(chip: Chip) -> Value:
    """Return the bits of the chip's widest weights."""
    return chip.registers.weight_bits[-1]


def _first_strategies(network: Network, asked: str) -> Sequence[Value]:
    """Return the strategies that ``auto`` begins with; neurons that the chip has need none."""
    if not network.by_strategy:
        return [NATIVE]
    return list(STRATEGIES) if asked == AUTO else [asked]


def _narrower(chip: Chip, bits: int) -> Sequence[Value]:
    """Return the chip's narrower widths of weights, the widest first."""
    return [width for width in reversed(chip.registers.weight_bits) if width < bits]


def _check_strategy(chip: Chip, strategy: str) -> None:
    """Refuse an unknown strategy. ``chip`` is not needed: every ``Dial.refuse`` takes one."""
    known = (AUTO, *STRATEGIES)
    check_known(f"strategy {strategy!r}", "unknown lowering strategy", strategy, known)


def weight_bits_of(chip: Chip, bits: int | None) -> int:
    """Return the weight bits asked for, or the chip's widest if ``bits`` is None.

    Raises ``InputError`` for a width that no synapse format has, and ``TargetError`` for one that is
    too wide for the chip.
    """
    from hw_model.arithmetic.fixed_point import weight_grid

    widths = chip.registers.weight_bits
    if bits is None:
        return widths[-1]
    try:
        # Raises for a width that has no grid, such as 7. All signs of weights have the same widths.
        weight_grid(bits, "excitatory")
    except InputError as error:
        raise InputError("--weight-bits", error.what, fix=error.fix) from None
    if bits not in widths:
        measured = f"{chip.name} has weight_bits_max {chip.registers.weight_bits_max}"
        fix = f"Ask for {widths[-1]}, or leave it out."
        raise TargetError(
            "--weight-bits", f"weights of {bits} bits are too wide", measured=measured, fix=fix
        )
    return bits


def _check_weight_bits(chip: Chip, bits: int) -> None:
    weight_bits_of(chip, bits)


_INTEGERS = "the weights of this model are integers of the chip already"
"""Why dials of rounding change nothing for some networks."""
DIALS = (
    Dial(
        "strategy",
        values=tuple(STRATEGIES),
        neutral=AUTO,
        needs="by_strategy",
        tried="lowerings of SRM neurons",
        help=f"lowering of SRM neurons: {', '.join(STRATEGIES)}, or auto (default): "
        "the cheapest that keeps the bounds",
        value="NAME",
        read=str,
        choices=(AUTO, *STRATEGIES),
        default=AUTO,
        refuse=_check_strategy,
        search=Search(
            starts=_first_strategies,
            last_resorts=[name for name, strategy in STRATEGIES.items() if strategy.last_resort],
        ),
    ),
    Dial(
        "weight_bits",
        values=(1, 2, 3, 4, 5, 6, 8),
        neutral=8,
        needs="has_float_weights",
        tried="bits of a weight",
        help="1 to 6, or 8 (default: the chip's widest); with error bounds, the widest to try",
        value="BITS",
        read=int,
        words="{}-bit".format,
        usual=_widest,
        refuse=_check_weight_bits,
        idle=_INTEGERS,
        width=True,
        search=Search(coarser=_narrower),
    ),
    Dial(
        "split_weights",
        values=(0.0, 0.5, 1.0),  # chosen by hand: explore shows the whole range
        neutral=0.0,
        needs="has_float_weights",
        tried="shares of the weights that get a second synapse",
        help="weights that get a second synapse: none, all, or a share 0..1 "
        "(default: none, or what the bounds need)",
        value="SHARE",
        read=part,
        words=lambda share: f"{100 * share:.6g}% split",
        unsaid=0.0,
        bounds=(0, 1),
        idle=_INTEGERS,
        # Chosen by hand: a share that costs little is tried before all weights.
        search=Search(finer=(0.0, 0.25, 1.0)),
    ),
)
"""The dials. A setting has its values, and explore varies them, in this order."""


@dataclass(frozen=True)
class Setting:
    """How a network is compiled: a field for each dial, in the order of :data:`DIALS`."""

    strategy: str
    weight_bits: int
    split_weights: float = 0.0

    @property
    def values(self) -> tuple[Any, ...]:
        """The values in the order of the dials."""
        return astuple(self)

    @property
    def by_dial(self) -> list[tuple[Dial, Any]]:
        """Each dial with its value."""
        return list(zip(DIALS, self.values, strict=True))

    def check(self, chip: Chip) -> None:
        """Refuse values that no chip has (``InputError``), or that this chip does not have (``TargetError``)."""
        for dial, value in self.by_dial:
            dial.check(chip, value)

    @property
    def is_last_resort(self) -> bool:
        """Whether ``auto`` tries it only if no other setting keeps the error bounds."""
        return any(value in dial.search.last_resorts for dial, value in self.by_dial)

    def with_value(self, dial: Dial, value: Value) -> Setting:
        """Return the setting with another value of a dial."""
        changed: dict[str, Any] = {dial.name: value}
        return replace(self, **changed)

    def arguments(self, network: Network) -> list[str]:
        """Return the options of ``locsnn-compile`` for this setting, only for dials that matter to a network."""
        arguments = []
        for dial, value in self.by_dial:
            if dial.matters(network):
                arguments += [dial.option, str(value)]
        return arguments

    def __str__(self) -> str:
        return self.name()

    def name(self, dials: Collection[int] | None = None) -> str:
        """Return the values of the setting in words, such as ``dendrite, 8-bit``.

        ``dials`` are the numbers of the dials to name, by default all.
        """
        words = []
        for number, (dial, value) in enumerate(self.by_dial):
            is_named = dials is None or number in dials
            if is_named and value != dial.unsaid:
                words.append(dial.words(value))
        return ", ".join(words)


def check_dials(names: Collection[str], function: str) -> None:
    """Refuse a keyword that is not the name of a dial as Python would: by a ``TypeError``."""
    known = {dial.name for dial in DIALS}
    for name in names:
        if name not in known:
            raise TypeError(f"{function}() got an unexpected keyword argument {name!r}")


def setting_for(chip: Chip, values: Mapping[str, Value | None]) -> Setting:
    """Return the setting for ``values`` by dial, for a chip with a mesh of cores, such as Loihi, or an open core.

    Chips with an arithmetic of their own, such as Xylo, have a single setting. A dial without a value, or
    with None, has the value that is usual for the chip. Raises ``InputError`` for values that no chip has,
    and ``TargetError`` for values that this chip does not have.
    """
    chosen: dict[str, Any] = {}
    for dial in DIALS:
        value = values.get(dial.name)
        chosen[dial.name] = dial.usual_of(chip) if value is None else value
    setting = Setting(**chosen)
    setting.check(chip)
    return setting


def settings(
    network: Network, values_to_try: Mapping[str, Sequence[Value]], most_bits: int
) -> tuple[Setting, ...]:
    """Return the grid of explore: every combination of the values of the dials, the last dial varying fastest.

    ``values_to_try`` has, by dial, the values that the user gave. Of the other dials, all values that matter to the
    network are tried. The chip's widest weights have ``most_bits``; wider ones are tried only if asked for.

    Raises ``InputError`` for options of rounding if no weights are rounded.
    """
    may_be_idle = [dial for dial in DIALS if dial.idle and values_to_try.get(dial.name)]
    check_matters(network, {dial.name: dial.option for dial in may_be_idle})
    values_by_dial: list[tuple[Any, ...]] = []
    for dial in DIALS:
        values = values_to_try.get(dial.name) or dial.explored(network, most_bits)
        values_by_dial.append(tuple(dict.fromkeys(values)))  # without repeats, in order
    return tuple(itertools.starmap(Setting, itertools.product(*values_by_dial)))


def usual_settings(network: Network, most_bits: int) -> tuple[Setting, ...]:
    """Return the settings that ``auto`` tries without bounds: each strategy, and usual values otherwise."""
    strategy_dial = DIALS[0]
    strategies = strategy_dial.explored(network, most_bits)
    return tuple(Setting(str(strategy), most_bits) for strategy in strategies)


def first_settings(network: Network, asked: Setting) -> list[Setting]:
    """Return the settings that ``auto`` begins with, by the :class:`Search` of each dial."""
    first_values: list[Sequence[Any]] = []
    for dial, value in asked.by_dial:
        starts = dial.search.starts
        first_values.append((value,) if starts is None else starts(network, value))
    # Of the type of ``asked``: if :data:`DIALS` has further rows, as in tests, the settings are of a subclass of
    # ``Setting`` that has their fields.
    return [type(asked)(*values) for values in itertools.product(*first_values)]


_OTHER_OPTIONS = (
    ("calibration", "by_strategy", "no weights of this model are rounded for recordings"),
    (
        "psi",
        "has_both_axes",
        "this model has one branch, and predictions have nothing to turn to",
    ),
)
"""Options that are not dials: name, the property that a network needs for them, and why they change nothing without.

``psi`` says how steeply the time-weighted prediction turns, during a recording, from the time branch to the location
branch, so it needs both.
"""


def check_matters(network: Network, given: Mapping[str, str]) -> None:
    """Refuse options that would change nothing for this network.

    ``given`` has, by their names, the options that the user gave, as messages show them.
    """
    dial_rows = [(dial.name, dial.needs, dial.idle) for dial in DIALS if dial.idle]
    for name, needs, reason in (*dial_rows, *_OTHER_OPTIONS):
        if name in given and not getattr(network, needs):
            raise InputError(given[name], f"it would change nothing: {reason}", fix="Leave it out.")
