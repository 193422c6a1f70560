"""The protocol of a board, on a simulated board without a line: frames from a host, and the board's replies.

Answers to recordings equal the simulator's. Every fault of a frame, of a command and of the stream is answered with its number,
and none disturbs what follows.
"""

from __future__ import annotations

import shutil
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.rtl.board import PROBLEMS, Board, spike_numbers
from hw_model.rtl.cosimulation import ANSWER_COUNTS, END, TICK
from hw_model.rtl.frames import ANSWER as ANSWERED
from hw_model.rtl.frames import DONE, ERROR, HELLO, LOAD, REPORT, SPIKES, WELCOME, WORDS, framed
from tests.support import benches
from tests.support.desk import (
    LINE_BROKEN,
    PATIENCE,
    PRESS,
    REFUSED_LOADS,
    WORD,
    Desk,
    damaged,
    exchange,
    over_a_line,
    received_frames,
    stream_words,
)
from tests.support.marks import first_quick

pytestmark = [
    pytest.mark.usefixtures("cores_of_this_run"),
    pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"),
]
LINE, CHECKSUM, SHORT, OVERRUN, SEQUENCE, CUT_OFF, NO_TYPE, FORM, NO_PLACE, BUSY, NO_PROGRAM = (
    range(1, 12)
)
"""Numbers of problems, in the order of docs/reference/hardware/serial-line-and-axi.md."""
SPIKE_COUNT = ANSWER_COUNTS.index("spikes")
FLAG = 0x7E
"""The byte between frames; 0x7D is the escape before a byte of a frame that is one of the two."""
LOAD_OF_A_WORD = b"\x01\0\0\0\x04abcd"
"""A part of a program: memory 1, address 0 (three bytes), 4 bytes per word, and one word."""
NO_ANSWER = "board: it does not answer. Check the port, the baud rate and the bitstream."


@pytest.fixture(scope="module")
def desk(cores_of_this_run):
    return Desk()


@pytest.fixture(scope="module")
def loaded(desk):
    """Return the port of a board with a program, and the board's answer to the recording."""
    port = desk.port()
    board = Board(port)
    board.load(desk.core)
    yield port, board.play(desk.core, desk.spikes[0])
    port.close()


def greet(port) -> None:
    """Start a session anew, so that the next frame has the number 1."""
    assert exchange(port, HELLO, 0)[-1][:2] == (WELCOME, 0)


def test_a_board_reports_its_sizes(desk):
    port = desk.port(buffer=512)
    board = Board(port)
    port.close()
    assert (board.sizes, board.buffer, board.cut_off) == (desk.sizes, 512, False)


def expected_counts(simulated: hw.SimulationResult) -> tuple[int, ...]:
    """Return the counts of the first recording, in the order of an answer."""
    return tuple(simulated.per_recording[0][name] for name in ANSWER_COUNTS)


def expected_spikes(desk: Desk, simulated: hw.SimulationResult) -> list[int]:
    """Return the spikes of the first recording, as a board numbers them."""
    spikes = {name: of_population[0] for name, of_population in simulated.spikes.items()}
    return spike_numbers(desk.core, desk.spikes[0], spikes)


@pytest.mark.slow
def test_answers_equal_the_simulators(desk, loaded):
    port, first = loaded
    expected = hw.simulate(desk.program, desk.spikes, probe=("spikes",))
    board = Board(port)
    board.report(wanted=True)
    with_spikes = board.play(desk.core, desk.spikes[0])
    for answer in (first, with_spikes):
        assert answer.error == 0
        assert answer.winner == expected.prediction[0]
        assert answer.counts == expected_counts(expected)
    spikes = expected_spikes(desk, expected)
    assert len(spikes) > 10
    assert first.spikes == ()  # the host had not asked for them
    assert (list(with_spikes.spikes), with_spikes.lost) == (spikes, 0)


