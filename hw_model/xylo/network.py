"""A network as Xylo stores it, checked against the chip's number formats and limits.

A Xylo has input lines, one population of hidden neurons, which can be connected among themselves, and output neurons.
A *dash* is a decay as the chip stores it: in a step, a register loses itself shifted right by the dash.
"""

import itertools

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.errors import InputError, TargetError
from hw_model.values import AnyArray, Frozen, IntArray, Shown
from hw_model.xylo.chips import XyloChip


class XyloPopulation(Frozen, eq=False):
    """The parameters of n neurons with k synaptic currents each.

    ``dash_syn`` (n, k) is the decay of each current, ``dash_mem`` (n,) that of the potential; ``threshold`` and
    ``bias`` are (n,). ``bias`` is None if the chip's biases are off.
    """

    dash_syn: IntArray
    dash_mem: IntArray
    threshold: IntArray
    bias: IntArray | None = None

    @property
    def size(self) -> int:
        """The number of neurons."""
        return len(self.threshold)

    @property
    def states(self) -> int:
        """The number of currents per neuron."""
        return int(self.dash_syn.shape[1])

    @property
    def parameters(self) -> xylo.Parameters:
        """The parameters for the arithmetic."""
        return xylo.Parameters(self.dash_syn, self.dash_mem, self.threshold, self.bias)


class XyloNetwork(Shown):
    """Input lines, one hidden population with synapses among itself, and outputs.

    Weights are integers of 8 bits, with the source first: ``weights_in`` (inputs, hidden, k), ``weights_hidden``
    (hidden, hidden, k), ``weights_out`` (hidden, outputs). A spike adds ``weight << shift`` to a current, where each of
    the three arrays has a shift for all of its weights. ``aliases[n]`` are the hidden neurons that repeat the spikes of
    neuron n in addition to their own; :mod:`hw_model.arithmetic.xylo` says in which order. ``aliases`` is None if there
    are none.
    """

    hidden: XyloPopulation
    outputs: XyloPopulation
    weights_in: IntArray
    weights_hidden: IntArray
    weights_out: IntArray
    shift_in: int = 0
    shift_hidden: int = 0
    shift_out: int = 0
    aliases: tuple[tuple[int, ...], ...] | None = None

    def __post_init__(self) -> None:
        inputs = len(self.weights_in)
        hidden = self.hidden.size
        outputs = self.outputs.size
        states = self.hidden.states
        _check_shape("weights_in", self.weights_in, (inputs, hidden, states))
        _check_shape("weights_hidden", self.weights_hidden, (hidden, hidden, states))
        _check_shape("weights_out", self.weights_out, (hidden, outputs))
        _check_shape("outputs.dash_syn", self.outputs.dash_syn, (outputs, 1))
        for name in ("weights_in", "weights_hidden", "weights_out"):
            _check_range(name, getattr(self, name), xylo.WEIGHT_MIN, xylo.WEIGHT_MAX)
        for name in ("shift_in", "shift_hidden", "shift_out"):
            # The chip stores a shift in 4 bits.
            _check_range(name, np.array(getattr(self, name)), low=0, high=15)
        for name, population in (("hidden", self.hidden), ("outputs", self.outputs)):
            _check_population(name, population)
        if (self.hidden.bias is None) != (self.outputs.bias is None):
            fix = "Give both populations biases, or neither."
            raise InputError("biases", "the chip has them on or off for all neurons", fix=fix)
        self._check_aliases()

    def _check_aliases(self) -> None:
        """Raise InputError unless every hidden neuron has a tuple of aliases, which are hidden neurons."""
        if self.aliases is None:
            return
        size = self.hidden.size
        all_aliases = itertools.chain.from_iterable(self.aliases)
        if len(self.aliases) != size or any(not 0 <= alias < size for alias in all_aliases):
            fix = f"Give each of the {size} hidden neurons a tuple of numbers 0..{size - 1}."
            raise InputError("aliases", "they do not fit the hidden neurons", fix=fix)

    def check_fits(self, chip: XyloChip) -> None:
        """Raise ``TargetError``, which names the limit, if the network is too large for the chip."""
        for what, count, limit in (
            ("inputs", len(self.weights_in), chip.inputs),
            ("hidden neurons", self.hidden.size, chip.hidden),
            ("outputs", self.outputs.size, chip.outputs),
            ("currents of a hidden neuron", self.hidden.states, chip.states),
        ):
            if count > limit:
                measured = f"{count} against {limit}"
                fix = f"Train a network with fewer {what}."
                raise TargetError(chip.name, f"too many {what}", measured=measured, fix=fix)


def _check_population(name: str, population: XyloPopulation) -> None:
    """Raise InputError unless the parameters agree in shape and fit their registers."""
    size = population.size
    _check_shape(f"{name}.dash_mem", population.dash_mem, (size,))
    _check_shape(f"{name}.dash_syn", population.dash_syn, (size, population.states))
    _check_range(f"{name}.dash_mem", population.dash_mem, low=0, high=xylo.DASH_MAX)
    _check_range(f"{name}.dash_syn", population.dash_syn, low=0, high=xylo.DASH_MAX)
    _check_range(f"{name}.threshold", population.threshold, low=1, high=xylo.STATE_MAX)
    if population.bias is not None:
        _check_shape(f"{name}.bias", population.bias, (size,))
        _check_range(f"{name}.bias", population.bias, xylo.STATE_MIN, xylo.STATE_MAX)


def _check_shape(name: str, array: AnyArray, shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        measured = f"{array.shape} against {shape}"
        raise InputError(name, "the shape does not fit", measured=measured, fix="Give this shape.")


def _check_range(name: str, array: AnyArray, low: int, high: int) -> None:
    """Raise InputError if a value is not within ``low..high``, both included."""
    out_of_range = array[(array < low) | (array > high)]
    if out_of_range.size:
        measured = f"{out_of_range.flat[0]} against {low}..{high}"
        fix = "Give a value in this range."
        raise InputError(name, "the chip cannot hold it", measured=measured, fix=fix)
