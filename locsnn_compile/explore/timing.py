"""How long the simulator's engines take to play a program.

A point of ``locsnn explore`` is timed after its figures are known, on recordings of its check.
"""

import time
from collections.abc import Mapping, Sequence

import numpy as np

from hw_model.simulation import Engine
from hw_model.targets.programs import AnyProgram, kind_of
from hw_model.values import ByteArray, Frozen

ENGINE_RECORDINGS: dict[Engine, int] = {"fast": 16, "reference": 1}
"""How many of the first recordings an engine is timed on. The reference engine is too slow for more.

16 recordings are a batch of the fast engine, which plays them together.
"""
ENGINE_CALLS: dict[Engine, int] = {"fast": 10, "reference": 2}
"""How many times an engine is timed; the fastest call counts, because other programs only slow it. Chosen by hand."""


class Timing(Frozen):
    """Seconds per recording of an engine, played ``recordings`` at a time on the machine that measured the point."""

    recordings: int
    seconds: float


def engine_timings(
    program: AnyProgram, recordings: ByteArray, engines: Sequence[Engine]
) -> dict[str, Timing]:
    """Time each engine on the first recordings; all engines must find the same spikes."""
    timings: dict[str, Timing] = {}
    spikes_by_engine: list[Mapping[str, ByteArray]] = []
    for engine in engines:
        timed_recordings = recordings[: ENGINE_RECORDINGS[engine]]
        seconds: list[float] = []
        for _ in range(ENGINE_CALLS[engine]):
            start = time.perf_counter()
            played = kind_of(program).play(program, timed_recordings, engine)
            seconds.append(time.perf_counter() - start)
        per_recording = min(seconds) / len(timed_recordings)
        timings[engine] = Timing(len(timed_recordings), per_recording)
        spikes_by_engine.append(played.spikes)
    for spikes in spikes_by_engine[1:]:
        _check_equal(spikes_by_engine[0], spikes)
    return timings


def _check_equal(expected: Mapping[str, ByteArray], played: Mapping[str, ByteArray]) -> None:
    """Assert that two engines found the same spikes, by population, in the recordings that both played."""
    for name, spikes in played.items():
        shared = min(len(spikes), len(expected[name]))
        is_equal = np.array_equal(spikes[:shared], expected[name][:shared])
        assert is_equal, f"the engines differ in {name}"
