"""Energy of a conventional network's arithmetic: operations times published costs at 45 nm, without memory traffic."""

from hw_model.values import Frozen
from locsnn_compile.baselines.operations import AnnCounts

ANN_ENERGY_SOURCE = "Horowitz, Computing's energy problem, ISSCC 2014: arithmetic at 45 nm and 0.9 V"
ANN_NOT_INCLUDED = (
    "memory traffic: weights, activations and instructions (one 32-bit word from DRAM is 640 pJ or more)",
    "activation functions, control and clock",
    "static power",
)


class Arithmetic(Frozen):
    """Picojoules of a multiplication and of an addition."""

    multiplication_pj: float
    addition_pj: float


ARITHMETICS = {
    "fp32": Arithmetic(3.7, 0.9),
    "int8": Arithmetic(0.2, 0.03),
    "int8_sums_of_32_bits": Arithmetic(0.2, 0.1),
}
"""32-bit floats; only 8-bit integers, which is the lower limit; and 8-bit products summed in 32 bits, as is usual."""


def ann_energy_pj(counts: AnnCounts) -> dict[str, float]:
    """Return the energy of the operations of one recording, for each kind of arithmetic."""
    return {
        name: counts.multiplications * costs.multiplication_pj + counts.additions * costs.addition_pj
        for name, costs in ARITHMETICS.items()
    }
