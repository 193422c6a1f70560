"""The first level: a trained network in float, as its author thinks of it.

Network -> QuantizedNetwork -> CompartmentGraph -> PlacedGraph -> RoutedGraph -> ChipProgram
(this file)  quantize       lower_neurons      place_cores    route_axons    assemble
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hw_model.graph import Axis, Readout
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class SrmAlpha:
    """A spike response neuron with alpha kernels; time constants in steps of its own axis.

        u(t) = sum over inputs j and their spikes s:  w_j * eps(t - s)   +   sum over own spikes f:  nu(t - f)
        eps(k) = (k / tau_sr) * exp(1 - k / tau_sr)
        nu(k) = -scale_ref * theta * (k / tau_ref) * exp(1 - k / tau_ref)            for k = 0, 1, 2, ...

    It spikes where ``u(t) >= theta``; there is no reset. Source: Kang et al., IJCNN 2022, after SLAYER's SRMALPHA.
    """

    theta: float
    tau_sr: float
    tau_ref: float
    scale_ref: float


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


@dataclass(frozen=True)
class Population:
    """``size`` neurons of one model that step along one axis."""

    name: str
    axis: Axis
    size: int
    neuron: SrmAlpha


@dataclass(frozen=True, eq=False)
class Projection:
    """Weights (n_target, n_source), float64, from an input view or a population to a population."""

    source: str
    target: str
    weights: FloatArray


@dataclass(frozen=True, eq=False)
class Network:
    """A trained network: views of one recording, populations in evaluation order, projections and a readout."""

    name: str
    channels: int
    steps: int
    """Time steps of a recording; a shorter one is followed by silence."""
    step_seconds: float | None
    fingertips: int | None
    """Fingertips of 39 taxels and two polarities, where the channels are those of a tactile sensor."""
    views: tuple[InputView, ...]
    populations: tuple[Population, ...]
    projections: tuple[Projection, ...]
    readout: Readout
    sha256: str
    """Of the file that it was read from."""
    recordings: Recordings | None = None
    """A few recordings that the file carries for the check."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The step axes in use, time first."""
        return tuple(axis for axis in ("time", "location") if any(p.axis == axis for p in self.populations))

    def steps_of(self, axis: Axis) -> int:
        """Steps of an axis: time steps, or one for every channel."""
        return self.steps if axis == "time" else self.channels

    def into(self, name: str) -> tuple[Projection, ...]:
        """Return the projections onto a population."""
        return tuple(projection for projection in self.projections if projection.target == name)

    @property
    def classes(self) -> int:
        """Classes of the readout."""
        return next(p.size for p in self.populations if p.name == self.readout.populations[0])


def check_network(network: Network) -> None:
    """Check the whole level; the first broken rule is an ``InputError`` that names the place."""
    ends = {view.name: (view.axis, view.lines) for view in network.views}
    for population in network.populations:
        if population.name in ends:
            raise InputError(f"population {population.name!r}", "the name is taken", fix="Rename it.")
        ends[population.name] = (population.axis, population.size)
        neuron = population.neuron
        for key in ("theta", "tau_sr", "tau_ref"):
            value = getattr(neuron, key)
            if not (math.isfinite(value) and value > 0):
                raise InputError(
                    f"population {population.name!r}", f"{key} must be above 0", measured=f"{value}", fix="Correct it."
                )
    for view in network.views:
        if view.walk is not None and sorted(view.walk.tolist()) != list(range(network.channels)):
            raise InputError(
                f"input {view.name!r}",
                "its location order is not a permutation of the channels",
                fix="Visit every channel exactly once.",
            )
    for projection in network.projections:
        where = f"projection {projection.source!r} -> {projection.target!r}"
        if projection.source not in ends or projection.target not in ends:
            raise InputError(where, "an end does not exist", fix="Name an input or a population.")
        (source_axis, sources), (target_axis, targets) = ends[projection.source], ends[projection.target]
        if source_axis != target_axis:
            raise InputError(where, f"joins the {source_axis} axis to the {target_axis} axis", fix="Keep to one axis.")
        if projection.weights.shape != (targets, sources):
            raise InputError(
                where,
                "the weights have the wrong shape",
                measured=f"{projection.weights.shape} against {(targets, sources)}",
                fix="Give one row a target and one column a source.",
            )
        if not np.isfinite(projection.weights).all():
            raise InputError(where, "a weight is not a finite number", fix="Train again, with a lower learning rate.")
