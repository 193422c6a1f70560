"""The contract of the core's stream, as docs/reference/hardware/stream-and-memory-map.md has it.

Errors are answered with their number, and leave no trace in the next recording; a stop drops a recording without an answer.
"""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from hw_model.rtl.cosimulation import ANSWER, END, TICK, words_of
from hw_model.rtl.images import CoreProgram, sizes_for
from hw_model.rtl.memory_words import hex_words
from hw_model.rtl.simulators import built, run, sources
from tests.support import benches

pytestmark = [
    pytest.mark.usefixtures("cores_of_this_run"),
    pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"),
]
STOP = 3 << 16
"""The word that drops a recording."""


@pytest.fixture(scope="module")
def play(cores_of_this_run, tmp_path_factory):
    """Return a program on the core, the words of its recording, and a function that plays words and returns the answers."""
    program, spikes = benches.hybrid(22)
    core = CoreProgram(program, spikes.shape[1])
    sizes = sizes_for(core.needs, benches.SIZES)
    folder = tmp_path_factory.mktemp("play")
    binary = built("icarus", sizes, sources())
    (folder / "load").write_bytes(hex_words(core.load_words(sizes)))

    def played(words):
        (folder / "words").write_text("".join(f"{word:x}\n" for word in words))
        run(binary, folder, 100_000)  # cycles without a sign of life after which a core is given up
        return [line.split() for line in (folder / "answers").read_text().splitlines()]

    return core, words_of(core, spikes[0]), played


# By case: the number of the error (`error` of event_input.sv), and the words of a recording that has it. Words below TICK are
# events, by the number of their channel.
ERRORS = {
    "no such channel": (1, lambda core: [core.channels, TICK, END]),
    "the same event twice": (2, lambda core: [0, 0, TICK, END]),
    "channels that do not ascend": (2, lambda core: [1, 0, TICK, END]),
    "more steps than the program has": (3, lambda core: [TICK] * (core.heard + 1) + [END]),
    "an event after the last step": (3, lambda core: [TICK] * core.heard + [0, TICK, END]),
    "an end before the tick": (4, lambda core: [0, END]),
    "an error, and what follows it": (1, lambda core: [core.channels, 0, 0, TICK, 1, END]),
}


@pytest.fixture(scope="module")
def answers(play):
    """Return the answer to the recording, then to each error and to the recording after it, all played in a row."""
    core, words, played = play
    stream = [*words]
    for _, words_with_error in ERRORS.values():
        stream += [*words_with_error(core), *words]
    return played(stream)


@pytest.mark.slow
@pytest.mark.parametrize("name", ERRORS)
def test_an_error_is_answered_and_forgotten(answers, name):
    before, *others = answers
    assert len(others) == 2 * len(ERRORS)
    assert len(before) == len(ANSWER)
    assert before[0] == "0"  # no error
    # Two answers per error: to it, and to the recording after it.
    place = 2 * list(ERRORS).index(name)
    error, after = others[place : place + 2]
    number, _ = ERRORS[name]
    assert int(error[0]) == number
    assert after == before


@pytest.mark.slow
def test_a_stop_is_not_answered_and_forgotten(play, answers):
    """After no word, in the middle and near the end of a recording; recordings follow each other."""
    _, words, played = play
    beginnings = [words[: int(share * (len(words) - 1))] for share in (0.0, 0.3, 0.9)]
    stream = []
    for beginning in beginnings:
        stream += [*beginning, STOP, *words]
    stream += [*words, *beginnings[1], STOP]
    whole_recordings = len(beginnings) + 1
    assert played(stream) == [answers[0]] * whole_recordings


def test_words_hold_events_ticks_and_an_end(play):
    core, _, _ = play
    recording = np.zeros((2, core.channels), dtype=np.uint8)
    recording[1, [0, 1]] = 1
    assert words_of(core, recording) == [TICK, 0, 1, TICK, END]
