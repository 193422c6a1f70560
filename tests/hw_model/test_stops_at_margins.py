"""Early stops at a margin, the lead of the best class over the second: against a scan of all leads that occur."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.description.counts import BY_CORE
from tests.support.early_stops import SEEDS, counts_by_core, program_and_batch


def leads_of(scores: np.ndarray) -> np.ndarray:
    """Return by how much the best class leads after each step; a single class leads by its score."""
    ordered = np.sort(scores, axis=1)
    return ordered[:, -1] - (ordered[:, -2] if scores.shape[1] > 1 else 0)


def plain_margin(scores: np.ndarray, agreement: float) -> float:
    """Return the smallest of all leads at which enough recordings stop with the class of their last step.

    ``scores`` (recordings, steps, classes); ``agreement``: the share of recordings that is enough.
    """
    leads = [leads_of(of_recording) for of_recording in scores]
    all_leads = {lead for of_recording in leads for lead in of_recording if lead > 0}
    for margin in sorted(all_leads):
        agreed = 0
        for scores_of_steps, leads_of_steps in zip(scores, leads, strict=True):
            reached = np.flatnonzero(leads_of_steps >= margin)
            stop = reached[0] if len(reached) else len(scores_of_steps) - 1
            agreed += scores_of_steps[stop].argmax() == scores_of_steps[-1].argmax()
        if agreed / len(scores) >= agreement:
            return float(margin)
    return float("inf")


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(
    seed=SEEDS, agreement=st.sampled_from([0.0, 0.5, 0.8, 1.0]), psi=st.sampled_from([None, 10.0])
)
def test_a_calibrated_margin_is_the_smallest_that_is_enough(seed, agreement, psi):
    program, recordings = program_and_batch(seed)
    expected = plain_margin(hw.timestep_scores(program, recordings, psi), agreement)
    assert hw.calibrate_margin(program, recordings, agreement, psi) == expected


@pytest.mark.parametrize("psi", [None, 10.0])
def test_margins_scale_with_the_weights_of_the_readout(psi):
    program, recordings = program_and_batch(5)
    readout = program.readout
    tripled = replace(
        program, readout=replace(readout, weights=tuple(3 * weight for weight in readout.weights))
    )
    margin = hw.calibrate_margin(program, recordings, 0.5, psi)
    assert 0 < margin < float("inf")
    assert hw.calibrate_margin(tripled, recordings, 0.5, psi) == pytest.approx(3 * margin)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    seed=SEEDS,
    margin=st.sampled_from([0.5, 1.0, 2.0, 5.0, float("inf")]),
    psi=st.sampled_from([None, 10.0]),
)
def test_stops_at_a_margin_are_at_the_first_step_with_this_lead(seed, margin, psi):
    """They are at the first step with this lead, and count a time phase that ends there and the phase after it."""
    program, recordings = program_and_batch(seed)
    stops = hw.stop_at_margin(program, recordings, margin, psi)
    scores = hw.timestep_scores(program, recordings, psi)
    assert stops.all_steps == recordings.shape[1]
    assert np.array_equal(stops.final, scores[:, -1].argmax(axis=1))
    expected = dict.fromkeys(BY_CORE, 0)
    for b, recording in enumerate(recordings):
        step = int(stops.steps[b])
        leads = leads_of(scores[b])
        assert (leads[: step - 1] < margin).all()
        assert step == len(leads) or leads[step - 1] >= margin
        assert stops.prediction[b] == scores[b, step - 1].argmax()
        short = replace(program, phases=(replace(program.phases[0], steps=step), program.phases[1]))
        read = recording * (np.arange(len(recording)) < step)[:, None].astype(np.uint8)
        counts = hw.simulate(short, read).counts
        expected = {name: n + counts[name] for name, n in expected.items()}
    assert counts_by_core(stops.counts) == expected
    assert counts_by_core(stops.all_counts) == counts_by_core(
        hw.simulate(program, recordings).counts
    )


def test_a_calibrated_margin_keeps_its_agreement_on_its_recordings():
    program, recordings = program_and_batch(4, batch=40)
    margin = hw.calibrate_margin(program, recordings, 0.9)
    stops = hw.stop_at_margin(program, recordings, margin)
    assert (stops.prediction == stops.final).mean() >= 0.9
