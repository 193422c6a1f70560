"""What each measure saves against the core without it, from counted cycles and accesses."""

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
        runs.compiled("objects-hybrid-loihi"), runs.real("Objects", "train", 4), probe=()
    ).counts
    scale = played.answers[:, 2].mean() / (counts.synaptic_ops / 4)
    cycles = played.answers[:, 4:7].sum(axis=1).mean()
    clocked = float(spent.of("clock").mean())
    bits = len([i for i in built.circuit.order if files.cells[i.type].kind == "latch"])
    stopped = _pj_of_a_tick(built) * len(built.circuit.flops) * cycles - clocked
    in_macros = latched = flat = 0.0
    states, kept = next(c for c in built.chosen if c.shape.name == "states"), traffic["states"]
    assert isinstance(states, memories.Choice)
    lazy = (counts.neuron_updates / 4 - kept.reads) * states.read_pj
    lazy += (counts.neuron_updates_active / 4 - kept.writes) * states.write_pj
    for one in built.chosen:
        memory = traffic[one.shape.name]
        # Macros, which do not answer at once, would need the pipeline of an FPGA.
        in_turn = replace(memory, at_once=False)
        macros = [c for c in plans.options(files, in_turn) if isinstance(c, memories.Choice)]
        if isinstance(one, Latches):
            best = min(macros, key=lambda c: plans.cost(files, c, memory) + plans.PRICE * c.area)
            in_macros, latched = (
                in_macros + plans.cost(files, best, memory),
                latched + plans.cost(files, one, memory),
            )
        else:
            least = min((c for c in macros if c.pack == 1), key=lambda c: c.area)
            flat += plans.cost(files, least, memory) - plans.cost(files, one, memory)
    return [
        (
            "targets stored as distances from the one before, 24 bits for two synapses instead of 40",
            narrower(files) * scale / 1e6,
        ),
        (
            "clock gating: of modules, of registers with an enable, and of groups of eight bits in which none changes",
            stopped / 1e6,
        ),
        (
            f"latches in place of macros for the smallest memories ({bits:,} bits)",
            (in_macros - latched) * scale / 1e6,
        ),
        (
            "shallow banks and words packed into rows, in place of the least area",
            flat * scale / 1e6,
        ),
        (
            "states that are read and written only where the next step depends on them",
            lazy * scale / 1e6,
        ),
    ]


def narrower(files: runs.Library) -> float:
    """Return picojoules per recording that words of steps save, with the fillers among them."""
    memory, full = (
        runs.traffic_of()["synapses"],
        replace(runs.OURS, sizes=replace(runs.OURS.sizes, step=0, places=0)),
    )
    fewer = 1 / (1 + fillers())
    rows = {pack: many * fewer for pack, many in memory.rows.items()}
    wide = replace(
        memory, bits=layouts(full.sizes)["synapses"].width, reads=memory.reads * fewer, rows=rows
    )

    def least(memory: traffic.Memory, core: runs.Core) -> float:
        made = plans.options(files, memory, core)
        return plans.cost(
            files,
            min(made, key=lambda c: plans.cost(files, c, memory) + plans.PRICE * c.area),
            memory,
        )

    return least(wide, full) - least(memory, runs.OURS)


def fillers() -> float:
    """Return how many words more lists of Objects take as steps, as a share of those that tell targets in full."""
    program = runs.compiled("objects-hybrid-loihi")
    steps, full = (CoreProgram(program, 250, sizes=sizes) for sizes in (runs.OURS.sizes, None))
    return float(steps.lengths.sum() / full.lengths.sum() - 1)


def _pj_of_a_tick(built: runs.Built) -> float:
    """Return picojoules that a cycle costs in the clock pin of a flip-flop, with its share of the modelled tree."""
    found = built.circuit
    toggles, ungated = np.zeros((found.nets, 1)), np.ones(1)
    toggles[[found.at(flop, "CLK") for flop in found.flops]] = 1
    only = replace(
        found, order=[], gates={net: gate for net, gate in found.gates.items()}, memories=[]
    )
    spent = picojoules.measure(
        only,
        built.files.cells,
        built.files.macros,
        built.times["modelled"],
        toggles,
        ungated,
        np.zeros((0, 2, 1)),
        True,
    )
    return float(spent.of("clock")[0]) / len(found.flops)
