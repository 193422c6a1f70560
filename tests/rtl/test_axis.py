"""The AXI-Stream wrapper (locsnn_axis.sv), played by axis_bench.sv, whose streams stall at random.

Answers and spikes equal the simulator's, however long its neighbours wait, and faults in the stream are answered. A beat is
one word of a stream: its data, with TLAST in bit 32 (`LAST`). In the data, the kind of the word is in bits 16 and 17 (event,
tick, end or stop), the channel of an event is in the bits below, and all bits above must be 0. A `Desk`
(`tests/support/desk.py`) is a small program with a recording, and boards that run it.
"""

from __future__ import annotations

import shutil

import pytest

import hw_model as hw
from hw_model.rtl.board import spike_numbers
from hw_model.rtl.cosimulation import ANSWER_COUNTS, END, TICK
from hw_model.rtl.simulators import sources
from tests.support.benches import LATER, SIZES
from tests.support.desk import LAST, STOP, Desk
from tests.support.marks import first_quick

pytestmark = [
    pytest.mark.usefixtures("cores_of_this_run"),
    pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"),
]


@pytest.fixture(scope="module", params=first_quick([SIZES, LATER]), ids=["plain", "later"])
def desk(request):
    return Desk(request.param)


@pytest.fixture(scope="module")
def play(desk, tmp_path_factory):
    """Return a function that plays beats, and returns the words of the answers and the spikes."""
    folder = tmp_path_factory.mktemp("axis")
    return lambda beats, **more: desk.play_axis(folder, beats, sources(), **more)


@pytest.fixture(scope="module")
def expected(desk) -> tuple[list[str], list[str]]:
    """Return the words of the answer and the spikes that the simulator expects for the recording."""
    result = hw.simulate(desk.program, desk.spikes, probe=("spikes",))
    times = spike_numbers(
        desk.core,
        desk.spikes[0],
        {name: spikes_of_group[0] for name, spikes_of_group in result.spikes.items()},
    )
    counts = [result.per_recording[0][name] for name in ANSWER_COUNTS]
    lost_spikes = 0
    answer = [result.prediction[0], *counts, lost_spikes]
    return list(map(str, answer)), list(map(str, times))


@pytest.mark.slow
@pytest.mark.parametrize("waits", [0, 3], ids=["never stalls", "stalls in 3 of 4 cycles"])
def test_answers_and_spikes_equal_the_simulators(desk, play, expected, waits):
    answer, spikes = expected
    assert play(desk.beats() * 2, waits=waits) == ([answer] * 2, spikes * 2)


NO_CHANNEL, NO_TICK, NO_WORD = 1, 4, 6
"""Numbers of errors, as event_input.sv and locsnn_axis.sv have them."""
BIT_ABOVE_KIND = 1 << 18
HIGHEST_BIT = 1 << 31
# By case: the number of the error, and the beats of a recording that has it.
FAULTS = {
    "no such channel": (NO_CHANNEL, lambda core: [core.channels, LAST | TICK]),
    "a last word that is an event": (NO_TICK, lambda core: [TICK, LAST]),
    "an end in the middle": (NO_WORD, lambda core: [TICK, END, TICK, LAST | TICK]),
    "a stop in the middle": (NO_WORD, lambda core: [TICK, STOP, TICK, LAST | TICK]),
    "bits above a word": (NO_WORD, lambda core: [TICK, BIT_ABOVE_KIND, LAST | TICK]),
    "bits above the last word": (NO_WORD, lambda core: [TICK, LAST | HIGHEST_BIT | TICK]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(FAULTS, 2))
def test_a_fault_is_answered_and_forgotten(desk, play, expected, name):
    number, beats = FAULTS[name]
    answers, _ = play([*beats(desk.core), *desk.beats()])
    wrong, *after = answers
    # The first word of an answer has the error from bit 16 on, and the class below, here 0.
    assert int(wrong[0]) == number << 16
    assert after == [expected[0]]


def test_a_recording_that_is_dropped_is_not_answered(desk, play, expected):
    beats = desk.beats()
    higher_bit = 1 << 20  # above the kind, so not a valid word
    # Stops at once, after ten words, and after a word that is not valid.
    dropped = [LAST | STOP, *beats[:10], LAST | STOP, higher_bit, LAST | STOP]
    assert play([*dropped, *beats])[0] == [expected[0]]


def test_a_recording_may_end_with_a_beat_that_is_only_an_end(desk, play, expected):
    answer, spikes = expected
    assert play([*desk.beats()[:-1], TICK, LAST | END]) == ([answer], spikes)
