"""Programs drawn by hypothesis from everything that a chip file and the builder allow.

Both engines must agree in every integer. Proven ranges, sessions and early stops are checked against
what the reference engine does.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.engine import lay_out, layout, links
from hw_model.simulation import ENGINES
from tests.support import any_program
from tests.support.any_program import SETTINGS
from tests.support.early_stops import possible_futures, with_stream_per_phase
from tests.support.session_programs import check_session_after_every_step, largest_potential_so_far

# hypothesis prints the drawn program, which includes the whole chip.
pytestmark = pytest.mark.filterwarnings("ignore:Generating overly large repr")

PROBE = ("spikes", "u", "v", "potential", "activity")
EVENTS = ("charge_wraps", "current_wraps", "voltage_clips")


def check_engines(drawn: any_program.Drawn) -> hw.SimulationResult:
    """Compare every probe, count and event of both engines, with and without skipping; return the reference's result."""
    slow = hw.simulate(drawn.program, drawn.spikes, engine=ENGINES[1], probe=PROBE)
    for skip in (True, False):
        fast = hw.simulate(drawn.program, drawn.spikes, probe=PROBE, skip=skip)
        for kind in ("spikes", "u", "v", "potential"):
            for name, array in getattr(slow, kind).items():
                assert np.array_equal(getattr(fast, kind)[name], array), (kind, name)
        assert [replace(c, skipped_steps=0) for c in fast.per_recording] == list(slow.per_recording)
        assert fast.events == slow.events
        for a, b in zip(fast.activity["time"], slow.activity["time"], strict=True):
            assert all(np.array_equal(a.by_core[name], b.by_core[name]) for name in a.by_core)
    return slow


def check_ranges(program: hw.ChipProgram, result: hw.SimulationResult) -> None:
    """Check that the proven bounds of every compartment hold in this run."""
    for core, proven in zip(program.cores, hw.prove_range(program), strict=True):
        for piece in core.slices:
            on_core = slice(piece.offset, piece.offset + piece.size)
            in_group = slice(piece.start, piece.stop)
            u = result.u[piece.group][..., in_group]
            v = result.potential[piece.group][..., in_group]
            # Where u may wrap, nothing is proven about it.
            cannot_wrap = proven.cannot_wrap[on_core]
            highest_u = proven.u.high[on_core][cannot_wrap]
            lowest_u = proven.u.low[on_core][cannot_wrap]
            assert (u.max(axis=(0, 1))[cannot_wrap] <= highest_u).all()
            assert (u.min(axis=(0, 1))[cannot_wrap] >= lowest_u).all()
            assert (v.max(axis=(0, 1)) <= np.maximum(proven.v.high[on_core], 0)).all()
            assert (v.min(axis=(0, 1)) >= np.minimum(proven.v.low[on_core], 0)).all()
            # Events are counted for whole groups.
            if piece.size == program.populations[piece.group]:
                events = result.events.get(piece.group, dict.fromkeys(EVENTS, 0))
                wraps = events["charge_wraps"] + events["current_wraps"]
                assert wraps == 0 or not cannot_wrap.all()
                assert events["voltage_clips"] == 0 or not proven.cannot_clip[on_core].all()


def check_program(drawn: any_program.Drawn) -> Counter[str]:
    """Check engines, ranges and a session on a program; return how often each event and feature occurred."""
    result = check_engines(drawn)
    check_ranges(drawn.program, result)
    session = hw.Session(drawn.program)
    first = drawn.program.readout.potentials_from
    for recording, spikes, potential in zip(
        drawn.spikes, result.spikes["y"], result.potential["y"], strict=True
    ):
        session.reset()
        pushed = session.push(recording)
        if first is None:
            assert np.array_equal(pushed.spikes["y"], spikes.cumsum(axis=0, dtype=np.int64))
        else:
            assert np.array_equal(pushed.potential["y"], largest_potential_so_far(potential, first))
    met = Counter({event: int(result.counts[event]) for event in EVENTS})
    met["predict by potentials"] += first is not None
    return (
        drawn.drawn
        + met
        + Counter({"spikes": int(result.counts.spikes), "recordings": len(drawn.spikes)})
    )


