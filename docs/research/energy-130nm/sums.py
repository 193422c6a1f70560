"""Accesses of the core's memories and what they cost, from the simulator's spikes and the chip file: no hardware, no library.

This is an independent check of the gate-level energies of memories: it uses neither RTL nor netlist. The chip file says in its
comments which macros a memory is made of and what an access of each costs.
"""

import re
from dataclasses import asdict
from pathlib import Path

import numpy as np

import hw_model as hw
from hw_model.rtl.images import CoreProgram, Sizes, layouts

CHIP = Path(__file__).parents[3] / "hw_model/chips/locsnn-130nm.yaml"
OWN: dict[str, set[str]] = {"leaks": set(), "fires": {"parent", "entry"}}
"""Memories of constants, and their fields that are read for each compartment. The other fields are not read again if they equal
those of the compartment two before."""
_MEMORY = re.compile(r"^#   (\w+) +(\d+) x \((.+?)\)(?:, (\d) words a row)?$", re.M)
_FIGURE = re.compile(r"_(\dP)_(\d+x\d+)_\S*: read ([\d.]+) \(line \d+\), write ([\d.]+)")


def prices(text: str) -> dict[str, tuple[int, float, float]]:
    """Return, for every memory of macros in the chip file: words in a row, and picojoules of reading a row and writing a word."""
    figures = {
        f"{ports} {size}": (float(read), float(write))
        for ports, size, read, write in _FIGURE.findall(text)
    }
    price_of_memory = {}
    for name, _, row, pack in _MEMORY.findall(text):
        if row.endswith("latches"):
            continue
        figures_of_row = [figures[macro] for macro in row.split(" + ")]
        price_of_memory[name] = (
            int(pack or 1),
            sum(read for read, _ in figures_of_row),
            sum(write for _, write in figures_of_row),
        )
    return price_of_memory


def memory_pj(program: hw.ChipProgram, recordings: np.ndarray) -> np.ndarray:
    """Return picojoules in macros of every recording, (recordings,); ``recordings`` (batch, steps, channels)."""
    text = CHIP.read_text("utf-8")
    of = prices(text)
    found = hw.simulate(program, recordings, probe=("spikes", "u", "v"))
    core = CoreProgram(program, recordings.shape[1], sizes=hw.chip("locsnn-130nm").open_core)
    return np.array([
        sum(rows * of[name][1] + words * of[name][2] for name, (rows, words) in one.items() if name in of)
        for one in (accesses(core, recordings[i], found, i, of) for i in range(len(recordings)))
    ])  # fmt: skip


def sent_by(
    core: CoreProgram, recording: np.ndarray, found: hw.SimulationResult, i: int
) -> np.ndarray:
    """Return how often each source sends, (sources,), in ``recording`` (steps, channels), which is number ``i`` of ``found``.

    Sources are, in this order: channels for the first phase, rows that later phases visit by channel, and compartments.
    """
    sent = np.zeros(len(core.starts))
    sent[: recording.shape[1]] += recording[: core.phases[0].steps].sum(axis=0)
    for channel, source in zip(
        core.tables["visits"]["channel"], core.tables["visits"]["source"], strict=True
    ):
        sent[source + np.flatnonzero(recording[: core.kept, channel])] += 1
    for phase in core.phases:
        for name, columns in core.program.columns_of(phase.name).items():
            if name in found.spikes:
                sent[core.first_source + core.numbers[phase.name][columns]] += found.spikes[name][
                    i
                ].sum(axis=0)
    return sent


def accesses(
    core: CoreProgram, recording: np.ndarray, found: hw.SimulationResult, i: int, of: dict
) -> dict:
    """Return rows read and words written of every memory for one recording."""
    counts, sizes = found.per_recording[i], hw.chip("locsnn-130nm").open_core
    sent = sent_by(core, recording, found, i)
    charges_taken = parents = 0
    states = np.zeros(2, dtype=np.int64)
    constants = core.tables["compartments"]
    assert not constants["blocks"].any()
    for phase in core.phases:
        numbers = core.numbers[phase.name]
        parents += int(constants["has_children"][numbers].sum()) * phase.steps
        for name, columns in core.program.columns_of(phase.name).items():
            numbers_here = numbers[columns]
            # A charge that is not 0 is set to 0 when it is taken. It was not 0 if the current is more than what decay left of it.
            u = found.u[name][i].astype(np.int64)
            before = np.vstack((np.zeros_like(u[:1]), u[:-1]))
            u_decayed = np.sign(before) * (np.abs(before) * constants["keep_u"][numbers_here] >> 12)
            charges_taken += np.count_nonzero(u != u_decayed)
            # A state is written if the next step depends on it, and then read in that step. The state of the first compartment
            # of a sweep is always read; so is the second's if the first is the last of a group of 8 that share a word of
            # at_rest.sv.
            lasts = (constants["keep_u"][numbers_here] | constants["keep_v"][numbers_here]) != 0
            kept = lasts & ((u != 0) | (found.v[name][i] != 0))
            first = numbers.min()
            group_ends = not sizes.places and first % 8 == 7
            reads = kept[:-1] | (numbers_here == first) | ((numbers_here == first + 1) & group_ends)
            states += [np.count_nonzero(reads), np.count_nonzero(kept)]
    # Rows of `pack` words that each list touches.
    starts, ends = core.starts, core.starts + core.lengths
    pack = of["synapses"][0]
    rows = np.where(ends > starts, (ends - 1) // pack - starts // pack + 1, 0)
    lists_read, updates = sent.sum(), counts.neuron_updates
    entries = int(constants["read_out"].sum())
    read_out = sum(
        int(constants["read_out"][core.numbers[p.name]].sum()) * p.steps for p in core.phases
    )
    events, visits = counts.input_events, len(core.tables["visits"]["step"])
    accesses_of_memory = {
        "axons": (lists_read / of["axons"][0], 0),
        "synapses": (sent @ rows, 0),
        "charges": (
            counts.synaptic_ops + updates,
            counts.synaptic_ops
            + charges_taken
            + sizes.slots * (sizes.places or sizes.compartments),
        ),
        "states": tuple(states),
        "sums": (parents, parents),
        "places": (counts.spikes, counts.spikes),
        "tallies": (read_out, entries + counts.spikes),
        "bitmap": (events + visits * (core.row_words + 1), events + sizes.bitmap),
        "visit_list": (visits, 0),
    }
    # Constants of compartments: fields of their own are read always, several words in a row; the others unless they repeat.
    for name, own in OWN.items():
        layout = layouts(Sizes(**asdict(hw.chip("locsnn-130nm").open_core)))[name]
        fields = [constants[field.name] for field in layout.fields if field.name not in own]
        begins = [0, *core.ends[:-1]]
        reads = sum(
            phase.steps * np.count_nonzero(_differs(fields, begin, end))
            for phase, begin, end in zip(core.phases, begins, core.ends, strict=True)
        )
        accesses_of_memory |= {
            f"{name}_same": (reads, 0),
            f"{name}_own": (updates / of.get(f"{name}_own", (1,))[0], 0),
        }
    return accesses_of_memory


def _differs(fields: list, begin: int, end: int) -> np.ndarray:
    """Return which compartments of a phase differ from the last but one, or are among the first of it or of 32."""
    number = np.arange(begin, end)
    first = (number < begin + 2) | (number % 32 < 2)
    return first | np.any(
        [field[number] != field[np.maximum(number - 2, 0)] for field in fields], axis=0
    )
