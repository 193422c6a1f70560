"""The parts of a network that a frontend collects, and made-up recordings for files that carry none."""

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from hw_model.mapping.graph import Axis, Readout
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.projections import ChipProjection, Matrix, Projection, Signs, values_of

VIEW_NAMES: dict[Axis, str] = {"time": "touch", "location": "touch_transposed"}
STEPS = 100
"""Steps of synthetic recordings if the file does not give them."""
SAMPLES = 8
RATE = 0.05
"""Share of channels that spike in each step."""
_MOST = 10_000_000
_FEWEST_STEPS = 30
"""A shorter touch has no distinct phases."""


@dataclass(eq=False)
class Parts:
    """The parts of a network so far; ``outputs``: the first step whose potentials count, or None if spikes count.

    ``weights``: the factors of outputs whose scores are not weighed by 1.
    """

    views: list[InputView] = field(default_factory=list)
    populations: list[Population] = field(default_factory=list)
    projections: list[Projection | ChipProjection] = field(default_factory=list)
    outputs: dict[str, int | None] = field(default_factory=dict)
    weights: dict[str, float] = field(default_factory=dict)
    tie_class: int | None = None
    """The class that is predicted where all scores tie, if the file names one."""

    @property
    def readout(self) -> Readout:
        """The weighted sum of all outputs."""
        first = tuple(self.outputs.values())
        weights = tuple(self.weights.get(name, 1.0) for name in self.outputs)
        from_step = first[0] if len(set(first)) == 1 else first
        return Readout(tuple(self.outputs), weights, from_step, self.tie_class)

    def network(self, **said: Any) -> Network:
        """Return the network of these parts; ``said`` holds its other fields."""
        said |= {"views": tuple(self.views), "populations": tuple(self.populations)}
        return Network(**said, projections=tuple(self.projections), readout=self.readout)

    def network_of_file(
        self, path: Path, data: bytes, channels: int, steps: int, seconds: float | None, **said: Any
    ) -> Network:
        """Return the network in the bytes of another tool's file, with made-up recordings to check it on.

        ``seconds``: the length of a step that the file states, which recordings and options override.
        """
        said |= {"name": path.stem, "channels": channels, "steps": steps}
        said["usual_step_seconds"] = seconds
        recordings, digest = (
            synthetic_recordings(channels, steps, seconds),
            hashlib.sha256(data).hexdigest(),
        )
        return self.network(**said, sha256=digest, recordings=recordings)


def eight_bit_signs(mantissa: Matrix, where: str, limits: str, fix: str) -> Signs:
    """Return the signs with which 8-bit formats hold these mantissas; refuse mantissas that no format holds."""
    values = values_of(mantissa)
    low, high = int(values.min(initial=0)), int(values.max(initial=0))
    if -256 <= low and high <= 254 and not (values % 2).any():
        return "mixed"
    if max(-low, high) > 255:
        what, measured = "a weight does not fit an 8-bit synapse", f"{low}..{high} against {limits}"
        raise InputError(where, what, measured=measured, fix=fix)
    return "apart"


def touch_fingertips(channels: int) -> int | None:
    """Return the number of fingertips, one or two, with this many channels; None for other inputs."""
    return {TAXELS * POLARITIES: 1, 2 * TAXELS * POLARITIES: 2}.get(channels)


def synthetic_recordings(channels: int, steps: int, step_seconds: float | None) -> Recordings:
    """Return synthetic touches for the channels of fingertips, else random spikes; without labels, always the same."""
    fingertips = touch_fingertips(channels)
    if fingertips is not None and steps >= _FEWEST_STEPS:
        touches = synthetic_touches(SAMPLES, steps=steps, fingertips=fingertips, seed=0)
        return Recordings(touches.spikes, None, step_seconds, touches.source, touches.origin)
    samples = int(np.clip(_MOST // (channels * steps), 1, SAMPLES))
    spikes = np.random.default_rng(0).random((samples, steps, channels), dtype=np.float32) < RATE
    source = f"synthetic spikes, {100 * RATE:g} % per step"
    return Recordings(spikes.astype(np.uint8), None, step_seconds, source, "made up")
