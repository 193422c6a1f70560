"""Random programs of several phases: sessions and early stops, against the reference on whole recordings."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

import hw_model as hw
from hw_model.simulation import ENGINES
from hw_model.streaming.outcomes import StepScores
from tests.support import any_phases
from tests.support.any_phases import MANY, QUICK
from tests.support.session_programs import joined_scores


def pushed(session: hw.Session, recording: dict[str, np.ndarray], cuts: list[int]) -> StepScores:
    """Reset a session, push a recording cut into parts, and return the concatenated scores of its steps."""
    session.reset()
    rows = len(next(iter(recording.values())))
    ends = [0, *sorted(cuts), rows]
    parts = [
        session.push({name: array[low:high] for name, array in recording.items()})
        for low, high in pairwise(ends)
    ]
    return joined_scores(parts)


def check_so_far(case: any_phases.Case, step: int, session_scores: StepScores) -> None:
    """Check a session after a step against the reference, on the recording up to this step with silence behind it.

    Phases that play rows as they arrive have run up to this step; transposed ones run to their end.
    """
    is_read = (np.arange(case.rows) <= step)[:, None]
    so_far = {
        name: np.where(is_read, array, 0).astype(np.uint8) for name, array in case.first.items()
    }
    whole = hw.simulate(case.program, so_far, engine=ENGINES[1], probe=("spikes", "potential"))
    scores = np.zeros(session_scores.scores.shape[1])
    from_step = case.program.readout.from_step
    phase_of = {
        name: phase.name
        for phase in case.program.phases
        for name in case.program.columns_of(phase.name)
    }
    for name, weight in case.program.readout.terms:
        plays_as_it_comes = case.program.inputs_of(phase_of[name])[0].positions is None
        steps_run = slice(0, step + 1) if plays_as_it_comes else slice(None)
        if name in from_step:
            potentials = whole.potential[name][steps_run][from_step[name] :]
            expected = np.zeros(potentials.shape[1], dtype=int)
            if len(potentials):
                expected = potentials.max(axis=0)
            assert session_scores.potential[name][step].tolist() == expected.tolist(), (name, step)
        else:
            expected = whole.spikes[name][steps_run].sum(axis=0, dtype=int)
            assert session_scores.spikes[name][step].tolist() == expected.tolist(), (name, step)
        scores += weight * expected
    assert np.array_equal(session_scores.scores[step], scores, equal_nan=True)


def check_session(case: any_phases.Case, r: np.random.Generator) -> None:
    """Check a session at some steps, cut at any rows, and at its end against a simulation."""
    session = hw.Session(case.program)
    scores = pushed(session, case.first, [])
    for step in {0, case.rows - 1, *r.integers(case.rows, size=2).tolist()}:
        check_so_far(case, step, scores)
    row_by_row = list(range(1, case.rows))
    at_random = r.integers(case.rows + 1, size=int(r.integers(1, 6))).tolist()
    for cuts in (row_by_row, at_random):
        again = pushed(session if r.random() < 0.5 else hw.Session(case.program), case.first, cuts)
        assert np.array_equal(again.scores, scores.scores, equal_nan=True)
        for kind in ("spikes", "potential"):
            arrays = getattr(again, kind)
            for name, expected in getattr(scores, kind).items():
                assert np.array_equal(arrays[name], expected), (kind, name)
    live = [p for p in case.program.phases if case.program.inputs_of(p.name)[0].positions is None]
    if all((phase.steps or 0) <= case.rows for phase in live):
        assert np.array_equal(
            scores.scores[-1], hw.simulate(case.program, case.first).scores, equal_nan=True
        )


def check_futures(case: any_phases.Case, proven: hw.Stops, r: np.random.Generator) -> None:
    """Check a proven stop: random rows after it never change the winner.

    It applies while the first phase still plays rows as they arrive.
    """
    first = case.program.phases[0]
    steps_done = int(proven.steps[0])
    ends = (
        case.rows
        if first.steps is None or first.align_events is not None
        else min(case.rows, first.steps)
    )
    if case.program.inputs_of(first.name)[0].positions is not None or steps_done >= ends:
        return
    for density in (0.0, 0.05, 0.3, 0.7, 1.0):  # share of events among the bins of the rows to come
        later = {name: np.repeat(array[:1], 32, axis=0) for name, array in case.spikes.items()}
        for array in later.values():
            array[:, steps_done:] = r.random(array[:, steps_done:].shape) < density
        assert set(hw.simulate(case.program, later).prediction.tolist()) == {
            proven.prediction[0]
        }, (steps_done, density)


def check_stops(case: any_phases.Case, r: np.random.Generator) -> hw.Stops:
    """Check stops that are proven, at a margin, and in silence, each against runs of the rows that it has read."""
    program = case.program
    spikes = case.spikes
    final = hw.simulate(program, spikes).prediction
    proven = hw.stop_when_proven(program, spikes)
    assert proven.final.tolist() == proven.prediction.tolist() == final.tolist()
    check_futures(case, proven, r)
    scores = hw.timestep_scores(program, spikes)
    leads = np.sort(scores, axis=2)[..., -2:]
    leads = leads[..., 1] - leads[..., 0] if scores.shape[2] > 1 else scores[..., 0]
    at_margin = hw.stop_at_margin(program, spikes, 1.0)
    for b, step in enumerate(at_margin.steps.tolist()):
        assert step == next(
            (t for t, lead in enumerate(leads[b], 1) if lead >= 1.0), scores.shape[1]
        )
        assert at_margin.prediction[b] == scores[b, step - 1].argmax()
    for silence in (1, 3):
        silent = hw.stop_in_silence(program, spikes, silence)
        # Silence follows a recording that is shorter than a phase over time.
        longer = ((0, 0), (0, silent.all_steps - case.rows), (0, 0))
        is_read = (np.arange(silent.all_steps) < silent.steps[:, None])[..., None]
        read = {name: np.pad(array, longer) * is_read for name, array in spikes.items()}
        assert silent.prediction.tolist() == hw.simulate(program, read).prediction.tolist()
        for b, step in enumerate(silent.steps.tolist()):
            last = [array[b, max(0, step - silence) : step].any() for array in spikes.values()]
            assert step == silent.all_steps or (step >= silence and not any(last))
    return proven


def check(seed: int) -> Counter[str]:
    """Check the program of a seed; return which cases it is."""
    case = any_phases.case(seed)
    r = np.random.default_rng([seed, 1])
    if not case.rows:
        return Counter()
    if case.mixed:
        with pytest.raises(hw.InputError) as caught:
            hw.Session(case.program)
        what = "mixes transposed inputs with inputs that are played as they come, so it cannot run as they arrive"
        assert str(caught.value) == f"phase {case.mixed[0]!r}: {what}. Use simulate."
        return Counter({"mixed phases": 1})
    check_session(case, r)
    proven = check_stops(case, r)
    early = (proven.steps < proven.all_steps) & (proven.steps > 0)
    return Counter(
        {
            "sessions": 1,
            "proven in between": int(early.sum()),
            "one phase": len(case.program.phases) == 1,
        }
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "seeds",
    [QUICK[at : at + 4] for at in range(0, len(QUICK), 4)],
    ids=lambda seeds: f"from {seeds[0]}",
)
def test_sessions_and_stops_agree_with_whole_runs(seeds):
    for seed in seeds:
        check(seed)


@pytest.mark.minutes
def test_sessions_and_stops_agree_with_whole_runs_in_many_programs():
    met = sum(map(check, MANY), Counter())
    assert (
        min(met["sessions"], met["mixed phases"], met["proven in between"], met["one phase"]) >= 10
    ), met
