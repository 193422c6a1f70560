"""Random programs of several phases: the fast engine gives the same integers as the reference, however it is called.

Batches, parts of batches, single recordings, and programs that were saved and loaded are compared. Counts are
compared with sums of Python's own over the recorded spikes (:mod:`tests.support.plain_counts`).
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model import simulation
from hw_model.accounting.cost import energy_pj
from hw_model.engine import reference
from hw_model.engine.playing import Player
from hw_model.simulation import ENGINES
from tests.support import any_phases
from tests.support.any_phases import MANY, QUICK
from tests.support.plain_counts import COUNTED, counts_of

KINDS = ("spikes", "u", "v", "potential")
PROBE = (*KINDS, "activity")
IN_PARTS = QUICK[:12]
"""Programs that are also played recording by recording, which is slow; chosen by hand."""
SEEDS_OF_A_TEST = 30
"""Programs of one long test, so that processes can share them."""


def check_equal(result: hw.SimulationResult, expected: hw.SimulationResult) -> None:
    """Compare every array, count, event and score. Only the number of skipped steps may differ."""
    for kind in KINDS:
        arrays = getattr(result, kind)
        expected_arrays = getattr(expected, kind)
        assert arrays.keys() == expected_arrays.keys()
        for name, array in expected_arrays.items():
            assert np.array_equal(arrays[name], array), (kind, name)
    assert without_skips(result) == without_skips(expected)
    assert result.events == expected.events
    assert np.array_equal(result.scores, expected.scores, equal_nan=True)
    for phase, activities in expected.activity.items():
        for activity, expected_activity in zip(result.activity[phase], activities, strict=True):
            for name, counts in expected_activity.by_piece.items():
                assert np.array_equal(activity.by_piece[name], counts), (phase, name)
            for name in ("packets", "input_packets", "buffered"):
                counts = getattr(expected_activity, name)
                assert np.array_equal(getattr(activity, name), counts), (phase, name)


def without_skips(result: hw.SimulationResult) -> list[hw.Counts]:
    """Return the counts of each recording, with skipped steps set to 0."""
    return [replace(counts, skipped_steps=0) for counts in result.per_recording]


def check_engines(case: any_phases.Case) -> hw.SimulationResult:
    """Check the fast engine against the reference: with skipping, without, again, and one recording at a time."""
    expected = hw.simulate(case.program, case.spikes, case.steps, ENGINES[1], PROBE)
    for skip in (True, False, True):
        check_equal(
            hw.simulate(case.program, case.spikes, case.steps, probe=PROBE, skip=skip), expected
        )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulation, "MAX_TOGETHER", 1)
        check_equal(hw.simulate(case.program, case.spikes, case.steps, probe=PROBE), expected)
    return expected


def plain_with_skips(case: any_phases.Case) -> hw.SimulationResult:
    """Return what the engine "fast" gives where numba cannot compile loops."""
    play = partial(reference.run_phase, skip=True)
    return simulation.play_recordings(case.program, case.spikes, case.steps, PROBE, play, Player())


@pytest.mark.slow
@pytest.mark.parametrize("seed", QUICK)
def test_the_plain_engine_counts_the_steps_that_the_fast_one_skips(seed: int) -> None:
    case = any_phases.case(seed)
    result = plain_with_skips(case)
    expected = hw.simulate(case.program, case.spikes, case.steps, probe=PROBE)
    assert result.per_recording == expected.per_recording


@pytest.mark.slow
def test_recordings_that_do_not_fit_at_once_are_played_in_parts(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    at_once = [plain_with_skips(any_phases.case(seed)) for seed in IN_PARTS]
    monkeypatch.setattr(reference, "NUMBERS_AT_ONCE", 1)
    for seed, expected in zip(IN_PARTS, at_once, strict=True):
        result = plain_with_skips(any_phases.case(seed))
        check_equal(result, expected)
        assert result.per_recording == expected.per_recording


def check_each_recording_alone(case: any_phases.Case, of_batch: hw.SimulationResult) -> None:
    """Check every recording played alone, with probes and without, against the batch."""
    for b, counts in enumerate(of_batch.per_recording):
        recording = {name: array[b] for name, array in case.spikes.items()}
        probed = hw.simulate(case.program, recording, case.steps, probe=KINDS)
        for kind in KINDS:
            for name, array in getattr(probed, kind).items():
                assert np.array_equal(array, getattr(of_batch, kind)[name][b]), (kind, name, b)
        unprobed = hw.simulate(case.program, recording, case.steps, probe=())
        for alone in (probed, unprobed):
            assert np.array_equal(alone.scores, of_batch.scores[b], equal_nan=True)
            assert replace(alone.counts, skipped_steps=0) == counts


def check_totals(case: any_phases.Case, result: hw.SimulationResult) -> None:
    """Check counts against sums over events and spikes, and energy against counts times costs."""
    totals: Counter[str] = Counter()
    for b, counts in enumerate(result.per_recording):
        plain = counts_of(case, result.spikes, b)
        assert {name: counts[name] for name in COUNTED} == {name: plain[name] for name in COUNTED}
        totals += plain
    totals += Counter(
        hops=totals["hops_x"] + totals["hops_y"],
        neuron_updates_active=result.counts.neuron_updates_active,
    )
    totals["neuron_updates_inactive"] = totals["neuron_updates"] - totals["neuron_updates_active"]
    for profile in case.program.chip.profiles.values():
        expected = sum(cost * totals[name] for name, cost in profile.energy_pj.items())
        assert sum(energy_pj(result.counts, profile).values()) == pytest.approx(expected, rel=1e-12)
    activities = [activity for of_phase in result.activity.values() for activity in of_phase]
    for name in ("synaptic_ops", "neuron_updates", "spikes", "axon_packets", "hops_x", "hops_y"):
        over_all_steps = sum(int(activity.count(name).sum()) for activity in activities)
        assert over_all_steps == totals[name], name


def check(seed: int, folder: Path) -> None:
    """Check the random program of a seed, its recordings one by one, its totals, and its file."""
    case = any_phases.case(seed)
    result = check_engines(case)
    check_each_recording_alone(case, result)
    check_totals(case, result)
    assert np.array_equal(
        case.program.readout.scores(result.spikes, result.potential), result.scores, equal_nan=True
    )
    case.program.save(folder)
    check_equal(hw.simulate(hw.load_program(folder), case.spikes, case.steps, probe=PROBE), result)


@pytest.mark.parametrize("seed", QUICK)
def test_both_engines_agree_and_counts_are_sums(seed, tmp_path):
    check(seed, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("seed", QUICK)
def test_a_batch_after_one_recording_runs_the_same_machine_code(seed):
    """Machine code is kept for the types of arrays of one recording; those of a batch must be the same.

    Programs are drawn anew, because the engine also keeps the layout of a program that another test has played.
    """
    case = any_phases.drawn(seed)
    one_recording = {name: array[:1] for name, array in case.spikes.items()}
    batch = {name: np.concatenate([array] * 2) for name, array in case.spikes.items()}
    for spikes in (one_recording, batch):
        expected = hw.simulate(case.program, spikes, case.steps, ENGINES[1], PROBE)
        check_equal(hw.simulate(case.program, spikes, case.steps, probe=PROBE), expected)


@pytest.mark.minutes
@pytest.mark.parametrize(
    "seeds",
    [MANY[at : at + SEEDS_OF_A_TEST] for at in range(0, len(MANY), SEEDS_OF_A_TEST)],
    ids=lambda seeds: f"from {seeds[0]}",
)
def test_both_engines_agree_and_counts_are_sums_in_many_programs(seeds, tmp_path):
    for seed in seeds:
        check(seed, tmp_path / str(seed))


def test_the_quick_seeds_meet_every_count_and_every_kind_of_phase():
    """Some seed has every count except the open core's cycles, and every kind of phase: nothing is tested in vain."""
    met: Counter[str] = Counter(dict.fromkeys(hw.Counts(), 0))
    for case in map(any_phases.case, QUICK):
        met.update(hw.simulate(case.program, case.spikes, case.steps, probe=()).counts)
        met["phases that begin at a touch"] += any(
            phase.align_events is not None for phase in case.program.phases
        )
        met["phases of both kinds of input"] += bool(case.mixed)
        met["four phases"] += len(case.program.phases) == 4
        met["no rows"] += case.rows == 0
    assert [name for name, times in met.items() if times == 0] == ["cycles"]
