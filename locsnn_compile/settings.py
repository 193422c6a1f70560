"""How a network can be compiled: strategies, settings, their axes, and the grid of settings to explore.

A strategy lays out spike response neurons on a chip; strategies are tried in the order given here. This module imports
nothing heavy, because help and completion show the names.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import astuple, dataclass
from typing import TYPE_CHECKING, Any

from locsnn_compile.errors import InputError

NATIVE = "native"
"""The strategy of neurons that the chip has as they are: they need none."""
AUTO = "auto"
"""Stands for the cheapest strategy within the error budget."""


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
    from locsnn_compile.network.network import Network

Value = str | int | float


@dataclass(frozen=True)
class Axis:
    """One option of the compiler; ``name`` is its keyword in ``compile``.

    ``values`` are tried for a network that has what the option ``needs``, a property of ``Network``, and otherwise only
    the ``neutral`` one. With ``bounds``, other values between them can be asked for.
    """

    name: str
    values: tuple[Value, ...]
    neutral: Value
    needs: str
    help: str
    words: Callable[[Any], str] = str
    """How the name of a setting shows a value."""
    unsaid: Value | None = None
    """The value that the name of a setting leaves out."""
    bounds: tuple[float, float] | None = None

    @property
    def option(self) -> str:
        """The option of the command lines."""
        return f"--{self.name.replace('_', '-')}"

    @property
    def kind(self) -> str:
        """What its values are, in the words of ``cli/options.txt``."""
        limits = "one of " + "|".join(map(str, self.values))
        if self.bounds is not None:
            limits = "a number from {:g} to {:g}".format(*self.bounds)
        return f"{type(self.values[0]).__name__}, {limits}"

    def matters(self, network: Network) -> bool:
        """Tell whether the option changes anything for a network."""
        return bool(getattr(network, self.needs))


AXES = (
    Axis("strategy", tuple(STRATEGIES), AUTO, "by_strategy", "lowerings of SRM neurons"),
    Axis(
        "weight_bits",
        (1, 2, 3, 4, 5, 6, 8),
        8,
        "has_float_weights",
        "bits of a weight",
        "{}-bit".format,
    ),
    Axis(
        "split_weights",
        (0.0, 0.5, 1.0),
        0.0,
        "has_float_weights",
        "shares of the weights that get a second synapse",
        lambda share: f"{100 * share:.6g}% split",
        unsaid=0.0,
        bounds=(0.0, 1.0),
    ),
)


@dataclass(frozen=True)
class Setting:
    """How a network is compiled: keyword arguments of ``compile``, one per axis, in the order of :data:`AXES`."""

    strategy: str
    weight_bits: int
    split_weights: float = 0.0

    @property
    def values(self) -> tuple[Any, ...]:
        """The values in the order of the axes."""
        return astuple(self)

    def arguments(self, network: Network) -> list[str]:
        """Return the options of ``locsnn-compile`` that matter to a network."""
        rows = [
            (axis, value)
            for axis, value in zip(AXES, self.values, strict=True)
            if axis.matters(network)
        ]
        return [text for axis, value in rows for text in (axis.option, str(value))]

    def __str__(self) -> str:
        return self.name()

    def name(self, axes: Collection[int] | None = None) -> str:
        """Return the values of a setting in words, on the axes with these numbers or on all."""
        rows = [
            (i, axis, value) for i, (axis, value) in enumerate(zip(AXES, self.values, strict=True))
        ]
        return ", ".join(
            axis.words(value)
            for i, axis, value in rows
            if (axes is None or i in axes) and value != axis.unsaid
        )


def settings(
    network: Network, wanted: Mapping[str, Sequence[Value]], most_bits: int
) -> tuple[Setting, ...]:
    """Return the grid, the last axis fastest: on each axis the values wanted, by its name, or else all that matter.

    The chip's widest weights have ``most_bits``; wider ones are tried only if asked for.

    Raises ``InputError`` for options of rounding if no weights are rounded.
    """
    of_weights = [
        axis for axis in AXES if axis.needs == "has_float_weights" and wanted.get(axis.name)
    ]
    check_matters(network, {axis.name: axis.option for axis in of_weights})
    tried = [
        tuple(dict.fromkeys(wanted.get(axis.name) or _default(axis, network, most_bits)))
        for axis in AXES
    ]
    return tuple(itertools.starmap(Setting, itertools.product(*tried)))


def usual_settings(network: Network, most_bits: int) -> tuple[Setting, ...]:
    """Return what ``auto`` tries if no bound is given: each strategy, with defaults for everything else."""
    return tuple(
        Setting(str(strategy), most_bits) for strategy in _default(AXES[0], network, most_bits)
    )


def check_matters(network: Network, given: Mapping[str, str]) -> None:
    """Refuse options that would change nothing for this network; ``given`` has those given, as messages show them."""
    for name, needs, why in (
        (
            "weight_bits",
            "has_float_weights",
            "the weights of this model are integers of the chip already",
        ),
        (
            "split_weights",
            "has_float_weights",
            "the weights of this model are integers of the chip already",
        ),
        ("calibration", "by_strategy", "no weights of this model are rounded for recordings"),
        (
            "psi",
            "has_both_axes",
            "this model has one branch, and predictions have nothing to turn to",
        ),
    ):
        if name in given and not getattr(network, needs):
            raise InputError(given[name], f"it would change nothing: {why}", fix="Leave it out.")


def _default(axis: Axis, network: Network, most_bits: int) -> tuple[Value, ...]:
    if axis.name == "weight_bits":
        held = tuple(value for value in axis.values if int(value) <= most_bits)
        return held if axis.matters(network) else held[-1:]
    return axis.values if axis.matters(network) else (axis.neutral,)
