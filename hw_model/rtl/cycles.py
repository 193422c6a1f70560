"""How many cycles the core takes for a recording, to the last one, from its events and spikes.

It follows words and requests rather than clock edges; the modules of the same names say what happens in each cycle.
"""

from collections import deque
from collections.abc import Iterator, Mapping

import numpy as np

from hw_model.rtl.images import CoreProgram
from hw_model.rtl.phases import CorePhase
from hw_model.values import BoolArray, ByteArray

# Words that are not sources.
TICK = -1
"""A step is over."""
END = -2
"""The stream is over, and silent steps may follow."""
LAST = -3
"""The phase is over."""
DROPPED = -4
"""A word after the last step of the first phase."""
HIDDEN = -5
"""An event of a row that a visit does not tell of."""
AGAIN = -6
"""Instead of cycles: a source is what the event before it is in the second phase."""
NEVER = 1 << 62
Word = tuple[int, int]
"""Cycles from the word before it to its own, at least, and its source or kind."""


def core_cycles(core: CoreProgram, recording: ByteArray, spikes: Mapping[str, ByteArray]) -> int:
    """Return the cycles from the first accepted word (cycle 0) to the class.

    ``recording`` (rows, channels); ``spikes[population]`` (steps, n), as a simulation gives them.
    """
    clock = _Clock(np.maximum(core.lengths, 1).tolist(), core.first_source)
    for index, (phase, end) in enumerate(zip(core.phases, core.ends, strict=True)):
        compartments = range(core.ends[index - 1] if index else 0, end)
        numbers = np.sort(core.numbers[phase.name])
        fired = [numbers[row].tolist() for row in fired_in_order(core, phase, recording, spikes)]
        words = transposed_words(core, phase, recording) if index else _streamed(core, recording)
        clock.play(words, compartments, fired)
    return clock.consumed + readout_cycles(core) + 2


def predicted_cycles(
    core: CoreProgram, recordings: ByteArray, spikes: Mapping[str, ByteArray]
) -> list[int]:
    """Return the cycles of each recording of a batch; see :func:`core_cycles`."""
    cycles = []
    for i, recording in enumerate(recordings):
        of_recording = {name: of_batch[i] for name, of_batch in spikes.items()}
        cycles.append(core_cycles(core, recording, of_recording))
    return cycles


class _Clock:
    """Cycles so far: when the last word was ``prepared`` and ``consumed``, and when words are taken again (``row``).

    ``open``: when events are, which do not wait for the ``spikes`` of the step before them, each with the cycle in
    which it is the head of the queue; ``accepted``: when the last of them was delivered. ``walk``, ``walked``: the
    first cycle of the last list's walk, and the one after it. ``lengths``: cycles of each.
    """

    def __init__(self, lengths: list[int], first_source: int) -> None:
        self.lengths = lengths
        self.first_source = first_source
        self.prepared = -1
        self.consumed = -1
        self.row = 0
        self.open = 0
        self.accepted = 0
        self.spikes: deque[tuple[int, int]] = deque()
        self.walk = -3
        self.walked = -3

    def play(self, words: Iterator[Word], compartments: range, steps: list[list[int]]) -> None:
        """Play the words of a phase to its ``compartments``; ``steps``: those that fire, in order."""
        fired = deque(steps)
        for wait, word in words:
            if wait == AGAIN:
                earliest = max(self.prepared + 4, self.consumed + 2)
                self._deliver(earliest)
                self.consumed = self._request(earliest, word)
                continue
            self.prepared = max(self.prepared + wait, self.consumed + 1)
            if word == HIDDEN:
                continue
            if word >= 0:
                earliest = max(self.prepared + 1, self.open)
                self._deliver(earliest)
                self.consumed = self._request(earliest, word)
                continue
            self._deliver(NEVER)
            earliest = max(self.prepared + 1, self.row)
            # The last charge is handed on two cycles after the walk of its list.
            all_charged = max(earliest, self.walked + 2)
            if word == TICK:
                self.consumed = all_charged
                self._update(self.consumed + 1, compartments, fired.popleft())
                if not fired:
                    self.open = NEVER
            elif word == DROPPED:
                self.consumed = earliest
            elif word == END:
                self.consumed = self.prepared
            else:
                self.consumed = all_charged
        self.prepared = self.consumed
        self.row = self.open = self.consumed + 1

    def _request(self, cycle: int, source: int) -> int:
        """Deliver a spike; return when its request is accepted: the walk before it must have begun."""
        accepted = max(cycle, self.walk)
        self.walk = max(accepted + 2, self.walked)
        self.walked = self.walk + self.lengths[source]
        return accepted

    def _deliver(self, earliest: int) -> None:
        """Deliver the spikes that are heads of the queue before an event is taken, which is not before ``earliest``."""
        while self.spikes and max(self.spikes[0][0], self.accepted + 2) <= max(earliest, self.walk):
            head, source = self.spikes.popleft()
            self.accepted = self._request(max(head, self.accepted + 2), source)
            self.row = max(self.row, self.accepted + 2)

    def _update(self, first: int, compartments: range, fired: list[int]) -> None:
        """Update from cycle ``first`` on. What fires is the head of the queue 11 cycles after its issue.

        Heads are looked up from five cycles before the end of the updates on.
        """
        self.open = first + len(compartments)
        for number in fired:
            head = max(self.open - 5, first + number - compartments.start + 11)
            self.spikes.append((head, self.first_source + number))
        self.row = self.open + (8 if compartments else 0) + 1


