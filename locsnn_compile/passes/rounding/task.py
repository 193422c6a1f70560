"""A population to put into integers, and all that is known of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hw_model.arithmetic.weights import WeightGrid
from hw_model.description.chip import Chip
from locsnn_compile.network.matrices import row_maxima
from locsnn_compile.network.network import Population, Projection
from locsnn_compile.network.neurons import FloatArray
from locsnn_compile.passes.rounding.rounding import Rounding
from locsnn_compile.reference.calibration import Calibration


@dataclass(frozen=True, eq=False)
class Task:
    """A float population, the weights onto it, and how they are to be rounded for a chip: onto a ``grid``."""

    population: Population
    incoming: tuple[Projection, ...]
    chip: Chip
    grid: WeightGrid
    strategy: str
    rounding: Rounding
    calibration: Calibration | None

    @property
    def where(self) -> str:
        """How errors name it."""
        return f"population {self.population.name!r}"

    @property
    def largest(self) -> FloatArray:
        """The largest weight onto each neuron, (n,)."""
        found: FloatArray = np.max(
            [np.zeros(self.population.size), *(row_maxima(p.weights) for p in self.incoming)], axis=0
        )
        return found