# By case: the number of the problem that the board reports, and what spoils a frame.
SPOILED = {
    "a byte without its stop bit": (
        LINE,
        lambda port: port.write([FLAG, HELLO, LINE_BROKEN + 1, FLAG]),
    ),
    "a wrong checksum": (CHECKSUM, lambda port: port.write(damaged(framed(WORDS, 1, WORD)))),
    "a frame cut off in the middle": (
        CHECKSUM,
        lambda port: port.write(framed(WORDS, 1, WORD)[:5] + b"\x7e"),
    ),
    "a frame that ends in an escape": (
        CHECKSUM,
        lambda port: port.write(framed(WORDS, 1, WORD)[:-1] + b"\x7d\x7e"),
    ),
    "three bytes": (SHORT, lambda port: port.write(b"\x7eabc\x7e")),
    "bytes outside of frames": (SHORT, lambda port: port.write(b"a\x7e")),
    "more than its buffer": (OVERRUN, lambda port: port.write(framed(WORDS, 1, bytes(1200)))),
    "a number too high": (SEQUENCE, lambda port: port.write(framed(WORDS, 2, WORD))),
    "a number again": (SEQUENCE, lambda port: port.write(framed(WORDS, 0, WORD))),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(SPOILED, 3))
def test_a_frame_that_is_spoiled_is_answered_once_and_does_nothing(desk, loaded, name):
    port, plain = loaded
    problem, spoil = SPOILED[name]
    greet(port)
    spoil(port)
    assert received_frames(port) == [(ERROR, 1, bytes((problem,)))]
    # The number that the error names is still expected, and nothing of the spoiled frame is left.
    assert exchange(port, WORDS, 1, stream_words(desk.words))[0] == (DONE, 1, b"")
    board = Board(port)
    assert not board.cut_off
    assert board.play(desk.core, desk.spikes[0]) == plain


# By case: the number of the problem that the board reports, and the kind and payload of the frame.
REFUSED = {
    "a type that does not exist": (NO_TYPE, 9, b""),
    "type 0": (NO_TYPE, 0, b"abc"),
    "half a word of the stream": (FORM, WORDS, b"\1\0"),
    "bits above a word": (FORM, WORDS, b"\4\0\0"),
    "a switch that is neither": (FORM, REPORT, b"\2"),
    "a switch and more": (FORM, REPORT, b"\1\1"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(REFUSED, 3))
def test_a_frame_that_is_refused_is_answered(loaded, name):
    port, _ = loaded
    problem, kind, payload = REFUSED[name]
    greet(port)
    assert exchange(port, kind, 1, payload) == [(ERROR, 1, bytes((problem,)))]
    assert exchange(port, REPORT, number=2, payload=b"\0") == [(DONE, 2, b"")]


@pytest.fixture(scope="module")
def empty(desk):
    """Return a port of a board without a program."""
    port = desk.port()
    yield port
    port.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(REFUSED_LOADS, 3))
def test_a_load_that_is_refused_is_answered(empty, name):
    outside = ("an address outside its memory", "a word that runs over the end")
    problem = NO_PLACE if name in outside else FORM
    greet(empty)
    assert exchange(empty, LOAD, 1, REFUSED_LOADS[name]) == [(ERROR, 1, bytes((problem,)))]
    assert exchange(empty, REPORT, number=2, payload=b"\0") == [(DONE, 2, b"")]


@pytest.mark.slow
def test_a_hello_has_no_payload(loaded):
    port, _ = loaded
    greet(port)
    assert exchange(port, HELLO, number=1, payload=b"a") == [(ERROR, 1, bytes((FORM,)))]


def test_a_load_during_a_recording_is_refused_and_the_recording_goes_on(desk, loaded):
    port, plain = loaded
    words = desk.words
    greet(port)
    assert exchange(port, WORDS, 1, stream_words(words[:5])) == [(DONE, 1, b"")]
    assert exchange(port, LOAD, number=2, payload=LOAD_OF_A_WORD) == [(ERROR, 2, bytes((BUSY,)))]
    done, answer = exchange(port, WORDS, 3, stream_words(words[5:]))
    assert done == (DONE, 3, b"")
    _, _, payload = answer
    assert payload[:3] == bytes((plain.error, 0, plain.winner))  # the class has two bytes


@pytest.mark.parametrize("share", first_quick([0.5, 0.1, 0.9]))
def test_a_recording_that_is_cut_off_does_no_harm(desk, loaded, share):
    port, plain = loaded
    words = desk.words
    greet(port)
    exchange(port, REPORT, number=1, payload=b"\1")
    exchange(port, WORDS, 2, stream_words(words[: int(share * len(words))]))
    assert [kind for kind, _, _ in exchange(port, HELLO, 0) if kind != SPIKES] == [ERROR, WELCOME]
    assert Board(port).play(desk.core, desk.spikes[0]) == plain


