"""Networks that start at the first touch: torch, float reference, both engines and the report; what is refused."""

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


def by_hand(recording, events, moved):
    start = next((t for t, row in enumerate(recording) if row.sum() >= events), len(recording))
    cut = recording[start:]
    return np.concatenate((cut, 0 * recording[:start]) if moved else (0 * recording[:start], cut))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), events=st.integers(1, 4), moved=st.booleans())
def test_torch_and_numpy_cut_recordings_as_by_hand(seed, events, moved):
    torch = pytest.importorskip("torch")
    r = np.random.default_rng(seed)
    played = late(
        (r.random((4, int(r.integers(1, 9)), int(r.integers(1, 5)))) < 0.4).astype(np.uint8), seed
    )
    wanted = np.stack([by_hand(one, events, moved) for one in played])
    found = from_first_touch(played, events, moved=moved)
    assert found.dtype == np.uint8
    assert np.array_equal(found, wanted)
    of_torch = from_first_touch(torch.tensor(played, dtype=torch.float32), events, moved=moved)
    assert of_torch.dtype == torch.float32
    assert np.array_equal(of_torch.numpy(), wanted)
    starts = [
        next((t for t, row in enumerate(one) if row.sum() >= events), len(one)) for one in played
    ]
    assert (
        first_touch(played, events).tolist()
        == first_touch(torch.tensor(played), events).tolist()
        == starts
    )


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
    for one, scores in zip(played, reference.scores, strict=True):
        assert np.array_equal(hw.Session(levels.program).push(one).scores[-1], scores)


def test_a_touch_means_the_same_whenever_it_comes():
    """To the location branch: the time branch has less time left after a later touch."""
    network = aligned(hybrid(3, steps=40, scale=40.0))
    network = replace(network, readout=Readout(("location_output",), (1.0,)))
    touch = recordings(network, samples=6, seed=1) * (np.arange(40) < 8)[:, None].astype(np.uint8)
    touch[:, 0, 0] = 1
    later = np.roll(touch, 7, axis=1)
    program = lower(network, CHIP, weight_bits=8).program
    early = hw.simulate(program, touch).scores
    assert np.array_equal(early, hw.simulate(program, later).scores)
    assert np.array_equal(evaluate(network, touch).scores, evaluate(network, later).scores)
    assert early.any()
    assert not np.array_equal(
        hw.simulate(lower(aligned(network, None, None), CHIP, weight_bits=8).program, later).scores,
        early,
    )


def test_the_report_says_how_late_recordings_start():
    network = aligned(hybrid(2, steps=40, scale=9.0), time=None)
    played = np.roll(
        recordings(network, samples=4, seed=1) * (np.arange(40) < 20)[:, None].astype(np.uint8),
        11,
        axis=1,
    )
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
    played = recordings(network, samples=1, seed=1) * (np.arange(40) >= 30)[:, None].astype(
        np.uint8
    )
    played[:, 30, 0] = 1
    costs = {}
    for name, its in (("aligned", network), ("whole", aligned(network, None, None))):
        levels = lower(its, CHIP, weight_bits=8)
        found = hw.simulate(levels.program, played, probe=("activity",))
        latency = hw.latency(
            levels.program, {"time": found.activity["time"][0]}, CHIP.profile("davies2018")
        )
        costs[name] = found.counts_by_phase["time"], latency.total_ns
    (late, late_ns), (whole, whole_ns) = costs["aligned"], costs["whole"]
    assert late.neuron_updates * 4 == whole.neuron_updates
    assert (late.synaptic_ops, late.spikes) == (whole.synaptic_ops, whole.spikes)
    assert late_ns < 0.5 * whole_ns


def test_levels_say_where_a_recording_starts():
    network = aligned(hybrid(), 1, 3)
    levels = lower(network, CHIP, weight_bits=8)
    assert (
        "input touch: 4 lines over 12 time steps, from the first step with 1 or more events on\n"
        in (LEVEL_TEXTS["network"](levels))
    )
    assert "phase location: 4 steps of location, from the first with 3 or more events on\n" in (
        LEVEL_TEXTS["compartments"](levels)
    )


def biased():
    network = aligned(hybrid())
    first, *others = network.populations
    return replace(
        network,
        populations=(
            replace(first, neuron=Cuba.of(3, decay_v=0.5, threshold=1.0, bias=0.1)),
            *others,
        ),
    )


def in_a_phase_of_its_own():
    network = biased()
    view, *views = network.views
    populations = (
        replace(p, own_phase="touch") if p.axis == "time" else p for p in network.populations
    )
    return replace(
        network, views=(replace(view, own_phase="touch"), *views), populations=(*populations,)
    )


def two_starts():
    network = aligned(hybrid())
    return replace(network, views=(*network.views, InputView("other", "time", 4, align_events=2)))


@pytest.mark.parametrize(
    ("network", "message"),
    [
        (
            biased(),
            "input 'touch': it starts at the first touch, but population 'time_hidden' has biases, which act before. "
            "Train without biases, or do not align.",
        ),
        (
            in_a_phase_of_its_own(),
            "input 'touch': it starts at the first touch, but population 'time_hidden' has biases, which act before. "
            "Train without biases, or do not align.",
        ),
        (
            two_starts(),
            "input 'touch': other inputs of the time phase start elsewhere. Give them the same align_events.",
        ),
        (
            aligned(hybrid(), 0),
            "input 'touch', align_events: it must be a whole number of at least 1 (got 0). Correct it.",
        ),
    ],
    ids=["biases", "biases in another phase", "two starts", "no event"],
)
def test_what_is_refused(network, message):
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
