"""Bound the cycles of the open core for any recording with at most so many events per step.

:mod:`hw_model.rtl.cycles` predicts the cycles of a recording word by word. A word is an event, the
end of a step or the end of a phase; a spike walks its list of synapses. Let F be the last cycle in
which a word was prepared, consumed or accepted, or a spike became the head of the queue, and W the
first cycle after the walk of the last list. Then every word moves max(F + 4, W) forward by no more
than

    an event, or a spike from the queue    wait + max(2, its list)
    the event again, for a second phase    2 + max(2, its list)
    the end of a step                      wait + its compartments + 16
    the end of a phase                     wait + 8

where the wait is 1 in the stream and for a spike. A scan of the buffer waits as long as for an
empty one, and one cycle more for each event. So the sum over all words is a bound, whatever their
order. The bound of a number of events per step takes the events that cost most.
"""

from functools import lru_cache

import numpy as np

from hw_model.accounting.worst_case import WorstCase, buffered_events, dearest_first, of_dearest
from hw_model.program.chip_program import ChipProgram
from hw_model.range_proof import can_spike
from hw_model.rtl.cycles import readout_cycles, transposed_words
from hw_model.rtl.device import on_core
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.phases import CorePhase
from hw_model.values import FloatArray, Frozen, IntArray

# All are cycles, and follow from what the clock of hw_model/rtl/cycles.py adds.
_LEAST = 2
"""The least cycles of an event or spike, however short its list: requests follow each other two
cycles apart."""
_WAIT = 1
"""The wait of an event in the stream and of a spike from the queue, and what an event adds to a
scan."""
_WAIT_AGAIN = 2
"""The wait of an event that is requested again, for the second phase."""
_END_OF_STEP = 16
"""2 until the last charge is added, 1 to the first update, 10 more from the last update until its spike is the head of
the queue, and the 4 of F + 4: 17, one of which is the wait."""
_END_OF_PHASE = 8
"""Enough for 2 until the last charge is added, and the 4 of F + 4: nothing is updated."""
_END_OF_STREAM = 1
"""The word that ends a recording is taken as soon as it is prepared."""
_AFTER_READOUT = 2
"""From the end of the readout to the answer."""


class CoreCosts(Frozen, eq=False):
    """The most that the parts of a recording can cost, in cycles.

    - ``rows``: rows (steps of a recording) that the core takes
    - ``row_events`` (channels + 1,): the dearest events of a row as it arrives, by how many there are
    - ``row_end``: the end of a row, and ``row_spikes``: the spikes of its step
    - ``first_spikes``: spikes of the first phase over all its steps
    - ``later``: all phases after the first, without the events that they read
    - ``later_events`` (channels + 1,): what the dearest events of all rows cost these phases, by how
      many a row has
    - ``queued``: the most spikes in the queue
    """

    rows: int
    row_events: FloatArray
    row_end: int
    row_spikes: int
    first_spikes: int
    later: int
    later_events: FloatArray
    queued: int

    def row(self, events_per_step: int) -> float:
        """Return the cycles of a row."""
        return float(of_dearest(self.row_events, events_per_step)) + self.row_end + self.row_spikes

    def after_rows(self, events_per_step: int) -> float:
        """Return the cycles from the end of the stream to the class."""
        return self.later + float(of_dearest(self.later_events, events_per_step))

    def recording(self, events_per_step: int) -> float:
        """Return the cycles of a recording."""
        of_row = float(of_dearest(self.row_events, events_per_step)) + self.row_end
        return self.rows * of_row + self.first_spikes + self.after_rows(events_per_step)


def worst_case_on_core(program: ChipProgram, rows: int, events_per_step: int) -> WorstCase:
    """Bound the cycles of recordings of ``rows`` rows on the open core of the program's chip."""
    costs = core_costs(on_core(program, rows, program.chip))
    clock_ghz = program.chip.clock_ghz
    row = costs.row(events_per_step)
    return WorstCase(
        events_per_step=events_per_step,
        slowest_step_ns=row / clock_ghz,
        answer_ns=(row + costs.after_rows(events_per_step)) / clock_ghz,
        recording_ns=costs.recording(events_per_step) / clock_ghz,
        queued_packets=costs.queued,
        buffered_events=buffered_events(program, rows, events_per_step),
    )


