"""The AXI-Stream wrapper: answers and spikes equal the simulator's, however its neighbours wait, and faults are answered."""

from __future__ import annotations

import shutil

import pytest
from desk import Desk

import hw_model as hw
from hw_model.rtl.board import spike_numbers
from hw_model.rtl.cosimulation import ANSWER, END, TICK, words_of
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.simulators import built, run, sources

pytestmark = pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed")
LAST, STOP = 1 << 32, 3 << 16


def axis_player(desk, folder, waits: int, texts):
    """Return a function that plays beats and gives the answers and the spikes."""
    binary = built("icarus", desk.sizes, texts, "axis_bench", waits=waits)
    (folder / "load").write_bytes(hex_words(desk.core.load_words(desk.sizes)))

    def play(beats):
        (folder / "words").write_text("".join(f"{beat:x}\n" for beat in beats))
        run(binary, folder, 4000)
        answers = [line.split() for line in (folder / "answers").read_text().splitlines()]
        return [list(map(int, line)) for line in answers], (folder / "spikes").read_text().split()

    return play


@pytest.fixture(scope="module")
def play(tmp_path_factory):
    folder = tmp_path_factory.mktemp("axis")
    desk = Desk()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder))
        yield desk, axis_player(desk, folder, 2, sources())


def beats_of(desk) -> list[int]:
    """Return a recording as beats: the last tick is marked, and there is no end."""
    *words, tick, end = words_of(desk.core, desk.spikes[0])
    assert (tick, end) == (TICK, END)
    return [*words, LAST | TICK]


def expected(desk) -> tuple[list[int], list[str]]:
    found = hw.simulate(desk.program, desk.spikes, probe=("spikes",))
    times = spike_numbers(desk.core, desk.spikes[0], {name: its[0] for name, its in found.spikes.items()})
    counts = [found.per_recording[0][name] for name in ANSWER[3:]]
    return [int(found.prediction[0]), *counts, 0], list(map(str, times))


@pytest.mark.parametrize("waits", [0, 3])
def test_answers_and_spikes_equal_the_simulators(tmp_path, monkeypatch, waits):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    desk = Desk()
    answer, spikes = expected(desk)
    play = axis_player(desk, tmp_path, waits, sources())
    assert play(beats_of(desk) * 2) == ([answer] * 2, spikes * 2)


FAULTS = {
    "no such channel": (1, lambda core: [core.channels, LAST | TICK]),
    "a last word that is an event": (4, lambda core: [TICK, LAST]),
    "an end in the middle": (6, lambda core: [TICK, END, TICK, LAST | TICK]),
    "a stop in the middle": (6, lambda core: [TICK, STOP, TICK, LAST | TICK]),
    "bits above a word": (6, lambda core: [TICK, 1 << 18, LAST | TICK]),
    "bits above the last word": (6, lambda core: [TICK, LAST | 1 << 31 | TICK]),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_answered_and_forgotten(play, name):
    desk, played = play
    number, beats = FAULTS[name]
    answer, _ = expected(desk)
    answers, _ = played([*beats(desk.core), *beats_of(desk)])
    assert answers[0][0] >> 16 == number
    assert answers[1:] == [answer]


def test_a_recording_that_is_dropped_is_not_answered(play):
    desk, played = play
    beats = beats_of(desk)
    answer, _ = expected(desk)
    assert played([LAST | STOP, *beats[:10], LAST | STOP, 1 << 20, LAST | STOP, *beats])[0] == [answer]


def test_an_end_of_its_own_is_an_end(play):
    desk, played = play
    answer, spikes = expected(desk)
    assert played([*beats_of(desk)[:-1], TICK, LAST | END]) == ([answer], spikes)
