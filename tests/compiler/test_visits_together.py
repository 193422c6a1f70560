"""Location views that visit several channels per step and end with silent steps: from the view to the report.

A location view reads the recording from the transpose buffer, channel by channel in the order of its walk. A visit
plays all rows of a channel at once, each on a line of its own.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.program.text import compartments_text
from locsnn_compile.backends.played import play_recording
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import InputView
from locsnn_compile.network.text import network_text
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.verification.excerpt import take_excerpt
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from locsnn_compile.verification.over_time import OverTime, over_time
from tests.support.networks import hybrid, on_grid, recordings

CHIP = hw.chip("loihi-sim")


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    channels=st.integers(1, 9),
    steps=st.integers(1, 6),
    silence=st.integers(0, 3),
    missing_rows=st.integers(-2, 2),
    data=st.data(),
)
def test_a_view_plays_what_a_loop_over_events_does(
    seed, channels, steps, silence, missing_rows, data
):
    """Recordings may have fewer or more rows than the view has steps."""
    together = data.draw(st.integers(1, channels))
    r = np.random.default_rng(seed)
    walk = r.permutation(channels)
    lines = together * steps
    view = InputView("v", "location", lines, walk, together=together, silence=silence)
    rows = max(0, steps - missing_rows)
    recordings = (r.random((2, rows, channels)) < 0.5).astype(np.uint8)
    location_steps = -(-channels // together) + silence
    expected = np.zeros((2, location_steps, lines), dtype=np.uint8)
    for number, channel in enumerate(walk):
        step = number // together
        first_line = (number % together) * steps
        for t in range(min(rows, steps)):
            expected[:, step, first_line + t] = recordings[:, t, channel]
        assert view.positions[channel] == step
        if together > 1:
            assert view.first_lines[channel] == first_line
    played = view.play(recordings)
    assert view.steps == location_steps
    assert played.dtype == np.uint8
    assert np.array_equal(played, expected)
    assert (view.first_lines is None) == (together == 1)


def test_a_time_view_is_the_recording():
    recording = np.ones((1, 3, 2), dtype=np.uint8)
    view = InputView("v", "time", lines=2)
    assert view.play(recording) is recording
    assert view.positions is None
    assert view.first_lines is None


@pytest.mark.parametrize(
    ("together", "silence", "steps"), [(1, 2, 6), (2, 0, 2), (3, 2, 4), (4, 1, 2)]
)
def test_the_location_axis_has_the_steps_of_its_view(together, silence, steps):
    network = hybrid(together=together, silence=silence)
    check_network(network)
    assert network.steps_of("time") == network.steps
    assert network.steps_of("location") == steps
    graph = lower(network, CHIP, weight_bits=8).compartments
    assert [phase.steps for phase in graph.phases] == [network.steps, steps]
    _, location_input = graph.inputs
    assert location_input.size == together * network.steps
    assert location_input.rows == network.steps
    assert location_input.channels == network.channels


def test_levels_say_how_channels_are_visited():
    levels = lower(hybrid(together=3, silence=2), CHIP, weight_bits=8)
    text = network_text(levels.network)
    assert "input touch_transposed: 36 lines over 4 location steps, walk " in text
    assert ", 3 together, 2 steps of silence\n" in text
    text = compartments_text(levels.compartments)
    assert (
        "input touch_transposed: 36 lines, phase location, plays touch transposed, positions "
        in text
    )
    assert ", first lines " in text
    assert "together" not in network_text(hybrid())
    assert "first lines" not in compartments_text(lower(hybrid(), CHIP, weight_bits=8).compartments)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), together=st.integers(1, 5), silence=st.integers(0, 3))
def test_an_integer_network_is_exact_in_the_match_the_played_lines_and_the_excerpt(
    seed, together, silence
):
    network = on_grid(seed, channels=5, steps=9, together=together, silence=silence)
    levels = lower(network, CHIP, weight_bits=8)
    played = recordings(network, samples=3, seed=seed)
    assert compare(Observed(levels, played)).first_divergence is None
    reference = evaluate(network, played[:1])
    lines = play_recording(levels.program, played[0]).lines
    for view in network.views:
        assert np.array_equal(lines[view.axis], reference.spikes[view.name][0])
    excerpt = take_excerpt(Observed(levels, played), first=None)
    assert excerpt.all_steps["location"] == network.steps_of("location")
    for drawn in excerpt.inputs:
        steps = excerpt.steps[drawn.axis]
        spikes = reference.spikes[drawn.name][0][steps.start : steps.stop]
        # Where neighbouring lines are drawn together, several spikes make one mark.
        assert drawn.together > 1 or drawn.reference.sum() == spikes.sum()


def test_predictions_over_time_end_in_those_of_whole_recordings():
    network = hybrid(
        seed=3, channels=5, steps=20, hidden=8, classes=3, scale=12.0, together=2, silence=2
    )
    levels = lower(network, CHIP, weight_bits=8)
    played = recordings(network, samples=6)
    predictions = over_time(Observed(levels, played))
    assert isinstance(predictions, OverTime)
    assert predictions.right["together"][-1] == 1.0
    # Of the time phase, and 3 of the walk with 2 of silence.
    assert predictions.proven.all_steps == 20 + 5
    assert hw.simulate(levels.program, played).counts_by_phase["location"].spikes > 0