@lru_cache(maxsize=8)
def core_costs(core: CoreProgram) -> CoreCosts:
    """Return the costs of recordings of as many rows as ``core`` was made for.

    They are kept for the last few cores, which are told apart by identity.
    """
    first, *others = core.phases
    later = _END_OF_STREAM + _END_OF_PHASE + readout_cycles(core) + _AFTER_READOUT
    later_events = np.zeros((core.channels, core.kept))
    for index, phase in enumerate(others, start=1):
        later += _scan_cycles(core, phase) + _END_OF_PHASE
        later += phase.steps * (_compartments(core, index) + _END_OF_STEP)
        later += _spike_cycles(core, phase)
        later_events += _read_cycles(core, phase)
    queued = max(len(_spiking_lists(core, phase)) for phase in core.phases)
    row_events = _event_cycles(core)
    return CoreCosts(
        rows=core.heard,
        row_events=dearest_first(row_events),
        row_end=_WAIT + _compartments(core, 0) + _END_OF_STEP,
        row_spikes=int((_WAIT + _walk_cycles(_spiking_lists(core, first))).sum()),
        first_spikes=_spike_cycles(core, first),
        later=later,
        later_events=dearest_first(later_events).sum(axis=1),
        queued=queued,
    )


def _compartments(core: CoreProgram, index: int) -> int:
    """Return how many numbers are updated in a step of a phase, gaps included."""
    before = core.ends[index - 1] if index else 0
    return int(core.ends[index]) - int(before)


def _walk_cycles(lengths: IntArray) -> IntArray:
    """Return the cycles of events or spikes whose lists have these lengths, without any wait."""
    return np.maximum(lengths, _LEAST)


def _event_cycles(core: CoreProgram) -> FloatArray:
    """Return the cycles of an event of each channel as it arrives, (channels,)."""
    cycles = (_WAIT + _walk_cycles(core.lengths[: core.channels])).astype(np.float64)
    if not core.later:
        return cycles
    # The second phase hears the event at once. Its source depends on the row: take the row that
    # costs most.
    sources = core.tables["visits"]["source"][: core.channels]
    for channel, source in enumerate(sources.tolist()):
        of_rows = core.lengths[source : source + core.kept]
        cycles[channel] += _WAIT_AGAIN + int(_walk_cycles(of_rows).max(initial=0))
    return cycles


def _spiking_lists(core: CoreProgram, phase: CorePhase) -> IntArray:
    """Return the length of the list of every compartment of a phase that can spike."""
    if not phase.name:
        return np.zeros(0, dtype=np.int64)
    spiking = can_spike(core.program, phase.name)
    numbers = core.numbers[phase.name][spiking]
    lengths: IntArray = core.lengths[core.first_source + numbers]
    return lengths


def _spike_cycles(core: CoreProgram, phase: CorePhase) -> int:
    """Return the cycles of a phase's spikes, at the rate that refractory times allow."""
    if not phase.name:
        return 0
    program = core.program
    spiking = can_spike(program, phase.name)
    refractory = program.by_column(phase.name, lambda part: part.setting("refractory"))[spiking]
    spikes = -(-phase.steps // np.maximum(refractory, 1))
    return int((spikes * (_WAIT + _walk_cycles(_spiking_lists(core, phase)))).sum())


def _scan_cycles(core: CoreProgram, phase: CorePhase) -> int:
    """Return the cycles of a phase that are spent waiting for words from an empty buffer."""
    recording = np.zeros((core.rows, core.channels), dtype=np.uint8)
    if phase.align_events is not None:
        recording[0] = 1  # the phase then begins with the first row, and so plays the most steps
    words = transposed_words(core, phase, recording)
    return sum(wait for wait, _ in words)


def _read_cycles(core: CoreProgram, phase: CorePhase) -> FloatArray:
    """Return what an event of each channel and row costs a later phase, (channels, rows)."""
    cycles = np.zeros((core.channels, core.kept))
    if phase.by_rows:
        lists = core.lengths[phase.row_source : phase.row_source + core.channels]
        cycles += _walk_cycles(lists)[:, None]
    if core.later:
        return cycles
    shown_rows = np.arange(min(phase.rows, core.kept)) >> phase.shared
    for _, channel, source in phase.visits.T.tolist():
        cycles[channel] += _WAIT
        cycles[channel, : len(shown_rows)] += _walk_cycles(core.lengths[source + shown_rows])
    return cycles
