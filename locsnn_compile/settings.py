"""How a network can be compiled: strategies, settings, the axes they lie on, and the grid of those that are explored.

A strategy lays out spike response neurons on a chip; they stand in the order in which they are tried. Nothing here
imports anything heavy, so that help and completion can say the names.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any

from locsnn_compile.errors import InputError, did_you_mean

NATIVE = "native"
"""What neurons are that the chip has as they are: they need no strategy."""
AUTO = "auto"
"""The cheapest strategy that loses no more than it may."""


@dataclass(frozen=True)
class Strategy:
    """``layout``: a neuron in compartments, in words; it has so many ``dendrites`` of each kind.

    ``trainable``: networks can be trained on its integers. A ``last_resort`` costs more than any other, with split
    weights or without: it is tried where no other keeps a budget, or where it is asked for.
    """

    layout: str
    dendrites: int = 1
    trainable: bool = True
    last_resort: bool = False


STRATEGIES = {
    "dendrite": Strategy("three joined compartments per neuron: alpha dendrite, refractory dendrite, memoryless soma"),
    "delay-line": Strategy("two joined compartments per neuron, the refractory kernel through delayed self-synapses"),
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
"""Those that are tried first."""


if TYPE_CHECKING:
    from locsnn_compile.network.network import Network

Value = str | int | float


def has_srm_neurons(network: Network) -> bool:
    """Tell whether some neurons are float SRM neurons, which a strategy lays out."""
    return network.by_strategy


def has_float_weights(network: Network) -> bool:
    """Tell whether some weights are to be rounded: on-grid ones are kept as they are."""
    return any(not population.on_grid for population in network.populations)


def has_both_axes(network: Network) -> bool:
    """Tell whether there is a time branch and a location branch, which predictions weigh by time."""
    return len({population.axis for population in network.populations}) == 2


@dataclass(frozen=True)
class Axis:
    """One option of the compiler: ``name`` is its keyword in ``compile``, and its option with dashes for underscores.

    ``values`` are tried where the option ``matters`` to a network; elsewhere there is only the ``neutral`` one. Others
    can be asked for between ``bounds``, where these are given.
    """

    name: str
    values: tuple[Value, ...]
    neutral: Value
    matters: Callable[[Network], bool]
    help: str
    text: str = "{}"
    """How a value reads in the name of a setting."""
    unsaid: Value | None = None
    """A value that the name of a setting leaves out."""
    bounds: tuple[float, float] | None = None

    @property
    def option(self) -> str:
        """The option of the command lines."""
        return f"--{self.name.replace('_', '-')}"

    def check(self, value: Value) -> None:
        """Refuse a value that is not on this axis."""
        if isinstance(value, str):
            fits, fix = value in self.values, did_you_mean(value, map(str, self.values))
        elif self.bounds is None:
            fits, fix = value in self.values, f"Choose from {', '.join(map(str, self.values))}."
        else:
            least, most = self.bounds
            fits, fix = least <= value <= most, f"Give a number from {least:g} to {most:g}."
        if not fits:
            raise InputError(f"{self.option} {value}", "it cannot be explored", fix=fix)


AXES = (
    Axis("strategy", tuple(STRATEGIES), AUTO, has_srm_neurons, "lowerings of SRM neurons"),
    Axis("weight_bits", (1, 2, 3, 4, 5, 6, 8), 8, has_float_weights, "bits of a weight", "{}-bit"),
    Axis(
        "split_weights",
        (0.0, 0.5, 1.0),
        0.0,
        has_float_weights,
        "shares of the weights that get a second synapse",
        "{:.0%} split",
        unsaid=0.0,
        bounds=(0.0, 1.0),
    ),
)


@dataclass(frozen=True)
class Setting:
    """How a network is compiled: keyword arguments of ``compile``, one of each axis, in the order of :data:`AXES`."""

    strategy: str
    weight_bits: int
    split_weights: float = 0.0

    @property
    def values(self) -> tuple[Any, ...]:
        """The values in the order of the axes."""
        return astuple(self)

    def arguments(self, network: Network) -> list[str]:
        """Return the options of ``locsnn-compile`` that matter to a network."""
        rows = [(axis, value) for axis, value in zip(AXES, self.values, strict=True) if axis.matters(network)]
        return [text for axis, value in rows for text in (axis.option, str(value))]

    def __str__(self) -> str:
        return self.name()

    def name(self, axes: Collection[int] | None = None) -> str:
        """Return what tells a setting from others, by the axes of these numbers or by all."""
        rows = [(i, axis, value) for i, (axis, value) in enumerate(zip(AXES, self.values, strict=True))]
        return ", ".join(
            axis.text.format(value) for i, axis, value in rows if (axes is None or i in axes) and value != axis.unsaid
        )


def settings(network: Network, wanted: Mapping[str, Sequence[Value]], most_bits: int) -> tuple[Setting, ...]:
    """Return the grid, the last axis fastest: on each axis the values wanted, by its name, else all that matter.

    The chip's widest weights have ``most_bits``; wider ones are tried only where they are asked for.

    Raises ``InputError`` for values of weights that are not rounded.
    """
    of_weights = [axis for axis in AXES if axis.matters is has_float_weights and wanted.get(axis.name)]
    check_matters(network, {axis.name: axis.option for axis in of_weights})
    tried = [tuple(dict.fromkeys(wanted.get(axis.name) or _default(axis, network, most_bits))) for axis in AXES]
    return tuple(itertools.starmap(Setting, itertools.product(*tried)))


def usual_settings(network: Network, most_bits: int) -> tuple[Setting, ...]:
    """Return what ``auto`` tries where no bound is given: each strategy, all else as it is by default."""
    return tuple(Setting(str(strategy), most_bits) for strategy in _default(AXES[0], network, most_bits))


def check_matters(network: Network, given: Mapping[str, str]) -> None:
    """Refuse options that would change nothing for this network; ``given``: how messages show each that was given."""
    for name, matters, why in (
        ("weight_bits", has_float_weights, "the weights of this model are integers of the chip already"),
        ("split_weights", has_float_weights, "the weights of this model are integers of the chip already"),
        ("calibration", has_srm_neurons, "no weights of this model are rounded for recordings"),
        ("psi", has_both_axes, "this model has one branch, and predictions have nothing to turn to"),
    ):
        if name in given and not matters(network):
            raise InputError(given[name], f"it would change nothing: {why}", fix="Leave it out.")


def check_values(wanted: Mapping[str, Sequence[Value]]) -> None:
    """Refuse values that no axis has."""
    for axis in AXES:
        for value in wanted.get(axis.name, ()):
            axis.check(value)


def _default(axis: Axis, network: Network, most_bits: int) -> tuple[Value, ...]:
    if axis.name == "weight_bits":
        held = tuple(value for value in axis.values if int(value) <= most_bits)
        return held if axis.matters(network) else held[-1:]
    return axis.values if axis.matters(network) else (axis.neutral,)
