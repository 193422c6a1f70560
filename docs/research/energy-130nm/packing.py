"""Lists of synapses against dense rows of weights: bits, area and energy of the memory, from a program and its spikes.

A word of a dense row holds the weights of 4 or 8 compartments that follow each other; the axon gives their exponent. This is
the best case for dense rows: groups of compartments without a synapse take no word, and the cost of finding them is not counted.
"""

from dataclasses import replace

import numpy as np
import plans
import runs
from page_text import table
from sums import sent_by

import hw_model as hw
from hw_model.rtl.images import CoreProgram

ROWS = (4, 8)
"""Weights in a word of a dense row."""
WEIGHT_BITS = 9
"""Bits of a weight with its sign, as in a list."""


def packing(files: runs.Library) -> str:
    """Return the table: the lists of the core, dense rows in the core's order of compartments, and rows that are all full."""
    program = runs.compiled("objects-hybrid-loihi")
    recordings = runs.real("Objects", "train", count=4)
    core = CoreProgram(program, recordings.shape[1], sizes=runs.OURS.sizes)
    simulated = hw.simulate(program, recordings, probe=("spikes",))
    sends_of_source = sum(
        sent_by(core, recordings[i], simulated, i) for i in range(len(recordings))
    ) / len(recordings)
    lists = runs.traffic_of()["synapses"]
    layouts = [
        (
            "lists of two synapses (this core)",
            core.lengths,
            lists.bits - len(plans.zero("synapses", core.sizes)),
        )
    ]
    for row in ROWS:
        layouts += [
            (f"rows of {row} weights", dense(core, row), row * WEIGHT_BITS),
            (f"rows of {row} weights, all full", full(core, row), row * WEIGHT_BITS),
        ]
    table_rows = []
    for what, words, bits in layouts:
        word_count, words_read = int(words.sum()), float(sends_of_source @ words)
        memory = replace(
            lists,
            name="rows",
            words=word_count,
            bits=bits,
            reads=words_read,
            rows={pack: words_read for pack in (2, 4, 8)},
        )
        if words is core.lengths:
            memory = replace(lists, words=word_count)
        choice = min(
            plans.options(files, memory, replace(runs.OURS, held={})),
            key=lambda one: plans.cost(files, one, memory) + plans.PRICE * plans.area(files, one),
        )
        uj, mm2 = plans.cost(files, choice, memory) / 1e6, plans.area(files, choice) / 1e6
        table_rows.append(
            (
                what,
                f"{word_count * bits / 1000:.0f}",
                f"{words_read * bits / 1e6:.2f}",
                f"{mm2:.2f}",
                f"{uj:.2f}",
            )
        )
    return table(
        ("synapses are kept as", "kbit", "Mbit read per recording", "mm2", "µJ per recording"),
        table_rows,
    )


def dense(core: CoreProgram, row: int) -> np.ndarray:
    """Return the words of dense rows for each source (sources,), with compartments in the order of the core."""
    synapses = core._synapses()
    groups = (
        synapses["source"],
        synapses["exponent"],
        core.numbering.places(synapses["target"]) // row,
    )
    return np.bincount(np.unique(groups, axis=1)[0], minlength=len(core.starts))


def full(core: CoreProgram, row: int) -> np.ndarray:
    """Return the fewest words that each source needs (sources,): those if its targets followed each other without a gap."""
    synapses = core._synapses()
    (source, _), many = np.unique(
        (synapses["source"], synapses["exponent"]), axis=1, return_counts=True
    )
    return np.bincount(source, weights=-(-many // row), minlength=len(core.starts)).astype(np.int64)
