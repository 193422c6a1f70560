"""What all frontends share: the parts of a network as they are collected, and synthetic recordings.

Files of other tools carry no recordings, so their networks get synthetic ones, to check a compiled program with.
"""

import hashlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from hw_model.mapping.graph import Axis, Readout
from hw_model.values import Frozen
from locsnn_compile.data.channels import Channels
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import HostLayers, InputView, Network, Population
from locsnn_compile.network.projections import ChipProjection, Matrix, Projection, Signs, values_of

VIEW_NAMES: dict[Axis, str] = {"time": "touch", "location": "touch_transposed"}
"""The names of the input views of a trained network, by axis."""
DEFAULT_STEPS = 100
"""Steps of a recording, and so of synthetic ones, if the file does not give them; chosen by hand."""
SAMPLES = 8
"""Number of synthetic recordings that a network carries: few enough to check it in seconds."""
RATE = 0.05
"""Share of channels that spike in each step of synthetic spikes."""
_MOST_VALUES = 10_000_000
"""Largest number of values of all synthetic recordings together; wide networks get fewer than :data:`SAMPLES`."""
_FEWEST_STEPS = 30
"""Fewest steps of a synthetic touch: a shorter one has no time for contact, stroke and lift."""


class FileFacts(Frozen, eq=False):
    """Further facts about another tool's file, besides the network's parts: they become fields of :class:`Network`."""

    any_length: bool
    assumptions: tuple[str, ...]
    inputs: Channels | None
    origin: object | None = None
    host: HostLayers | None = None

    def behind(self, host: HostLayers) -> Self:
        """Return the facts of a network whose first layers run on the host.

        The chip's channels are then spikes of these layers, not the file's pixels, and the network on the chip is not
        the whole file, so it cannot be written as this file again.
        """
        return replace(
            self,
            host=host,
            inputs=None,
            origin=None,
            assumptions=(*self.assumptions, host.sentence),
        )


@dataclass(eq=False)
class Parts:
    """The parts of a network that a frontend has collected so far.

    - ``outputs``: the populations that are read out, each with the first step whose potentials count, or None if its
      spikes count
    - ``weights``: the weights of outputs in the class scores, if not 1
    """

    views: list[InputView] = field(default_factory=list)
    populations: list[Population] = field(default_factory=list)
    projections: list[Projection | ChipProjection] = field(default_factory=list)
    outputs: dict[str, int | None] = field(default_factory=dict)
    weights: dict[str, float] = field(default_factory=dict)
    tie_class: int | None = None
    """The class that is predicted if all scores tie; None if the file names no class for that."""

    @property
    def readout(self) -> Readout:
        """The weighted sum of all outputs."""
        weights = tuple(self.weights.get(name, 1.0) for name in self.outputs)
        from_steps = tuple(self.outputs.values())
        all_from_one_step = len(set(from_steps)) == 1
        from_step = from_steps[0] if all_from_one_step else from_steps
        return Readout(tuple(self.outputs), weights, from_step, self.tie_class)

    def network(self, **other_fields: Any) -> Network:
        """Return the network of these parts; ``other_fields`` are the other fields of :class:`Network`."""
        return Network(
            **other_fields,
            views=tuple(self.views),
            populations=tuple(self.populations),
            projections=tuple(self.projections),
            readout=self.readout,
        )

    def network_of_file(
        self,
        path: Path,
        data: bytes,
        *,
        channels: int,
        steps: int,
        step_seconds: float | None,
        facts: FileFacts,
    ) -> Network:
        """Return the network of another tool's file, whose bytes are ``data``, with synthetic recordings.

        ``step_seconds``: the length of a step that the file states, which recordings and options override.
        """
        return self.network(
            name=path.stem,
            channels=channels,
            steps=steps,
            usual_step_seconds=step_seconds,
            sha256=hashlib.sha256(data).hexdigest(),
            recordings=synthetic_recordings(channels, steps, step_seconds),
            any_length=facts.any_length,
            inputs=facts.inputs,
            origin=facts.origin,
            host=facts.host,
            assumptions=facts.assumptions,
        )


def choose_eight_bit_signs(mantissa: Matrix, where: str, *, limits: str, fix: str) -> Signs:
    """Return the signs with which 8-bit formats hold these mantissas: ``mixed`` if possible, else ``apart``.

    Mixed signs share one list of synapses, with a sign bit in place of the lowest bit, so mantissas must be even.
    Otherwise each sign has a list, with all 8 bits. Raises ``InputError`` for mantissas that no format holds, with
    ``limits`` and ``fix`` in its message.
    """
    values = values_of(mantissa)
    lowest = int(values.min(initial=0))
    highest = int(values.max(initial=0))
    all_even = not (values % 2).any()
    if -256 <= lowest and highest <= 254 and all_even:
        return "mixed"
    if max(-lowest, highest) > 255:
        what = "a weight does not fit an 8-bit synapse"
        measured = f"{lowest}..{highest} against {limits}"
        raise InputError(where, what, measured=measured, fix=fix)
    return "apart"


def touch_fingertips(channels: int) -> int | None:
    """Return the number of fingertips, one or two, with this many channels; None for other inputs."""
    return {TAXELS * POLARITIES: 1, 2 * TAXELS * POLARITIES: 2}.get(channels)


def synthetic_recordings(channels: int, steps: int, step_seconds: float | None) -> Recordings:
    """Return synthetic touches for the channels of fingertips, else random spikes; unlabelled, and always the same."""
    fingertips = touch_fingertips(channels)
    if fingertips is not None and steps >= _FEWEST_STEPS:
        touches = synthetic_touches(SAMPLES, steps=steps, fingertips=fingertips, seed=0)
        return Recordings(
            touches.spikes,
            labels=None,
            step_seconds=step_seconds,
            source=touches.source,
            origin=touches.origin,
        )
    samples = int(np.clip(_MOST_VALUES // (channels * steps), 1, SAMPLES))
    spikes = np.random.default_rng(0).random((samples, steps, channels), dtype=np.float32) < RATE
    source = f"synthetic spikes, {100 * RATE:g} % per step"
    return Recordings(
        spikes.astype(np.uint8),
        labels=None,
        step_seconds=step_seconds,
        source=source,
        origin="made up",
    )
