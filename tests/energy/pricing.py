"""The energy profile of the chip file `locsnn-130nm`: what a count costs, from macros and gate-level activity.

Memory accesses are priced by the macros' files, and counts say how many there are. Logic and clocks are measured at
gate level: cycles of delivery by synaptic operation, cycles of updates by compartment.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import gates
import numpy as np
import runs

import hw_model as hw

COUNTS = (
    "synaptic_ops", "neuron_updates", "neuron_updates_active", "spikes", "input_events", "transpose_events",
)  # fmt: skip
LISTS = ("spikes", "input_events", "transpose_events")
"""Counts that stand for a list of synapses each."""


@dataclass
class Priced:
    """Picojoules of each of :data:`COUNTS`, and of a recording whatever it does; ``memory``: of them in macros."""

    pj: dict[str, float]
    fixed: float
    memory: dict[str, float]

    def of(self, counts: hw.Counts) -> float:
        """Return picojoules of a recording with these counts."""
        return sum(pj * counts[name] for name, pj in self.pj.items())


@dataclass
class Made:
    """What the profile is made of: programs, their recordings, counts and gate-level activity by class of cycles."""

    built: runs.Built
    played: list[gates.Activity]
    counts: list[list[hw.Counts]]


def make(built: runs.Built, sets: Mapping[str, tuple[hw.ChipProgram, np.ndarray]]) -> Made:
    """Play recordings of programs."""
    played, counts = [], []
    for program, recordings in sets.values():
        played.append(built.play(program, runs.stacked(program, recordings), by_class=True))
        counts.append(hw.simulate(program, recordings, probe=()).per_recording)
    return Made(built, played, counts)


def accesses(made: Made) -> dict[str, np.ndarray]:
    """Return rows read and words written of every memory, (2,), of all recordings together."""
    found: dict[str, np.ndarray] = {}
    port = 0
    for instance in made.built.circuit.memories:
        name = instance.name.replace("\\", "").split(".")[-2]
        for letter in "AB"[: made.built.files.macros[instance.type].ports]:
            del letter
            if instance.name.endswith("_0"):
                here = sum(one.accesses[port].sum(axis=(1, 2)) for one in made.played)
                found[name] = found.get(name, np.zeros(2)) + here
            port += 1
    return found


def price(made: Made, wires: str) -> Priced:
    """Return what each count costs, with wires of a model or without."""
    total = {name: sum(c[name] for many in made.counts for c in many) for name in (*COUNTS, "neuron_updates_inactive")}
    lists = sum(total[name] for name in LISTS)
    updates, active, ops = total["neuron_updates"], total["neuron_updates_active"], total["synaptic_ops"]
    rows = accesses(made)
    chosen = {choice.shape.name: choice for choice in made.built.chosen}
    memory = dict.fromkeys(COUNTS, 0.0)
    # Rows of synapses: one for every so many words, and what a list costs beyond that.
    synapses = chosen["synapses"]
    beyond = rows["synapses"][0] - ops / synapses.pack
    memory["synaptic_ops"] += synapses.read_pj / synapses.pack
    for name in LISTS:
        memory[name] += synapses.read_pj * beyond / lists + chosen["axons"].read_pj
    charges, states, sums = chosen["charges"], chosen["states"], chosen["sums"]
    memory["synaptic_ops"] += charges.read_pj + charges.write_pj
    memory["neuron_updates"] += charges.read_pj + states.read_pj
    for name in ("leaks", "fires", "tallies"):
        memory["neuron_updates"] += chosen[name].read_pj * rows[name][0] / updates
    sweep = sum(len(many) for many in made.counts) * runs.SIZES["slots"] * runs.SIZES["compartments"]
    taken = rows["charges"][1] - ops - sweep
    memory["neuron_updates_active"] += charges.write_pj * taken / active
    memory["neuron_updates_active"] += states.write_pj * rows["states"][1] / active
    memory["neuron_updates"] += (sums.read_pj * rows["sums"][0] + sums.write_pj * rows["sums"][1]) / updates
    memory["neuron_updates"] += chosen["tallies"].write_pj * rows["tallies"][1] / updates
    memory["spikes"] += chosen["places"].read_pj + chosen["places"].write_pj
    memory["input_events"] += chosen["bitmap"].read_pj + chosen["bitmap"].write_pj
    pj = dict(memory)
    energies = [made.built.energy(one, wires) for one in made.played]
    by_class = sum(e.of("logic") + e.of("clock") for e in energies)
    pj["synaptic_ops"] += float(by_class[0]) / ops
    pj["neuron_updates"] += float(by_class[1]) / updates
    recordings = sum(len(many) for many in made.counts)
    swept = rows["bitmap"][1] - total["input_events"]
    fixed = (float(by_class[2]) + charges.write_pj * sweep + chosen["bitmap"].write_pj * swept) / recordings
    return Priced({name: float(x) for name, x in pj.items()}, float(fixed), memory)


def compare(
    built: runs.Built, priced: Priced, program: hw.ChipProgram, recordings: np.ndarray, wires: str
) -> np.ndarray:
    """Return picojoules by the profile, at gate level, and of the latter in memories, (recordings, 3)."""
    played = built.play(program, runs.stacked(program, recordings))
    found = hw.simulate(program, recordings, probe=())
    assert (played.answers[:, 0] == found.prediction).all()
    assert (played.answers[:, 2] == [c.synaptic_ops for c in found.per_recording]).all()
    by_profile = [priced.of(counts) for counts in found.per_recording]
    spent = built.energy(played, wires)
    return np.stack([by_profile, spent.total, spent.of("memory")], axis=1)
