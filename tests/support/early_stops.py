"""Programs for the tests of early stops, and recordings for them.

A run may stop early once no continuation of the recording can change its class. Tests draw such continuations here and
check that the class stays.
"""

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
    """Return the program with a stream for each phase, so that the recordings of the phases can vary separately."""
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
    """Draw recordings of both streams that agree with ``recording`` in all that ``done`` steps have played.

    The time phase runs first, a step per row, then the location phase, which plays whole channels from the buffer.
    While the time phase runs, rows that have not arrived may differ for the location phase as well. Once the time phase
    has ended the whole recording is in the buffer, so nothing may differ.
    """
    steps = len(recording)
    density = r.choice([0.0, 0.1, 0.5, 1.0], (2, batch, 1, 1))
    time, location = (r.random((2, batch, *recording.shape)) < density).astype(np.uint8)
    time[:, :done] = recording[:done]
    was_played = program.inputs_of("location")[0].positions < done - steps
    location[:, :, was_played] = recording[:, was_played]
    if done >= steps:
        location[:] = recording
    return {"time": time, "location": location}


def by_potentials(
    program: hw.ChipProgram, first: int | tuple[int | None, ...] | None
) -> hw.ChipProgram:
    """Return the program with a readout of potentials from step ``first`` on, or of spikes where it is None."""
    return replace(program, readout=replace(program.readout, potentials_from=first))


def one_layer(
    weights, *, decay_u=1024, decay_v=512, threshold=30, bias=0, refractory=1, vmin=None, exponent=0
) -> tuple[hw.ProgramBuilder, hw.ProgramBuilder]:
    """Return a builder with an input ``x`` and compartments ``y``, one per class, and the node of ``y``.

    ``weights`` are (classes, channels).
    """
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
    """Return a program of one or two channels and two or three classes, half of them with dendrites, and a recording.

    Recordings have three to six steps, so that a test can try every continuation of them.
    """
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
        vmin = builder.graph().groups[0].vmin[0]  # as all compartments of a core
        dendrite = builder.add_compartments(
            "y/dendrite",
            classes,
            decay_u=r.choice([1024, 4096]),
            decay_v=r.choice([512, 4096]),
            threshold=0,
            bias=r.choice([0, -640, 640], classes),
            vmin=vmin,
            joined_to=y,
        )
        builder.connect(
            y, dendrite, 2 * r.integers(-60, 20, (classes, classes)), delay=int(r.integers(3))
        )
    program = builder.build()
    program = replace(program, readout=Readout(("y",), (float(r.choice([1.0, 1.0, -1.0, 0.1])),)))
    return program, (r.random((steps, channels)) < 0.5).astype(np.uint8)


def counts_by_core(counts: hw.Counts) -> dict[str, int]:
    """Return the counts that belong to cores; counts of whole phases, as skipped steps, depend on how steps are played."""
    return {name: counts[name] for name in BY_CORE}


def program_and_batch(seed: int, batch: int = 4) -> tuple[hw.ChipProgram, np.ndarray]:
    """Return a random hybrid program and recordings (batch, steps, channels), sparse and dense ones."""
    program, recording = random_hybrid(seed)
    r = np.random.default_rng(seed + 1)
    uniform = r.random((batch, *recording.shape))
    density = r.choice([0.1, 0.5, 1.0], (batch, 1, 1))
    return program, (uniform < density).astype(np.uint8)
