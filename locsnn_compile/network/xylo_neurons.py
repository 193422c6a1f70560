"""Neurons whose every number is an integer that a Xylo chip (SynSense) holds."""

from typing import ClassVar

from hw_model.io.records import between
from hw_model.values import IntArray, Shown
from locsnn_compile.network.neurons import Musts, Neuron


class XyloNeuron(Shown, Neuron):
    """Neurons that take the step of :mod:`hw_model.arithmetic.xylo`, with one current each.

    ``dash_syn`` and ``dash_mem`` are the bit shifts by which current and potential decay. Every array is int64, (n,). A
    neuron spikes up to ``most_spikes`` times per step, and each spike takes the threshold from its potential: 31 times
    for a hidden neuron, once for an output. Its weights are those of a ``ChipProjection`` of mixed signs, whose
    exponent is the chip's weight shift.
    """

    dash_syn: IntArray
    dash_mem: IntArray
    threshold: IntArray
    most_spikes: int

    # Nothing is left to round: parameters and incoming weights are the chip's integers.
    on_grid = True
    # Words of the error for chips that do not have such neurons.
    needs = "neurons of a Xylo, whose decays are shifts and which spike several times in a step"
    way_out = "Compile it for the Xylo that it was trained on."
    # What the registers of a Xylo hold: see PARAMETERS in ``hw_model.arithmetic.xylo``.
    musts: ClassVar[Musts] = {
        "dash_syn": between(0, 15),
        "dash_mem": between(0, 15),
        "threshold": between(1, 32_767),
    }

    @property
    def spikes_at(self) -> IntArray:
        """``threshold``, which v must reach, in counts of its register."""
        return self.threshold
