"""Programs that stop early, recordings for them, and what may follow those."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

import hw_model as hw
from hw_model.description.counts import BY_CORE
from hw_model.mapping.graph import Readout
from tests.support.hybrids import CHIP, random_hybrid

SEEDS = st.integers(0, 2**32 - 1)


def with_stream_per_phase(program: hw.ChipProgram) -> hw.ChipProgram:
    """The same program with a recording of its own for each phase, so that they can be varied apart."""
    return replace(
        program, inputs=tuple(replace(item, stream=item.phase) for item in program.inputs)
    )


def possible_futures(
    program: hw.ChipProgram,
    recording: np.ndarray,
    done: int,
    r: np.random.Generator,
    batch: int = 64,
):
    """Recordings of both streams that are as given until ``done`` steps of the phases in order have run.

    When the time phase has ended the recording is over, and the buffer of the location phase holds all of it.
    """
    steps = len(recording)
    density = r.choice([0.0, 0.1, 0.5, 1.0], (2, batch, 1, 1))
    time, location = (r.random((2, batch, *recording.shape)) < density).astype(np.uint8)
    time[:, :done] = recording[:done]
    played = program.inputs_of("location")[0].positions < done - steps
    location[:, :, played] = recording[:, played]
    if done >= steps:
        location[:] = recording
    return {"time": time, "location": location}


def by_potentials(
    program: hw.ChipProgram, first: int | tuple[int | None, ...] | None
) -> hw.ChipProgram:
    """The program with a readout of potentials from that step on, or of spikes."""
    return replace(program, readout=replace(program.readout, potentials_from=first))


def one_layer(
    weights, *, decay_u=1024, decay_v=512, threshold=30, bias=0, refractory=1, vmin=None, exponent=0
) -> tuple[hw.ProgramBuilder, hw.ProgramBuilder]:
    """A builder with input ``x`` and its compartments ``y``, one a class."""
    builder = hw.ProgramBuilder(CHIP)
    classes, channels = np.shape(weights)
    x = builder.add_input("x", channels)
    y = builder.add_compartments(
        "y",
        classes,
        decay_u=decay_u,
        decay_v=decay_v,
        threshold=threshold,
        bias=bias,
        refractory=refractory,
        vmin=vmin,
    )
    builder.connect(x, y, weights, exponent=exponent)
    builder.read_out(y)
    return builder, y


def random_layer(seed: int) -> tuple[hw.ChipProgram, np.ndarray]:
    """A program of one or two channels and up to three classes, some with a dendrite, and a short recording."""
    r = np.random.default_rng(seed)
    channels = int(r.integers(1, 3))
    classes = int(r.integers(2, 4))
    steps = int(r.integers(3, 7))
    weights = 2 * r.integers(-30, 60, (classes, channels))
    builder, y = one_layer(
        weights,
        decay_u=r.choice([1024, 4096], classes),
        decay_v=r.choice([512, 4096], classes),
        threshold=r.choice([0, 30, 60], classes),
        bias=r.choice([0, 0, -640], classes),
        refractory=r.choice([1, 2, 4], classes),
        vmin=r.choice([0, 1 - 2**15]),
    )
    if r.random() < 0.5:
        dendrite = builder.add_compartments(
            "y/dendrite", classes, decay_u=r.choice([1024, 4096]), decay_v=r.choice([512, 4096]), threshold=0,
            bias=r.choice([0, -640, 640], classes), vmin=builder._groups[0].vmin[0], joined_to=y,
        )  # fmt: skip
        builder.connect(
            y, dendrite, 2 * r.integers(-60, 20, (classes, classes)), delay=int(r.integers(3))
        )
    program = builder.build()
    program = replace(program, readout=Readout(("y",), (float(r.choice([1.0, 1.0, -1.0, 0.1])),)))
    return program, (r.random((steps, channels)) < 0.5).astype(np.uint8)


def counts_by_core(counts: hw.Counts) -> dict[str, int]:
    """The counts that belong to cores; those of the whole phase, as skipped steps, differ between ways to play."""
    return {name: counts[name] for name in BY_CORE}


def program_and_batch(seed: int, batch: int = 4) -> tuple[hw.ChipProgram, np.ndarray]:
    program, recording = random_hybrid(seed)
    r = np.random.default_rng(seed + 1)
    return program, (
        r.random((batch, *recording.shape)) < r.choice([0.1, 0.5, 1.0], (batch, 1, 1))
    ).astype(np.uint8)
