"""The first level: a trained network, as its author thinks of it: in float, or already in the chip's integers.

Network -> QuantizedNetwork -> CompartmentGraph -> PlacedGraph -> RoutedGraph -> ChipProgram
(this file)  quantize       lower_neurons      place_cores    route_axons    assemble
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hw_model.fixed_point import IntArray
from hw_model.graph import Axis, Readout
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.matrices import Matrix, fan_out
from locsnn_compile.neurons import Cuba, SoftCuba, SrmAlpha
from locsnn_compile.on_grid import ChipCuba, ChipProjection, ChipSrm

Neuron = SrmAlpha | Cuba | SoftCuba | ChipSrm | ChipCuba
"""Float models, which ``quantize`` rounds, and on-grid ones, which every pass keeps exactly."""


@dataclass(frozen=True, eq=False)
class InputView:
    """``lines`` input lines of one axis, taken from the recording (steps, channels).

    On the time axis line c spikes at step t where channel c does. On the location axis ``walk[p]`` is the channel that
    is visited at step p: line t spikes at step p where channel ``walk[p]`` has an event at time step t.
    """

    name: str
    axis: Axis
    lines: int
    walk: npt.NDArray[np.int64] | None = None

    @property
    def positions(self) -> npt.NDArray[np.int64] | None:
        """The inverse of the walk: the step at which each channel is visited."""
        return None if self.walk is None else np.argsort(self.walk).astype(np.int64)

    def play(self, recordings: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        """Return the lines' spikes, (batch, steps of the axis, lines), of recordings (batch, time steps, channels)."""
        return recordings if self.walk is None else recordings[:, :, self.walk].transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class Population:
    """``size`` neurons of one model that step along one axis."""

    name: str
    axis: Axis
    size: int
    neuron: Neuron

    @property
    def on_grid(self) -> bool:
        """Whether its parameters, and the weights onto it, are integers of the chip already."""
        return isinstance(self.neuron, ChipSrm | ChipCuba)

    def threshold_of(self, i: int) -> float:
        """Return the threshold of neuron i, in the units of its potential."""
        neuron = self.neuron
        if isinstance(neuron, SrmAlpha):
            return neuron.theta
        return float(neuron.threshold[i]) if isinstance(neuron, Cuba | SoftCuba) else 64.0 * int(neuron.threshold[i])


@dataclass(frozen=True, eq=False)
class Projection:
    """Weights (n_target, n_source), float64, dense or CSR, from an input view or a population to a population.

    A spike of step t acts at step ``t + 1 + delay``; ``delay`` in steps, one for all, or an array like the matrix's
    values: (n_target, n_source), or (entries,) of a sparse one. The source may be the target, or come after it.
    """

    source: str
    target: str
    weights: Matrix
    delay: int | IntArray = 0

    def fan_out(self) -> IntArray:
        """Return the weights other than 0 that each source has, (n_source,)."""
        return fan_out(self.weights)


@dataclass(frozen=True, eq=False)
class Network:
    """A trained network: views of one recording, populations, projections and a readout."""

    name: str
    channels: int
    steps: int
    """Time steps of a recording; a shorter one is followed by silence."""
    step_seconds: float | None
    fingertips: int | None
    """Fingertips of 39 taxels and two polarities, where the channels are those of a tactile sensor."""
    views: tuple[InputView, ...]
    populations: tuple[Population, ...]
    projections: tuple[Projection | ChipProjection, ...]
    readout: Readout
    sha256: str
    """Of the file that it was read from."""
    recordings: Recordings | None = None
    """A few recordings that the file carries for the check."""
    origin: object | None = None
    """What its file held, where it can be written again in that format."""
    any_length: bool = False
    """Whether a recording is played for as many steps as it has; ``steps`` is then only the usual number."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The step axes in use, time first."""
        return tuple(axis for axis in ("time", "location") if any(p.axis == axis for p in self.populations))

    def steps_of(self, axis: Axis) -> int:
        """Steps of an axis: time steps, or one for every channel."""
        return self.steps if axis == "time" else self.channels

    def into(self, name: str) -> tuple[Projection | ChipProjection, ...]:
        """Return the projections onto a population."""
        return tuple(projection for projection in self.projections if projection.target == name)

    @property
    def classes(self) -> int:
        """Classes of the readout."""
        return next(p.size for p in self.populations if p.name == self.readout.populations[0])
