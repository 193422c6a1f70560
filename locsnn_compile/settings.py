"""How a network can be compiled: strategies, dials and their settings, and the grid to explore.

A strategy lays out spike response neurons on a chip; strategies are tried in the order given here.
To add a dial, write its row in :data:`DIALS`, which also says how ``auto`` and explore vary it, and
its field in :class:`Setting`, and read it in the pass that it turns. This module imports nothing
heavy, because help and completion show the names.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from typing import TYPE_CHECKING, Any

from locsnn_compile.errors import InputError, TargetError, check_known, check_range

NATIVE = "native"
"""The strategy of neurons that the chip has as they are: they need none."""
AUTO = "auto"
"""Stands for the cheapest strategy within the error budget."""
SPIKE_WORTH = 5.0
"""What ``auto`` pays for exact spikes: to lose another percent of them, a setting has to save this many percent.

At 5, the shipped networks keep half of the spike errors for 2.5 % more energy, and never trade them for the last
cycles of a core, while a strategy that saves a third may lose a few percent.
"""


@dataclass(frozen=True)
class Strategy:
    """``layout`` describes a neuron in compartments, ``dendrites`` how many it has of each kind.

    ``trainable``: networks can be trained on its integers. A ``last_resort`` costs more than any other, even with split
    weights: it is tried only if no other strategy keeps the budget, or if asked for.
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
TRAINABLE = tuple(name for name, strategy in STRATEGIES.items() if strategy.trainable)
USUAL = tuple(name for name, strategy in STRATEGIES.items() if not strategy.last_resort)
"""The strategies that are tried first."""


if TYPE_CHECKING:
    from hw_model.description.chip import Chip
    from locsnn_compile.network.network import Network

Value = str | int | float


@dataclass(frozen=True)
class Search:
    """How ``auto`` varies a dial, if at all.

    - ``starts``: values that it begins with, given a network and the value asked for; without it,
      the value asked for
    - ``last_resorts``: values of these that are tried only if no other keeps the error bounds
    - ``finer``: values that lose less and cost more, in turn, until one keeps the error bounds;
      they are not tried if the user gave a value
    - ``coarser``: given a chip and a value, the values that lose more and cost less, the nearest
      first; they are tried with the cheapest setting that keeps the error bounds
    """

    starts: Callable[[Network, Any], Sequence[Value]] | None = None
    last_resorts: Collection[Value] = ()
    finer: tuple[Value, ...] = ()
    coarser: Callable[[Chip, Any], Sequence[Value]] | None = None


