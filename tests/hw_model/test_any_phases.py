"""The engines on programs of several phases: batches, parts, files and single recordings give the same to the last bit."""

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


def check_equal(result: hw.SimulationResult, wanted: hw.SimulationResult) -> None:
    """Every array, count, event and score; only the steps that an engine skips may differ."""
    for kind in KINDS:
        ours = getattr(result, kind)
        theirs = getattr(wanted, kind)
        assert ours.keys() == theirs.keys()
        assert [name for name in ours if not np.array_equal(ours[name], theirs[name])] == [], kind
    assert [replace(one, skipped_steps=0) for one in result.per_recording] == [
        replace(one, skipped_steps=0) for one in wanted.per_recording
    ]
    assert result.events == wanted.events
    assert np.array_equal(result.scores, wanted.scores, equal_nan=True)
    for phase, items in wanted.activity.items():
        for ours, theirs in zip(result.activity[phase], items, strict=True):
            assert all(
                np.array_equal(ours.by_piece[name], counts)
                for name, counts in theirs.by_piece.items()
            )
            for name in ("packets", "input_packets", "buffered"):
                assert np.array_equal(getattr(ours, name), getattr(theirs, name)), (phase, name)


def check_engines(case: any_phases.Case) -> hw.SimulationResult:
    """With and without skipping, a second time, and a recording at a time, against the reference."""
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
    """What is played where nothing can be compiled."""
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
    whole = [plain_with_skips(any_phases.case(seed)) for seed in QUICK[:12]]
    monkeypatch.setattr(reference, "NUMBERS_AT_ONCE", 1)
    for seed, wanted in zip(QUICK[:12], whole, strict=True):
        result = plain_with_skips(any_phases.case(seed))
        check_equal(result, wanted)
        assert result.per_recording == wanted.per_recording


def check_each(case: any_phases.Case, wanted: hw.SimulationResult) -> None:
    """Every recording by itself, with probes and without."""
    for b, counts in enumerate(wanted.per_recording):
        one = {name: array[b] for name, array in case.spikes.items()}
        alone = hw.simulate(case.program, one, case.steps, probe=KINDS)
        for kind in KINDS:
            for name, array in getattr(alone, kind).items():
                assert np.array_equal(array, getattr(wanted, kind)[name][b]), (kind, name, b)
        bare = hw.simulate(case.program, one, case.steps, probe=())
        for found in (alone, bare):
            assert np.array_equal(found.scores, wanted.scores[b], equal_nan=True)
            assert replace(found.counts, skipped_steps=0) == counts


def check_totals(case: any_phases.Case, found: hw.SimulationResult) -> None:
    """Counts are sums over events and spikes, and energy is their sum by what each costs."""
    totals: Counter[str] = Counter()
    for b, counts in enumerate(found.per_recording):
        plain = counts_of(case, found.spikes, b)
        assert {name: counts[name] for name in COUNTED} == {name: plain[name] for name in COUNTED}
        totals += plain
    totals += Counter(
        hops=totals["hops_x"] + totals["hops_y"],
        neuron_updates_active=found.counts.neuron_updates_active,
    )
    totals["neuron_updates_inactive"] = totals["neuron_updates"] - totals["neuron_updates_active"]
    for profile in case.program.chip.profiles.values():
        expected = sum(cost * totals[name] for name, cost in profile.energy_pj.items())
        assert sum(energy_pj(found.counts, profile).values()) == pytest.approx(expected, rel=1e-12)
    for kept in ("synaptic_ops", "neuron_updates", "spikes", "axon_packets", "hops_x", "hops_y"):
        by_step = sum(
            int(item.count(kept).sum()) for items in found.activity.values() for item in items
        )
        assert by_step == totals[kept], kept


def check(seed: int, folder: Path) -> None:
    case = any_phases.case(seed)
    result = check_engines(case)
    check_each(case, result)
    check_totals(case, result)
    assert np.array_equal(
        case.program.readout.scores(result.spikes, result.potential), result.scores, equal_nan=True
    )
    case.program.save(folder)
    check_equal(hw.simulate(hw.load_program(folder), case.spikes, case.steps, probe=PROBE), result)


@pytest.mark.parametrize("seed", QUICK)
def test_engines_and_totals(seed, tmp_path):
    check(seed, tmp_path)


@pytest.mark.slow
@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("seed", QUICK)
def test_a_batch_after_one_recording(seed):
    """Machine code is kept for the kinds of arrays that one recording has; a batch must have the same.

    No other test has played this program: what the engine lays out for it is kept, too.
    """
    case = any_phases.drawn(seed)
    one = {name: array[:1] for name, array in case.spikes.items()}
    several = {name: np.concatenate([array] * 2) for name, array in case.spikes.items()}
    for given in (one, several):
        expected = hw.simulate(case.program, given, case.steps, ENGINES[1], PROBE)
        check_equal(hw.simulate(case.program, given, case.steps, probe=PROBE), expected)


@pytest.mark.minutes
@pytest.mark.parametrize(
    "seeds",
    [MANY[at : at + 30] for at in range(0, len(MANY), 30)],
    ids=lambda its: f"from {its[0]}",
)
def test_engines_and_totals_of_many(seeds, tmp_path):
    for seed in seeds:
        check(seed, tmp_path / str(seed))


def test_what_the_quick_seeds_meet():
    """Every count but the open core's cycles, and every kind of phase, in some seed."""
    met: Counter[str] = Counter(dict.fromkeys(hw.Counts(), 0))
    for case in map(any_phases.case, QUICK):
        met.update(hw.simulate(case.program, case.spikes, case.steps, probe=()).counts)
        met["phases that begin at a touch"] += any(
            phase.align_events is not None for phase in case.program.phases
        )
        met["phases of both kinds of input"] += bool(case.mixed)
        met["four phases"] += len(case.program.phases) == 4
        met["no rows"] += case.rows == 0
    assert [name for name, many in met.items() if not many] == ["cycles"]