@pytest.mark.minutes
def test_a_board_that_hears_events_on_arrival(desk):
    """The board reports this size, answers as the simulator does, and forgets a recording that is cut off."""
    later = Desk(benches.LATER)
    port = later.port(patience=2 * PATIENCE)
    board = Board(port)
    assert (later.core.later, board.sizes) == (True, later.sizes)
    board.load(later.core)
    board.report(wanted=True)
    first = board.play(later.core, later.spikes[0])
    greet(port)
    exchange(port, WORDS, 1, stream_words(later.words[: len(later.words) // 2]))
    board = Board(port)
    again = board.play(later.core, later.spikes[0])
    port.close()
    expected = hw.simulate(later.program, later.spikes, probe=("spikes",))
    assert (first.error, first.winner) == (0, expected.prediction[0])
    assert first.counts == expected_counts(expected)
    assert list(first.spikes) == expected_spikes(later, expected)
    assert (board.cut_off, again.winner, again.counts) == (True, first.winner, first.counts)


def test_the_host_says_that_a_recording_was_cut_off(loaded):
    port, _ = loaded
    greet(port)
    exchange(port, WORDS, 1, WORD)
    assert Board(port).cut_off
    assert not Board(port).cut_off


def test_a_hello_waits_for_the_answer_that_is_due(desk, loaded):
    port, _ = loaded
    greet(port)
    port.write(framed(WORDS, 1, stream_words(desk.words)) + framed(HELLO, number=7, payload=b""))
    assert [(kind, number) for kind, number, _ in received_frames(port)] == [
        (DONE, 1),
        (ANSWERED, 0),
        (WELCOME, 7),
    ]


# By case: the number of the error in the answer, and the words of a recording that has it.
STREAM_ERRORS = {
    "no such channel": (1, lambda core: [core.channels, TICK, END]),
    "channels that do not ascend": (2, lambda core: [1, 0, TICK, END]),
    "more steps than the program has": (3, lambda core: [TICK] * (core.heard + 1) + [END]),
    "an end before the tick": (4, lambda core: [0, END]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", first_quick(STREAM_ERRORS, 2))
def test_an_error_of_the_stream_is_answered(desk, loaded, name):
    port, plain = loaded
    number, words = STREAM_ERRORS[name]
    greet(port)
    done, answer = exchange(port, WORDS, 1, stream_words(words(desk.core)))
    kind, _, payload = answer
    assert done == (DONE, 1, b"")
    assert (kind, payload[0]) == (ANSWERED, number)
    assert Board(port).play(desk.core, desk.spikes[0]) == plain


def says_loaded(port) -> bool:
    """Greet the board; return whether it reports a program, in the second byte of its welcome."""
    ((_, _, payload),) = exchange(port, HELLO, 0)
    return payload[1] == 1


@pytest.mark.minutes
def test_words_before_a_program_are_refused(desk):
    port = desk.port()
    assert not says_loaded(port)
    assert exchange(port, WORDS, 1, WORD) == [(ERROR, 1, bytes((NO_PROGRAM,)))]
    Board(port).load(desk.core)
    assert says_loaded(port)
    # After part of a load the board has no program, nor after a reset.
    assert exchange(port, LOAD, number=1, payload=LOAD_OF_A_WORD) == [(DONE, 1, b"")]
    assert exchange(port, WORDS, 2, WORD) == [(ERROR, 2, bytes((NO_PROGRAM,)))]
    Board(port).load(desk.core)
    port.write([PRESS])
    assert exchange(port, WORDS, 0, WORD) == [(ERROR, 0, bytes((NO_PROGRAM,)))]
    port.close()


@pytest.mark.slow
def test_steps_wait_for_spikes_that_wait(desk, loaded):
    _, plain = loaded
    # Room for four spikes, where the recording has more, and the host takes them as they come.
    with closing(desk.port(spikes=4)) as port:
        board = Board(port)
        board.load(desk.core)
        board.report(wanted=True)
        answer = board.play(desk.core, desk.spikes[0])
    assert (answer.lost, answer.counts, answer.winner) == (0, plain.counts, plain.winner)
    assert len(answer.spikes) == plain.counts[SPIKE_COUNT]


@pytest.mark.minutes
def test_an_answer_comes_after_its_spikes(desk, loaded):
    _, plain = loaded
    answer = over_a_line(desk)
    assert (answer.counts, answer.lost) == (plain.counts, 0)
    assert len(answer.spikes) == plain.counts[SPIKE_COUNT]


@pytest.mark.slow
def test_spikes_without_room_are_counted(desk):
    port = desk.port(spikes=2)
    board = Board(port)
    board.load(desk.core)
    board.report(wanted=True)
    answer = board.play(desk.core, desk.spikes[0])
    port.close()
    spikes = expected_spikes(desk, hw.simulate(desk.program, desk.spikes))
    assert answer.lost > 0
    assert answer.lost + len(answer.spikes) == len(spikes)
    assert set(answer.spikes) < set(spikes)


class NoisyLine:
    """A port whose line damages one byte of ``bytes_per_error`` at random, to the board and from it."""

    def __init__(self, port, bytes_per_error: int, seed: int) -> None:
        self.port = port
        self.bytes_per_error = bytes_per_error
        self.random = np.random.default_rng(seed)
        self.damaged = 0

    def spoil(self, data: bytes) -> bytes:
        flipped_bits = self.random.integers(1, 256, len(data))
        is_damaged = self.random.random(len(data)) < 1 / self.bytes_per_error
        self.damaged += np.count_nonzero(is_damaged)
        flips = (flipped_bits * is_damaged).astype(np.uint8)
        return bytes(np.frombuffer(data, dtype=np.uint8) ^ flips)

    def write(self, data: bytes) -> None:
        self.port.write(self.spoil(data))

    def read(self) -> bytes:
        return self.spoil(self.port.read())


def load_over_a_noisy_line(desk, bytes_per_error, seed):
    """Load a program over a noisy line, and play the recording over a clean one; return the line and the answer."""
    with closing(desk.port(buffer=64, patience=2000)) as port:
        line = NoisyLine(port, bytes_per_error, seed)
        board = Board(line)
        board.load(desk.core)
        line.bytes_per_error = 1 << 30
        return line, board.play(desk.core, desk.spikes[0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("bytes_per_error", "seed"), first_quick([(100, 1), (100, 2), (100, 3), (60, 1)])
)
def test_damaged_bytes_do_no_harm(desk, monkeypatch, bytes_per_error, seed):
    # With an error in a hundred bytes, a frame of 64 bytes and its reply pass undamaged in half of the cases. Four tries
    # fail for one frame of sixteen, and a load has forty: with so few tries, it is chance whether the host gives up.
    monkeypatch.setattr("hw_model.rtl.board.TRIES", 16)
    line, answer = load_over_a_noisy_line(desk, bytes_per_error, seed)
    assert line.damaged >= 20
    expected = hw.simulate(desk.program, desk.spikes)
    assert (answer.error, answer.winner) == (0, expected.prediction[0])


@pytest.mark.slow
def test_a_host_gives_up_on_a_line_that_damages_too_much(desk):
    with pytest.raises(hw.InputError) as caught:
        load_over_a_noisy_line(desk, bytes_per_error=20, seed=1)
    assert str(caught.value) == NO_ANSWER


def test_a_host_gives_up_on_a_board_that_is_silent():
    class Silent:
        def write(self, data):
            pass

        def read(self):
            return b""

    with pytest.raises(hw.InputError) as caught:
        Board(Silent())
    assert str(caught.value) == NO_ANSWER


def test_a_program_that_has_no_room_is_refused(desk):
    board = object.__new__(Board)  # without a port, which is not reached
    board.sizes = replace(desk.sizes, synapses=16)
    with pytest.raises(hw.TargetError) as caught:
        board.load(desk.core)
    need = desk.core.needs.synapses
    assert str(caught.value) == (
        f"program {desk.program.name!r}: the open core has no room on this board for its synapses "
        f"({need} against 16). Simulate it instead."
    )


def test_each_problem_has_a_text():
    assert len(PROBLEMS) == NO_PROGRAM + 1


@pytest.mark.parametrize(
    ("welcome", "version"),
    [(b"\1\0" + bytes(30), "1"), (b"\4\0" + bytes(40), "4"), (b"", "none")],
    ids=["old", "new", "empty"],
)
def test_a_board_with_another_version_of_the_protocol_is_refused(welcome, version):
    class OtherVersion:
        def write(self, data):
            self.reply = framed(WELCOME, 0, welcome)

        def read(self):
            return self.reply

    with pytest.raises(hw.InputError) as caught:
        Board(OtherVersion())
    assert str(caught.value) == (
        f"board: it speaks another version of the protocol (got {version} against 3). "
        "Build the bitstream again, with this version."
    )
