"""Networks that start at the first touch: the first step of a recording with at least ``align_events`` events.

Torch, the float reference and both engines must agree about where that is; the report says it, and networks for which it
is not defined are refused.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
import locsnn_compile as lc
from hw_model.mapping.graph import Readout
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.errors import InputError
from locsnn_compile.network.check import check_network
from locsnn_compile.network.first_touch import first_touch, from_first_touch
from locsnn_compile.network.network import InputView
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.pipeline import LEVEL_TEXTS, lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed
from tests.support.first_touches import aligned, late, without_biases
from tests.support.networks import hybrid, on_grid, recordings

CHIP = hw.chip("loihi-sim")
EVENTS = st.sampled_from([None, 1, 1, 2, 3])
"""Events in a step that start a recording; None: it starts at its first step."""


def touch_by_hand(recording, events):
    """Return the first step with so many events, or the number of steps."""
    for step, row in enumerate(recording):
        if row.sum() >= events:
            return step
    return len(recording)


def cut_by_hand(recording, events, moved):
    """Return a recording without what precedes the touch; with ``moved`` the touch is at step 0."""
    start = touch_by_hand(recording, events)
    rest = recording[start:]
    silence = 0 * recording[:start]
    return np.concatenate((rest, silence) if moved else (silence, rest))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), events=st.integers(1, 4), moved=st.booleans())
def test_torch_and_numpy_cut_recordings_as_by_hand(seed, events, moved):
    torch = pytest.importorskip("torch")
    r = np.random.default_rng(seed)
    steps = int(r.integers(1, 9))
    channels = int(r.integers(1, 5))
    played = late((r.random((4, steps, channels)) < 0.4).astype(np.uint8), seed)
    expected = np.stack([cut_by_hand(recording, events, moved) for recording in played])
    by_numpy = from_first_touch(played, events, moved=moved)
    assert by_numpy.dtype == np.uint8
    assert np.array_equal(by_numpy, expected)
    by_torch = from_first_touch(torch.tensor(played, dtype=torch.float32), events, moved=moved)
    assert by_torch.dtype == torch.float32
    assert np.array_equal(by_torch.numpy(), expected)
    starts = [touch_by_hand(recording, events) for recording in played]
    assert first_touch(played, events).tolist() == starts
    assert first_touch(torch.tensor(played), events).tolist() == starts


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), time=EVENTS, location=EVENTS)
def test_the_program_does_what_the_integers_do(seed, time, location):
    network = aligned(without_biases(on_grid(seed, channels=5, steps=20)), time, location)
    played = late(recordings(network, samples=4, seed=seed), seed)
    levels = lower(network, CHIP, weight_bits=8)
    match = compare(Observed(levels, played))
    assert match.spikes.mismatches == 0
    assert np.array_equal(match.reference_prediction, match.chip_prediction)
    reference = hw.simulate(levels.program, played, engine="reference")
    assert np.array_equal(reference.scores, evaluate(network, played).scores)
    assert np.array_equal(hw.simulate(levels.program, played).scores, reference.scores)
    for recording, scores in zip(played, reference.scores, strict=True):
        assert np.array_equal(hw.Session(levels.program).push(recording).scores[-1], scores)


def test_a_touch_means_the_same_whenever_it_comes():
    """Only in the location branch: the time branch has fewer steps left after a later touch."""
    network = aligned(hybrid(3, steps=40, scale=40.0))
    network = replace(network, readout=Readout(("location_output",), (1.0,)))
    in_first_eight_steps = (np.arange(40) < 8)[:, None].astype(np.uint8)
    touch = recordings(network, samples=6, seed=1) * in_first_eight_steps
    touch[:, 0, 0] = 1
    later = np.roll(touch, 7, axis=1)
    program = lower(network, CHIP, weight_bits=8).program
    scores = hw.simulate(program, touch).scores
    assert scores.any()
    assert np.array_equal(hw.simulate(program, later).scores, scores)
    assert np.array_equal(evaluate(network, touch).scores, evaluate(network, later).scores)
    # Without the alignment the later touch gives other scores.
    unaligned = lower(aligned(network, time=None, location=None), CHIP, weight_bits=8).program
    assert not np.array_equal(hw.simulate(unaligned, later).scores, scores)


def test_the_report_says_how_late_recordings_start():
    network = aligned(hybrid(2, steps=40, scale=9.0), time=None)
    in_first_half = (np.arange(40) < 20)[:, None].astype(np.uint8)
    played = recordings(network, samples=4, seed=1) * in_first_half
    played = np.roll(played, 11, axis=1)
    played[:, 11, 0] = 1
    compiled = lc.compile(network, events=played, strategy="dendrite")
    assert compiled.report["input"] == {
        "aligned_steps": 11.0,
        "aligned_steps_by_branch": {"time": 0.0, "location": 11.0},
    }
    assert compiled.report["error_budget"]["unexplained_spikes"] == 0
    page = render_markdown(compose(compiled.figures))
    assert "start: at the first touch, 11.0 steps into a recording on average" in page
    assert (
        "steps before the touch: 0.0 (time branch) and 11.0 (location branch) per recording, which starts after"
        in page
    )
    assert "0 over all recordings, before the start or after the last step" in page
    plain = lc.compile(hybrid(2), events=recordings(hybrid(2)), diagnosis=False)
    assert plain.report["input"] == {"aligned_steps": 0.0, "aligned_steps_by_branch": {}}
    assert plain.report["model"]["members"] == []
    assert "first touch" not in plain.files()["report.md"].decode()


def test_steps_before_the_touch_cost_nothing():
    network = aligned(hybrid(2, steps=40, scale=9.0))
    in_last_quarter = (np.arange(40) >= 30)[:, None].astype(np.uint8)
    played = recordings(network, samples=1, seed=1) * in_last_quarter
    played[:, 30, 0] = 1

    def costs_of(network):
        """Return the counts and the nanoseconds of the time phase."""
        program = lower(network, CHIP, weight_bits=8).program
        result = hw.simulate(program, played, probe=("activity",))
        activity = {"time": result.activity["time"][0]}
        latency = hw.latency(program, activity, CHIP.profile("davies2018"))
        return result.counts_by_phase["time"], latency.total_ns

    late_counts, late_ns = costs_of(network)
    all_counts, all_ns = costs_of(aligned(network, time=None, location=None))
    assert late_counts.neuron_updates * 4 == all_counts.neuron_updates
    assert late_counts.synaptic_ops == all_counts.synaptic_ops
    assert late_counts.spikes == all_counts.spikes
    assert late_ns < 0.5 * all_ns


def test_levels_say_where_a_recording_starts():
    network = aligned(hybrid(), time=1, location=3)
    levels = lower(network, CHIP, weight_bits=8)
    assert (
        "input touch: 4 lines over 12 time steps, from the first step with 1 or more events on\n"
        in (LEVEL_TEXTS["network"](levels))
    )
    assert "phase location: 4 steps of location, from the first with 3 or more events on\n" in (
        LEVEL_TEXTS["compartments"](levels)
    )


def biased():
    """Return an aligned hybrid whose hidden neurons of the time axis have biases."""
    network = aligned(hybrid())
    first, *others = network.populations
    return replace(
        network,
        populations=(
            replace(first, neuron=Cuba.of(3, decay_v=0.5, threshold=1.0, bias=0.1)),
            *others,
        ),
    )


def biased_in_another_phase():
    """Return the biased hybrid with its time axis in a phase of another name."""
    network = biased()
    view, *views = network.views
    populations = (
        replace(p, own_phase="touch") if p.axis == "time" else p for p in network.populations
    )
    return replace(
        network, views=(replace(view, own_phase="touch"), *views), populations=(*populations,)
    )


def two_starts():
    """Return a hybrid with two inputs of the time axis that start at different numbers of events."""
    network = aligned(hybrid())
    return replace(
        network, views=(*network.views, InputView("other", "time", lines=4, align_events=2))
    )


@pytest.mark.parametrize(
    ("network", "message"),
    [
        (
            biased(),
            "input 'touch': it starts at the first touch, but population 'time_hidden' has biases, which act before. "
            "Train without biases, or do not align.",
        ),
        (
            biased_in_another_phase(),
            "input 'touch': it starts at the first touch, but population 'time_hidden' has biases, which act before. "
            "Train without biases, or do not align.",
        ),
        (
            two_starts(),
            "input 'touch': other inputs of the time phase start elsewhere. "
            "Give them the same align_events.",
        ),
        (
            aligned(hybrid(), 0),
            "input 'touch', align_events: it must be a whole number of at least 1 (got 0). "
            "Correct it.",
        ),
    ],
    ids=["biases", "biases in another phase", "two starts", "no event"],
)
def test_networks_whose_start_is_not_defined_are_refused(network, message):
    with pytest.raises(InputError) as caught:
        check_network(network)
    assert str(caught.value) == message


@pytest.mark.parametrize("kind", ["nir", "net"])
def test_formats_that_cannot_hold_a_start_refuse_it(kind):
    with pytest.raises(InputError) as caught:
        exchange_file(kind, lower(aligned(hybrid()), CHIP, weight_bits=8).quantized)
    assert (
        str(caught.value)
        == f"--emit {kind}: the format cannot hold a start at the first touch. Emit without it."
    )
