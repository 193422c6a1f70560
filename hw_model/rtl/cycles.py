"""Predict exactly how many cycles the core takes for a recording, from its events and spikes.

It follows words and requests rather than clock edges. Words are what the sequencer of the core
takes: events, the ends of steps, and the end of a phase; they come from the stream (event_input.sv)
or from the buffer of events (transpose.sv). Requests are spikes to deliver, whose lists of synapses
are walked (delivery.sv). Simulations of the SystemVerilog check that the prediction is right to the
last cycle, and its constants are those of the pipelines that these modules describe.
"""

from collections import deque
from collections.abc import Iterator, Mapping

import numpy as np

from hw_model.rtl.images import CoreProgram
from hw_model.rtl.phases import CorePhase
from hw_model.values import BoolArray, ByteArray

# What a word says where it is not the number of a source, which is 0 or more.
TICK = -1
"""The end of a step: its compartments are updated."""
END = -2
"""The end of the recording in the stream; silent steps may follow."""
LAST = -3
"""The end of the phase."""
DROPPED = -4
"""A word in a row after the last step of the first phase: it is taken without effect."""
HIDDEN = -5
"""An event of a row that the phase does not play: the buffer finds it, and drops it."""
AGAIN = -6
"""In place of the cycles of a word: its source is what the event before it is to the second phase.
"""
NEVER = 1 << 62
"""A cycle later than any other."""
Word = tuple[int, int]
"""The least number of cycles from the word before to this one, or ``AGAIN``; and a source, or what
else the word says."""


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
    # Two more cycles from the end of the readout to the answer.
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
    """The cycles in which the core did what it did last, moved on word by word.

    - ``prepared``, ``consumed``: when the last word was ready, and when the sequencer took it
    - ``events_open``: from when on events are taken; while compartments are on their way to fire,
      events of the next row are taken already
    - ``row_open``: from when on other words are taken, after all spikes of the step
    - ``spikes``: spikes of the step that wait for delivery, each with the cycle in which it can be
      the head of the queue
    - ``spike_accepted``: when the last of them was requested
    - ``walk_start``, ``walk_end``: the first cycle of the last list's walk, and the one after it
    - ``lengths``: the cycles of the walk of each source's list
    """

    def __init__(self, lengths: list[int], first_source: int) -> None:
        self.lengths = lengths
        self.first_source = first_source
        self.prepared = -1
        self.consumed = -1
        self.row_open = 0
        self.events_open = 0
        self.spike_accepted = 0
        self.spikes: deque[tuple[int, int]] = deque()
        # So long ago that the first request need not wait for it.
        self.walk_start = -3
        self.walk_end = -3

    def play(self, words: Iterator[Word], compartments: range, steps: list[list[int]]) -> None:
        """Play the words of a phase; ``steps`` lists the ``compartments`` that fire in each step."""
        fired = deque(steps)
        for wait, word in words:
            if wait == AGAIN:
                # arrivals.sv knows its source three cycles after the mark, which comes a cycle
                # after the word was accepted. Two requests are at least two cycles apart.
                earliest = max(self.prepared + 4, self.consumed + 2)
                self._deliver(earliest)
                self.consumed = self._request(earliest, word)
                continue
            self.prepared = max(self.prepared + wait, self.consumed + 1)
            if word == HIDDEN:
                continue  # it takes time to find, and never reaches the sequencer
            if word >= 0:
                earliest = max(self.prepared + 1, self.events_open)
                self._deliver(earliest)
                self.consumed = self._request(earliest, word)
                continue
            self._deliver(NEVER)  # all spikes that wait
            earliest = max(self.prepared + 1, self.row_open)
            # The last charge is handed on two cycles after the walk of its list.
            all_charged = max(earliest, self.walk_end + 2)
            if word == TICK:
                self.consumed = all_charged
                self._update(self.consumed + 1, compartments, fired.popleft())
                if not fired:
                    self.events_open = NEVER  # after the last step of a phase
            elif word == DROPPED:
                self.consumed = earliest
            elif word == END:
                self.consumed = self.prepared
            else:
                self.consumed = all_charged
        self.prepared = self.consumed
        self.row_open = self.consumed + 1
        self.events_open = self.row_open

    def _request(self, cycle: int, source: int) -> int:
        """Request the delivery of a spike, and return when the request is accepted.

        The walk of the list before must have begun by then. This walk begins two cycles after its
        request, which look the list up, and after the end of the walk before.
        """
        accepted = max(cycle, self.walk_start)
        self.walk_start = max(accepted + 2, self.walk_end)
        self.walk_end = self.walk_start + self.lengths[source]
        return accepted

    def _deliver(self, earliest: int) -> None:
        """Deliver the spikes that go before an event, whose earliest request is in ``earliest``.

        A spike goes before an event if it is the head of the queue by then. The next head follows
        two cycles after a pop.
        """
        while self.spikes:
            head, source = self.spikes[0]
            head = max(head, self.spike_accepted + 2)
            if head > max(earliest, self.walk_start):
                break
            self.spikes.popleft()
            self.spike_accepted = self._request(head, source)
            self.row_open = max(self.row_open, self.spike_accepted + 2)

    def _update(self, first: int, compartments: range, fired: list[int]) -> None:
        """Update the compartments, one per cycle, from cycle ``first`` on; ``fired`` fire.

        A compartment that fires is the head of the queue 11 cycles after its issue: 8 in the
        pipeline of update.sv, and 3 in queue.sv. Heads are requested from five cycles before the
        end of the updates on (``ending`` in locsnn_core.sv). Other words than events wait until the
        pipeline is empty, 8 cycles after the last issue, and a cycle more.
        """
        self.events_open = first + len(compartments)
        for number in fired:
            issue = first + number - compartments.start
            head = max(self.events_open - 5, issue + 11)
            self.spikes.append((head, self.first_source + number))
        self.row_open = self.events_open + (8 if compartments else 0) + 1


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
    """Yield the words of the first phase, as the stream brings them: at most one per cycle."""
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
    """Yield the words of a later phase, as the scan of the buffer (transpose.sv) finds them.

    A channel of a row takes a cycle; a visit takes four, and one for every word of its channel.
    ``wait`` sums the cycles since the last word, and ``read`` says how many channels of the row, or
    words of the channel, were looked at by then.
    """
    visits = [] if core.later else phase.visits.T.tolist()
    origin = phase.origin(recording)
    next_visit = 0
    # First, charges are swept (where phases share places), the fields of the phase are read in 10
    # cycles, and the scan goes through four states (FETCH to NEXT) and a register.
    wait = core.swept + 10 + 5
    for step in phase.span(recording):
        if phase.by_rows:
            read = 0
            wait += 3
            for channel in np.flatnonzero(recording[step : step + 1].any(axis=0)).tolist():
                yield wait + channel - read, phase.row_source + channel
                read = channel
                wait = 0
            wait += core.channels - read
        while next_visit < len(visits) and visits[next_visit][0] == step:
            _, channel, source = visits[next_visit]
            read = 0
            wait += 2
            for row in np.flatnonzero(recording[: core.kept, channel]).tolist():
                words_to_row = row // core.word + 1
                row_of_phase = row - origin
                is_played = 0 <= row_of_phase < phase.rows
                word = source + (row_of_phase >> phase.shared) if is_played else HIDDEN
                yield wait + words_to_row - read, word
                read = words_to_row
                wait = 1
            wait += core.row_words - read + 2
            next_visit += 1
        yield wait, TICK
        wait = 2
    yield wait, LAST


def readout_cycles(core: CoreProgram) -> int:
    """Return the cycles of the readout, which multiplies by a bit of a weight per cycle.

    readout.sv spends three cycles on a weight besides its bits, and two on comparing scores.
    """
    readout = core.program.readout
    if not readout:
        return 0
    classes = core.program.populations[readout.populations[0]]
    weights = core.tables["weights"]["magnitude"].tolist()
    cycles_of_class = sum(3 + weight.bit_length() for weight in weights) + 2
    return int(classes * cycles_of_class)
