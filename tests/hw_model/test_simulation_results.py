"""What a simulation returns besides spikes and registers: scores, predictions, wraps and clips, and counts of steps.

All numbers are worked out by hand for a few compartments.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model import simulation
from hw_model.mapping.graph import Readout
from tests.support.register_units import FORGETS_AT_ONCE, LARGEST_THRESHOLD, UNIT

CHIP = hw.chip("loihi-sim")
STEPS = 5


def two_layers(**parameters) -> hw.ProgramBuilder:
    """Return two groups of two compartments, each driven by both channels with weights 20 and 10; they keep nothing."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    for name in ("y", "z"):
        group = builder.add_compartments(
            name,
            2,
            **{"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE, "threshold": 5} | parameters,
        )
        builder.connect(x, group, [[20, 0], [0, 10]])
    return builder


def recording(*events: tuple[int, int]) -> np.ndarray:
    """Return a recording with events, each a row and a channel."""
    rows = np.zeros((STEPS, 2), dtype=np.uint8)
    for row, channel in events:
        rows[row, channel] = 1
    return rows


@pytest.mark.parametrize(
    ("channel", "prediction"), [(0, 0), (1, 1)], ids=["the first class", "the second"]
)
def test_the_class_with_the_most_spikes_is_predicted(channel, prediction):
    program = replace(two_layers().build(), readout=Readout(("y", "z"), (1.0, 2.0)))
    result = hw.simulate(program, recording((0, channel), (2, channel)))
    scores = [0.0, 0.0]
    scores[channel] = 2 * 1.0 + 2 * 2.0
    assert (result.scores.tolist(), int(result.prediction)) == (scores, prediction)


def test_a_program_without_a_readout_predicts_nothing():
    result = hw.simulate(two_layers().build(), recording((0, 0)))
    assert result.scores is None
    with pytest.raises(hw.InputError) as error:
        _ = result.prediction
    assert str(error.value) == "prediction: the program has no readout. Read the spikes."


@pytest.mark.parametrize(
    ("first_step", "largest"),
    [(1, [20, 10]), (2, [0, 10]), (4, [0, 0])],
    ids=["both events", "the second", "neither"],
)
def test_potentials_count_from_their_first_step_on(first_step, largest):
    """An event of row 0 and channel 0 is a potential of step 1, and one of row 1 and channel 1 is one of step 2.

    The population ``z`` is read by its spikes, one of each compartment.
    """
    program = replace(
        two_layers().build(),
        readout=Readout(("y", "z"), (1.0, 3.0), potentials_from=(first_step, None)),
    )
    result = hw.simulate(program, recording((0, 0), (1, 1)))
    assert result.scores.tolist() == [potential * UNIT + 3.0 for potential in largest]


@pytest.fixture(params=[1, simulation.MAX_TOGETHER], ids=["one by one", "together"])
def bytes_together(request, monkeypatch):
    """Play recordings one by one, or all together."""
    monkeypatch.setattr(simulation, "MAX_TOGETHER", request.param)


def clipping() -> hw.ChipProgram:
    """Return a compartment that every event clips, and one whose potentials fit."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    forgets = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}
    for name, limits in (("narrow", {"vmax": 511}), ("wide", {})):
        group = builder.add_compartments(name, 1, threshold=LARGEST_THRESHOLD, **forgets, **limits)
        builder.connect(x, group, [[100, 100]])
    return builder.build()


@pytest.mark.usefixtures("bytes_together")
@pytest.mark.parametrize("engine", simulation.ENGINES)
def test_clips_are_summed_over_recordings_and_listed_for_populations_that_have_any(engine):
    batch = np.stack([recording((0, 0)), recording((0, 1), (2, 0))])
    result = hw.simulate(clipping(), batch, engine=engine)
    clips = {"charge_wraps": 0, "current_wraps": 0, "voltage_clips": 3}
    assert result.events == {"narrow": clips}
    assert [counts.voltage_clips for counts in result.per_recording] == [1, 2]


def test_counts_of_steps_are_kept_beside_other_probes():
    program = two_layers().build()
    result = hw.simulate(program, recording((0, 0)), probe=("spikes", "activity"))
    (steps,) = result.activity["time"]
    assert steps.steps == STEPS
    assert result.spikes["y"].sum() == 1
    assert hw.simulate(program, recording((0, 0))).activity == {}


def test_steps_at_rest_are_skipped_unless_told_otherwise():
    """An event of row 0 acts in step 1, so that nothing can change in the other four steps."""
    program = two_layers().build()
    skipped = [
        hw.simulate(program, recording((0, 0)), **options).counts.skipped_steps
        for options in ({}, {"skip": True}, {"skip": False}, {"engine": "reference"})
    ]
    assert skipped[0] == skipped[1] > 0
    assert skipped[2:] == [0, 0]
