"""How many cycles the core takes for a recording, to the last one, from its events and spikes.

It follows words and requests rather than clock edges; the modules of the same names say what happens in each cycle.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from hw_model.rtl.images import BITMAP_BITS, CoreProgram
from hw_model.values import ByteArray

TICK, END, LAST = -1, -2, -3
"""Words that are not sources: a step is over; the stream is, and silent steps may follow; the phase is."""
Word = tuple[int, int]
"""Cycles from the word before it to its own, at least, and its source or kind."""


def core_cycles(core: CoreProgram, recording: ByteArray, spikes: Mapping[str, ByteArray]) -> int:
    """Return the cycles from the first accepted word (cycle 0) to the class.

    ``recording`` (rows, channels); ``spikes[population]`` (steps, n), as a simulation gives them.
    """
    clock = _Clock(np.maximum(np.diff(core.lists), 1).tolist(), core.first_source)
    for phase, words in ((core.direct, _streamed), (core.turned, _transposed)):
        if phase is not None:
            clock.play(words(core, recording), *_fired(core, phase.name, spikes))
        elif words is _streamed:
            clock.play(words(core, recording), range(0), [])
    return clock.consumed + _readout(core) + 2


class _Clock:
    """Cycles so far: when the last word was ``prepared`` and ``consumed``, and when words are taken again (``row``).

    ``walk``, ``walked``: the first cycle of the last list's walk, and the one after it. ``lengths``: cycles of each.
    """

    def __init__(self, lengths: list[int], first_source: int) -> None:
        self.lengths, self.first_source = lengths, first_source
        self.prepared = self.consumed = -1
        self.row = 0
        self.walk = self.walked = -3

    def play(self, words: Iterator[Word], compartments: range, steps: list[list[int]]) -> None:
        """Play the words of a phase to its ``compartments``; ``steps``: those that fire, in order."""
        step = iter(steps)
        for wait, word in words:
            self.prepared = max(self.prepared + wait, self.consumed)
            earliest = max(self.prepared + 1, self.row)
            if word >= 0:
                self.consumed = self._request(earliest, word)
            elif word == TICK:
                # The last charge is handed on three cycles after the walk of its list.
                self.consumed = max(earliest, self.walked + 3)
                self.row = self._update(self.consumed + 1, compartments, next(step, []))
            else:
                self.consumed = self.prepared if word == END else max(earliest, self.walked + 3)
        self.prepared = self.consumed
        self.row = self.consumed + 1

    def _request(self, cycle: int, source: int) -> int:
        """Deliver a spike; return when its request is accepted: the lookup before it must be done."""
        accepted = max(cycle, self.walk - 1)
        self.walk = max(accepted + 2, self.walked)
        self.walked = self.walk + self.lengths[source]
        return accepted

    def _update(self, first: int, compartments: range, fired: list[int]) -> int:
        """Update from cycle ``first`` on, and deliver the spikes; return the cycle in which words are taken again."""
        issued = first + len(compartments)
        accepted = issued - 1
        for number in fired:
            # It is the head of the queue ten cycles after its issue.
            head = first + number - compartments.start + 10
            accepted = self._request(max(head, accepted + 1), self.first_source + number)
        return max(issued + 8 if compartments else issued, accepted + 1) + 1


def _fired(core: CoreProgram, phase: str, spikes: Mapping[str, ByteArray]) -> tuple[range, list[list[int]]]:
    """Return the compartments of a phase, and those that fire in each step, in the order of their updates."""
    first, end = (0, core.ends[0]) if core.direct and phase == core.direct.name else core.ends
    fired = np.zeros((core.length[phase], end - first), dtype=bool)
    for name, columns in core.program.columns_of(phase).items():
        if name in spikes:
            fired[:, core.numbers[phase][columns] - first] = spikes[name]
    return range(first, end), [(first + np.flatnonzero(row)).tolist() for row in fired]


def _streamed(core: CoreProgram, recording: ByteArray) -> Iterator[Word]:
    heard = recording[: core.heard]
    for row in heard:
        yield from ((1, channel) for channel in np.flatnonzero(row).tolist())
        yield 1, TICK
    yield 1, END
    yield from [(1, TICK)] * (core.heard - len(heard))
    yield 1, LAST


def _transposed(core: CoreProgram, recording: ByteArray) -> Iterator[Word]:
    """Yield words as the scan of the buffer finds them: three cycles for a visit, one for every word of 32 steps."""
    assert core.turned is not None
    visits = list(zip(*(column.tolist() for column in core.tables["visits"].values()), strict=True))
    wait, at = 3, 0
    for step in range(core.length[core.turned.name]):
        while at < len(visits) and visits[at][0] == step:
            _, place, source = visits[at]
            read, wait = 0, wait + 2
            for row in np.flatnonzero(recording[: core.kept, place >> core.row_shift]).tolist():
                yield wait + row // BITMAP_BITS + 1 - read, source + row
                read, wait = row // BITMAP_BITS + 1, 1
            wait += core.row_words - read + 3
            at += 1
        yield wait, TICK
        wait = 2
    yield wait, LAST


def _readout(core: CoreProgram) -> int:
    """Return the cycles of the readout: a bit of a weight per cycle."""
    readout, weights = core.program.readout, core.tables["weights"]["magnitude"].tolist()
    of_class = sum(3 + weight.bit_length() for weight in weights) + 1
    return core.program.populations[readout.populations[0]] * of_class if readout else 0
