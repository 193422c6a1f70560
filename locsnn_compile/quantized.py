"""The second level: the same populations and projections, every number an integer that the chip holds."""

from __future__ import annotations

from dataclasses import dataclass

from hw_model.fixed_point import IntArray
from locsnn_compile.network import Network, Population


@dataclass(frozen=True)
class QuantizedSrm:
    """An SRM population in the chip's numbers.

    A potential of 1 in the float network is ``scale`` in the registers. ``decay`` and ``refractory_decay`` are the
    effective decays of the two kernels; an own spike reaches the refractory kernel with effective weight
    ``64 * refractory_mantissa * 2^refractory_exponent``, which is negative or 0. Relative errors of the two kernels
    after rounding are stated: ``kernel_error`` in the root mean square, ``refractory_error`` in the weight.
    """

    population: Population
    scale: float
    decay: int
    refractory_decay: int
    threshold: int
    refractory_mantissa: int
    refractory_exponent: int
    kernel_error: float
    refractory_error: float


@dataclass(frozen=True, eq=False)
class QuantizedProjection:
    """Mantissas (n_target, n_source); the effective weight is ``64 * mantissa * 2^exponent``.

    ``mantissa_max`` is the largest magnitude of the grid and ``step`` its spacing, signs apart: positive and negative
    weights are stored in formats of their own, so that no bit of ``weight_bits`` is spent on the sign.
    """

    source: str
    target: str
    mantissa: IntArray
    exponent: int
    weight_bits: int
    step: int
    mantissa_max: int


@dataclass(frozen=True, eq=False)
class QuantizedNetwork:
    """A network in integers; structure, views and readout are those of ``network``."""

    network: Network
    populations: tuple[QuantizedSrm, ...]
    projections: tuple[QuantizedProjection, ...]

    def population(self, name: str) -> QuantizedSrm:
        """Return a population by name."""
        return next(q for q in self.populations if q.population.name == name)
