"""What each measure saves against the core without it, from counted cycles and accesses, for the page's table of savings.

No second core is built: a measure saves accesses, clock ticks or area, and these are counted and priced.
"""

from dataclasses import replace

import gates
import memories
import numpy as np
import picojoules
import plans
import runs
import traffic
from latches import Latches

import hw_model as hw
from hw_model.rtl.images import CoreProgram, layouts


def savings(
    built: runs.Built, played: gates.Activity, spent: picojoules.Energy
) -> list[tuple[str, float]]:
    """Return what each measure saves, in microjoules per recording, against the core without it."""
    traffic, files = runs.traffic_of(), built.files
    counts = hw.simulate(
        runs.compiled("objects-hybrid-loihi"), runs.real("Objects", "train", count=4), probe=()
    ).counts
    # Accesses were counted on training recordings, the page is about test recordings: scale by synaptic operations.
    scale = played.answers[:, 2].mean() / (counts.synaptic_ops / 4)
    cycles = played.answers[:, 4:7].sum(axis=1).mean()
    clock_pj = float(spent.of("clock").mean())
    latch_count = len([i for i in built.circuit.order if files.cells[i.type].kind == "latch"])
    gating_pj = _pj_of_a_tick(built) * len(built.circuit.flops) * cycles - clock_pj
    macro_pj = latch_pj = packing_pj = 0.0
    states, state_traffic = (
        next(c for c in built.chosen if c.shape.name == "states"),
        traffic["states"],
    )
    assert isinstance(states, memories.Choice)
    lazy_pj = (counts.neuron_updates / 4 - state_traffic.reads) * states.read_pj
    lazy_pj += (counts.neuron_updates_active / 4 - state_traffic.writes) * states.write_pj
    for choice in built.chosen:
        memory = traffic[choice.shape.name]
        # Macros, which do not answer at once, would need the pipeline of an FPGA.
        in_macros_only = replace(memory, at_once=False)
        macros = [c for c in plans.options(files, in_macros_only) if isinstance(c, memories.Choice)]
        if isinstance(choice, Latches):
            cheapest = min(
                macros, key=lambda c: plans.cost(files, c, memory) + plans.PRICE * c.area
            )
            macro_pj, latch_pj = (
                macro_pj + plans.cost(files, cheapest, memory),
                latch_pj + plans.cost(files, choice, memory),
            )
        else:
            smallest = min((c for c in macros if c.pack == 1), key=lambda c: c.area)
            packing_pj += plans.cost(files, smallest, memory) - plans.cost(files, choice, memory)
    return [
        (
            "targets stored as distances from the one before, 24 bits for two synapses instead of 40",
            narrower(files) * scale / 1e6,
        ),
        (
            "clock gating: of modules, of registers with an enable, and of groups of eight bits in which none changes",
            gating_pj / 1e6,
        ),
        (
            f"latches in place of macros for the smallest memories ({latch_count:,} bits)",
            (macro_pj - latch_pj) * scale / 1e6,
        ),
        (
            "shallow banks and words packed into rows, in place of the least area",
            packing_pj * scale / 1e6,
        ),
        (
            "states that are read and written only where the next step depends on them",
            lazy_pj * scale / 1e6,
        ),
    ]


def narrower(files: runs.Library) -> float:
    """Return picojoules per recording that storing distances of targets saves, although lists then have more words."""
    memory, core_full_targets = (
        runs.traffic_of()["synapses"],
        replace(runs.OURS, sizes=replace(runs.OURS.sizes, step=0, places=0)),
    )
    share_of_words = 1 / (1 + fillers())
    rows = {pack: row_reads * share_of_words for pack, row_reads in memory.rows.items()}
    full_targets = replace(
        memory,
        bits=layouts(core_full_targets.sizes)["synapses"].width,
        reads=memory.reads * share_of_words,
        rows=rows,
    )

    def least(memory: traffic.Memory, core: runs.Core) -> float:
        made = plans.options(files, memory, core)
        return plans.cost(
            files,
            min(made, key=lambda c: plans.cost(files, c, memory) + plans.PRICE * c.area),
            memory,
        )

    return least(full_targets, core_full_targets) - least(memory, runs.OURS)


def fillers() -> float:
    """Return how many more words the lists of Objects take with distances of targets, as a share of those with full targets.

    A distance that is too large for its field takes a word without a synapse, a filler.
    """
    program = runs.compiled("objects-hybrid-loihi")
    with_distances, with_targets = (
        CoreProgram(program, 250, sizes=sizes) for sizes in (runs.OURS.sizes, None)
    )
    return float(with_distances.lengths.sum() / with_targets.lengths.sum() - 1)


def _pj_of_a_tick(built: runs.Built) -> float:
    """Return picojoules that a cycle costs in the clock pin of a flip-flop, with its share of the modelled tree."""
    found = built.circuit
    toggles, one_cycle = np.zeros((found.nets, 1)), np.ones(1)
    toggles[[found.at(flop, "CLK") for flop in found.flops]] = 1
    flops_only = replace(
        found, order=[], gates={net: gate for net, gate in found.gates.items()}, memories=[]
    )
    energy = picojoules.measure(
        flops_only,
        built.files.cells,
        built.files.macros,
        built.times["modelled"],
        toggles,
        one_cycle,
        np.zeros((0, 2, 1)),
        tree=True,
    )
    return float(energy.of("clock")[0]) / len(found.flops)