def check_streams(drawn: any_program.Drawn) -> Counter[str]:
    """Check a session against whole runs after every step, and a proven stop against other continuations.

    Return how often each feature occurred.
    """
    program = drawn.program
    recording = drawn.spikes[0]
    session = hw.Session(program)
    check_session_after_every_step(program, recording, session.push(recording))
    apart = with_stream_per_phase(program)
    stops = hw.stop_when_proven(apart, {"time": drawn.spikes, "location": drawn.spikes})
    steps_done = int(stops.steps[0])
    result = hw.simulate(
        apart,
        possible_futures(apart, recording, steps_done, np.random.default_rng(steps_done), batch=16),
    )
    assert (result.prediction == stops.prediction[0]).all()
    return drawn.drawn + Counter(
        {"proven early": int(steps_done < stops.all_steps), "steps replayed": session.replayed[0]}
    )


def draw_and_check(check, strategy, examples: int, phases=tuple(Phase)) -> Counter[str]:
    """Check as many drawn programs, with lists of 32-bit words and of wide ones; return how often each feature occurred."""
    met: Counter[str] = Counter()

    @settings(SETTINGS, max_examples=examples, phases=phases)
    @given(strategy, st.sampled_from([32, 32, 12]))
    def run(drawn, bits):
        with pytest.MonkeyPatch.context() as patch:
            # 12 bits are too few for most synapses, so their lists have wide words.
            patch.setattr(links, "WORD_BITS", bits)
            met.update(check(drawn))
            for phase in drawn.program.phases:
                kinds = lay_out.fast_layout(drawn.program, phase.name).tables.links.kind.tolist()
                met.update(
                    {"wide lists": kinds.count(layout.WIDE_LIST), "lists": kinds.count(layout.LIST)}
                )

    run()
    return met


@pytest.mark.slow
def test_engines_ranges_and_sessions_agree_on_any_program():
    met = draw_and_check(check_program, any_program.programs(), 40)
    for what in (*EVENTS, "spikes", "joined compartments", "fans of more than 255", "biases of more than 31 bits",
                 "predict by potentials", "wide lists", "lists", "recurrent links", "programs of other widths", "programs of several cores"):  # fmt: skip
        assert met[what] > 0, what


def without(program: hw.ChipProgram, **values: int) -> hw.ChipProgram:
    """Return a program in which all compartments of every core have the same value of some parameters."""
    cores = [
        replace(core, **{key: np.full(core.compartments, value) for key, value in values.items()})
        for core in program.cores
    ]
    return replace(program, cores=tuple(cores))


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        pytest.param({"parent": -1}, id="joins"),
        pytest.param({"bias_mantissa": 0}, id="biases", marks=pytest.mark.minutes),
    ],
)
def test_a_bound_that_forgets_a_sum_is_noticed_by_these_programs(monkeypatch, values):
    """With a bound that ignores joins or biases, some program runs in 32 bits but needs 64: the draws must find one."""
    bound = lay_out.largest_sum
    monkeypatch.setattr(
        lay_out, "largest_sum", lambda program, *rest: bound(without(program, **values), *rest)
    )
    with pytest.raises(AssertionError):
        draw_and_check(
            check_program, any_program.programs(widths=False), 400, phases=(Phase.generate,)
        )


@pytest.mark.slow
def test_sessions_and_proven_stops_agree_on_any_hybrid():
    met = draw_and_check(check_streams, any_program.hybrid_programs(), 25)
    for what in ("joined compartments", "programs of other widths", "proven early", "steps replayed", "wide lists",
                 "lists"):  # fmt: skip
        assert met[what] > 0, what


if __name__ == "__main__":
    many = int(sys.argv[1])
    for title, check, strategy in (
        ("one phase", check_program, any_program.programs()),
        ("hybrids", check_streams, any_program.hybrid_programs()),
    ):
        begun = time.perf_counter()
        for what, count in sorted(draw_and_check(check, strategy, many).items()):
            print(f"{title:10} {what:30} {count:12,}")
        print(f"{title:10} {'seconds':30} {time.perf_counter() - begun:12.1f}")
