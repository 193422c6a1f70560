"""Operations by the published method: what a network costs on paper, without a chip.

A spiking network adds one weight for every spike and every neuron that it reaches, and multiplies nothing. The
artificial networks that it is compared with multiply and add; each counts as one operation. Source: Kang et al., IJCNN
2022; the counts below reproduce its printed figures to the last digit.

The energy of an artificial network is that of its arithmetic: operations times published costs at 45 nm, without memory
traffic.
"""

import math
from collections.abc import Mapping

import numpy as np

from hw_model.values import ByteArray, Frozen, IntArray
from locsnn_compile.baselines.ann_shapes import CONVOLUTIONS, convolved
from locsnn_compile.data.sensor import SensorLayout, neutouch
from locsnn_compile.errors import InputError, did_you_mean
from locsnn_compile.network.network import Network

GRU_HIDDEN = 32
"""Units of the published GRU."""
ANN_NAMES = ("cnn-3d", "gru-mlp")


class AnnCounts(Frozen):
    """Operations of one recording; ``macs`` counts the multiplications that are followed by an addition to a sum."""

    macs: int
    multiplications: int
    additions: int

    @property
    def operations(self) -> int:
        """Multiplications plus additions."""
        return self.multiplications + self.additions


def ann_operations(name: str, *, fingertips: int, steps: int, classes: int) -> int:
    """Return multiplications plus additions of one recording of ``steps`` time steps; see :func:`ann_counts`."""
    return ann_counts(name, sensor=neutouch(fingertips), steps=steps, classes=classes).operations


def ann_counts(name: str, *, sensor: SensorLayout, steps: int, classes: int) -> AnnCounts:
    """Count the operations of one recording of ``steps`` time steps.

    ``cnn-3d``: for each fingertip (or each surface of another sensor), Conv3d(2 -> 4, kernel 7x3x3, stride 4x1x1) and
    Conv3d(4 -> 8, kernel 5x3x3, stride 3x1x1), then one linear layer over the outputs of all fingertips. The input of a
    fingertip is steps x 9 x 7: its 39 taxels are drawn on a grid of 9 rows and 7 columns. Other sensors have grids of
    their own size. Biases are not counted, as in the published figures.

    ``gru-mlp``: GRU(channels -> 32), then one linear layer at the last step. In addition to the products with weights,
    the published count has 13 operations per step and unit: nine additions in the gates (two biases each, and the sum
    of input and state), the product with the reset gate, and, for the new state, two products and their sum.
    """
    if name == "cnn-3d":
        macs = _cnn_3d_macs(sensor, steps, classes)
        return AnnCounts(macs, macs, macs)
    if name == "gru-mlp":
        inputs = sensor.channels
        hidden = GRU_HIDDEN
        # Three gates, each with weights onto the input and onto the state.
        macs = steps * 3 * (inputs * hidden + hidden * hidden) + hidden * classes
        # Per step and unit: one product with the reset gate and two for the new state; nine additions
        # in the gates and one for the new state.
        return AnnCounts(
            macs=macs,
            multiplications=macs + 3 * steps * hidden,
            additions=macs + 10 * steps * hidden,
        )
    raise InputError(
        f"network {name!r}", "its operations are not known", fix=did_you_mean(name, ANN_NAMES)
    )


def _cnn_3d_macs(sensor: SensorLayout, steps: int, classes: int) -> int:
    """Return the multiply-accumulates of CNN-3D for one recording, over all surfaces of the sensor."""
    macs = 0
    features = 0  # outputs of the last convolution, which the linear layer reads
    channels = sensor.polarities
    for (outputs, kernel, _), size in zip(CONVOLUTIONS, convolved(steps, sensor), strict=True):
        features = math.prod(size) * outputs
        macs += features * channels * math.prod(kernel)
        channels = outputs
    return sensor.surfaces * (macs + features * classes)


def network_additions(network: Network, spikes: Mapping[str, ByteArray]) -> dict[str, int]:
    """Return the additions of all recordings by phase; see :func:`additions_of_recordings`."""
    by_phase = additions_of_recordings(network, spikes)
    return {phase: int(additions.sum()) for phase, additions in by_phase.items()}


def additions_of_recordings(
    network: Network, spikes: Mapping[str, ByteArray]
) -> dict[str, IntArray]:
    """Return the additions of each recording, (batch,), by phase: spikes (batch, steps, n) times fan-out.

    A phase is a part of a recording's time on the chip: that of the time branch, or of the location
    branch. An addition counts in the phase of the neuron that it reaches.
    """
    batch = len(next(iter(spikes.values())))
    additions = {phase.name: np.zeros(batch, dtype=np.int64) for phase in network.phases}
    phase_of = {population.name: population.phase for population in network.populations}
    for projection in network.projections:
        spike_counts = spikes[projection.source].sum(axis=1, dtype=np.int64)
        additions[phase_of[projection.target]] += spike_counts @ projection.fan_out
    return additions


ANN_ENERGY_SOURCE = (
    "Horowitz, Computing's energy problem, ISSCC 2014: arithmetic at 45 nm and 0.9 V"
)
ANN_NOT_INCLUDED = (
    "memory traffic (weights, activations and instructions; a 32-bit word from DRAM takes 640 pJ or more)",
    "activation functions, clocks and control",
    "static power",
)


class Arithmetic(Frozen):
    """Picojoules of a multiplication and of an addition."""

    multiplication_pj: float
    addition_pj: float


ARITHMETICS = {
    "fp32": Arithmetic(multiplication_pj=3.7, addition_pj=0.9),
    "int8": Arithmetic(multiplication_pj=0.2, addition_pj=0.03),
    "int8_sums_of_32_bits": Arithmetic(multiplication_pj=0.2, addition_pj=0.1),
}
"""32-bit floats; only 8-bit integers, which is the lower limit; and 8-bit products summed in 32 bits, as is usual.

The numbers are those of :data:`ANN_ENERGY_SOURCE`.
"""


def ann_energy_pj(counts: AnnCounts) -> dict[str, float]:
    """Return the energy of the operations of one recording, for each kind of arithmetic."""
    energy_pj: dict[str, float] = {}
    for name, costs in ARITHMETICS.items():
        multiplications_pj = counts.multiplications * costs.multiplication_pj
        additions_pj = counts.additions * costs.addition_pj
        energy_pj[name] = multiplications_pj + additions_pj
    return energy_pj
