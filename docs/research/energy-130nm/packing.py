"""Lists of synapses against dense rows of weights: bits, area and energy of the memory, from a program and its spikes.

A word of a dense row holds the weights of ``ROW`` compartments that follow each other; the axon tells its exponent. A
row is as long as it must be: groups without a synapse take no word, and finding them is not counted.
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
"""Of a weight with its sign, as in a list."""


def packing(files: runs.Library) -> str:
    """Return the table: the lists of the core, dense rows in its order of compartments, and rows that are all full."""
    program, recordings = runs.compiled("objects-hybrid-loihi"), runs.real("Objects", "train", 4)
    core = CoreProgram(program, recordings.shape[1], sizes=runs.OURS.sizes)
    found = hw.simulate(program, recordings, probe=("spikes",))
    sent = sum(sent_by(core, recordings[i], found, i) for i in range(len(recordings))) / len(
        recordings
    )
    lists = runs.traffic_of()["synapses"]
    read = [
        (
            "lists of two synapses (this core)",
            core.lengths,
            lists.bits - len(plans.zero("synapses", core.sizes)),
        )
    ]
    for row in ROWS:
        read += [
            (f"rows of {row} weights", dense(core, row), row * WEIGHT_BITS),
            (f"rows of {row} weights, all full", full(core, row), row * WEIGHT_BITS),
        ]
    rows = []
    for what, words, bits in read:
        held, often = int(words.sum()), float(sent @ words)
        memory = replace(
            lists,
            name="rows",
            words=held,
            bits=bits,
            reads=often,
            rows={pack: often for pack in (2, 4, 8)},
        )
        if words is core.lengths:
            memory = replace(lists, words=held)
        made = min(
            plans.options(files, memory, replace(runs.OURS, held={})),
            key=lambda one: plans.cost(files, one, memory) + plans.PRICE * plans.area(files, one),
        )
        uj, mm2 = plans.cost(files, made, memory) / 1e6, plans.area(files, made) / 1e6
        rows.append(
            (
                what,
                f"{held * bits / 1000:.0f}",
                f"{often * bits / 1e6:.2f}",
                f"{mm2:.2f}",
                f"{uj:.2f}",
            )
        )
    return table(
        ("synapses are kept as", "kbit", "Mbit read per recording", "mm2", "µJ per recording"), rows
    )


def dense(core: CoreProgram, row: int) -> np.ndarray:
    """Return the words of each source (sources,), with compartments in the order of the core."""
    synapses = core._synapses()
    groups = (
        synapses["source"],
        synapses["exponent"],
        core.numbering.places(synapses["target"]) // row,
    )
    return np.bincount(np.unique(groups, axis=1)[0], minlength=len(core.starts))


def full(core: CoreProgram, row: int) -> np.ndarray:
    """Return the least words of each source (sources,), as if its targets followed each other."""
    synapses = core._synapses()
    (source, _), many = np.unique(
        (synapses["source"], synapses["exponent"]), axis=1, return_counts=True
    )
    return np.bincount(source, weights=-(-many // row), minlength=len(core.starts)).astype(np.int64)