@dataclass(frozen=True)
class Dial:
    """A setting of the compiler that ``auto`` and explore can vary: one row of :data:`DIALS`.

    ``name`` is its keyword in ``compile`` and its field in :class:`Setting`.

    For ``auto``: ``search``.

    For explore: ``values`` are tried for a network that has what the dial ``needs``, a property of
    ``Network``, and otherwise only the ``neutral`` one. With ``bounds``, other values between them
    can be asked for. Of a ``width``, only values that the chip's weights have are tried, and the
    neutral one is the widest of these. ``tried`` says in its help what is tried, ``words`` how the name of a setting
    shows a value, and ``unsaid`` is the value that the name leaves out.

    For ``locsnn-compile``: ``help``, ``value`` (what help calls its value), ``read``, ``choices``,
    ``bounds`` and ``default`` declare the option. ``usual`` is the value for a chip where none is
    given, by default the neutral one, and ``refuse`` raises an error for what the chip does not
    have. ``idle`` says why the dial would change nothing where a network lacks what it needs; if
    empty, the compiler itself finds out.
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
        """Tell whether the dial changes anything for a network."""
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
        """Return the values that explore tries if none are asked for."""
        if not self.width:
            return self.values if self.matters(network) else (self.neutral,)
        held = tuple(value for value in self.values if int(value) <= most_bits)
        return held if self.matters(network) else held[-1:]


def part(text: str) -> float:
    """Read a share of the weights: ``none``, ``all`` or a number."""
    named = {"none": 0.0, "all": 1.0}
    return named[text] if text in named else float(text)


def _widest(chip: Chip) -> Value:
    return chip.registers.weight_bits[-1]


def _strategies_of(network: Network, asked: str) -> Sequence[Value]:
    if not network.by_strategy:
        return [NATIVE]
    return list(STRATEGIES) if asked == AUTO else [asked]


def _narrower(chip: Chip, bits: int) -> Sequence[Value]:
    return [width for width in reversed(chip.registers.weight_bits) if width < bits]


def _check_strategy(chip: Chip, strategy: str) -> None:
    known = (AUTO, *STRATEGIES)
    check_known(f"strategy {strategy!r}", "unknown lowering strategy", strategy, known)


def weight_bits_of(chip: Chip, bits: int | None) -> int:
    """Return the weight bits asked for, or the chip's most; refuse a width that the chip's synapse formats lack."""
    from hw_model.arithmetic.fixed_point import weight_grid

    widths = chip.registers.weight_bits
    if bits is None:
        return widths[-1]
    try:
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
            starts=_strategies_of,
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
        values=(0.0, 0.5, 1.0),
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
        search=Search(finer=(0.0, 0.25, 1.0)),
    ),
)


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
        """Refuse values that no chip has (``InputError``), or not this one (``TargetError``)."""
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
        """Return the options of ``locsnn-compile`` that matter to a network."""
        arguments = []
        for dial, value in self.by_dial:
            if dial.matters(network):
                arguments += [dial.option, str(value)]
        return arguments

    def __str__(self) -> str:
        return self.name()

    def name(self, dials: Collection[int] | None = None) -> str:
        """Return the values of a setting in words, of the dials with these numbers or of all."""
        words = []
        for number, (dial, value) in enumerate(self.by_dial):
            is_named = dials is None or number in dials
            if is_named and value != dial.unsaid:
                words.append(dial.words(value))
        return ", ".join(words)


def check_dials(names: Collection[str], function: str) -> None:
    """Refuse a keyword that is the name of no dial as Python does: by a ``TypeError``."""
    known = {dial.name for dial in DIALS}
    for name in names:
        if name not in known:
            raise TypeError(f"{function}() got an unexpected keyword argument {name!r}")


def setting_for(chip: Chip, values: Mapping[str, Value | None]) -> Setting:
    """Return a setting of values by dial, checked; None, or no value, leaves a dial at the usual one.

    Raises ``InputError`` for values that no chip has, and ``TargetError`` for those that this one
    has not.
    """
    chosen: dict[str, Any] = {}
    for dial in DIALS:
        value = values.get(dial.name)
        chosen[dial.name] = dial.usual_of(chip) if value is None else value
    setting = Setting(**chosen)
    setting.check(chip)
    return setting


def settings(
    network: Network, wanted: Mapping[str, Sequence[Value]], most_bits: int
) -> tuple[Setting, ...]:
    """Return the grid, the last dial fastest: of each dial the values wanted, by its name, or else all that matter.

    The chip's widest weights have ``most_bits``; wider ones are tried only if asked for.

    Raises ``InputError`` for options of rounding if no weights are rounded.
    """
    idle = [dial for dial in DIALS if dial.idle and wanted.get(dial.name)]
    check_matters(network, {dial.name: dial.option for dial in idle})
    tried = [
        tuple(dict.fromkeys(wanted.get(dial.name) or dial.explored(network, most_bits)))
        for dial in DIALS
    ]
    return tuple(itertools.starmap(Setting, itertools.product(*tried)))


def usual_settings(network: Network, most_bits: int) -> tuple[Setting, ...]:
    """Return what ``auto`` tries if no bound is given: each strategy, with defaults for everything else."""
    strategies = DIALS[0].explored(network, most_bits)
    return tuple(Setting(str(strategy), most_bits) for strategy in strategies)


def first_settings(network: Network, asked: Setting) -> list[Setting]:
    """Return the settings that ``auto`` begins with, by the :class:`Search` of each dial."""
    tried = [
        (value,) if dial.search.starts is None else dial.search.starts(network, value)
        for dial, value in asked.by_dial
    ]
    return [type(asked)(*values) for values in itertools.product(*tried)]


_OTHER_OPTIONS = (
    ("calibration", "by_strategy", "no weights of this model are rounded for recordings"),
    (
        "psi",
        "has_both_axes",
        "this model has one branch, and predictions have nothing to turn to",
    ),
)
"""Options that are no dials: their name, what a network needs for them, and why they would be idle."""


def check_matters(network: Network, given: Mapping[str, str]) -> None:
    """Refuse options that would change nothing for this network; ``given`` has those given, as messages show them."""
    rows = [(dial.name, dial.needs, dial.idle) for dial in DIALS if dial.idle]
    for name, needs, why in (*rows, *_OTHER_OPTIONS):
        if name in given and not getattr(network, needs):
            raise InputError(given[name], f"it would change nothing: {why}", fix="Leave it out.")