def fired_in_order(
    core: CoreProgram, phase: CorePhase, recording: ByteArray, spikes: Mapping[str, ByteArray]
) -> BoolArray:
    """Return which compartments of a phase fire in its steps, (steps, n), in the order of their updates."""
    span = phase.span(recording)
    numbers = core.numbers[phase.name]
    fired = np.zeros((len(span), len(numbers)), dtype=np.bool_)
    for name, columns in core.program.columns_of(phase.name).items():
        if name in spikes:
            fired[:, columns] = spikes[name][span.start : span.stop]
    return fired[:, np.argsort(numbers)]


def _streamed(core: CoreProgram, recording: ByteArray) -> Iterator[Word]:
    """Yield words as the stream brings them, one per cycle at most."""
    heard = recording[: core.heard]
    steps = core.phases[0].steps

    def unless_late(step: int, word: int) -> Word:
        return 1, word if step < steps else DROPPED

    for step, row in enumerate(heard):
        for channel in np.flatnonzero(row).tolist():
            yield unless_late(step, channel)
            if core.later and step < core.kept:
                yield AGAIN, int(core.tables["visits"]["source"][channel]) + step
        yield unless_late(step, TICK)
    yield 1, END
    for step in range(len(heard), core.heard):
        yield unless_late(step, TICK)
    yield 1, LAST


def transposed_words(core: CoreProgram, phase: CorePhase, recording: ByteArray) -> Iterator[Word]:
    """Yield words as the scan of the buffer finds them.

    A channel of a row takes a cycle, a visit four and one for every word of its rows.
    """
    visits = [] if core.later else phase.visits.T.tolist()
    origin = phase.origin(recording)
    wait, at = core.swept + 10 + 5, 0  # charges are swept and the fields of the phase read first
    for step in phase.span(recording):
        if phase.by_rows:
            read = 0
            wait = wait + 3
            for channel in np.flatnonzero(recording[step : step + 1].any(axis=0)).tolist():
                yield wait + channel - read, phase.row_source + channel
                read, wait = channel, 0
            wait += core.channels - read
        while at < len(visits) and visits[at][0] == step:
            _, channel, source = visits[at]
            read = 0
            wait = wait + 2
            for row in np.flatnonzero(recording[: core.kept, channel]).tolist():
                shown = 0 <= row - origin < phase.rows
                yield (
                    wait + row // core.word + 1 - read,
                    source + (row - origin >> phase.shared) if shown else HIDDEN,
                )
                read = row // core.word + 1
                wait = 1
            wait += core.row_words - read + 2
            at += 1
        yield wait, TICK
        wait = 2
    yield wait, LAST


def readout_cycles(core: CoreProgram) -> int:
    """Return the cycles of the readout: a bit of a weight per cycle."""
    readout = core.program.readout
    if not readout:
        return 0
    classes = core.program.populations[readout.populations[0]]
    weights = core.tables["weights"]["magnitude"].tolist()
    cycles_of_class = sum(3 + weight.bit_length() for weight in weights) + 2
    return int(classes * cycles_of_class)
