"""The energy profile of the chip file `locsnn-130nm`: what a count costs, from macros and gate-level activity.

Memory accesses are priced by the macros' files, and counts say how many there are. Logic and clocks are measured at
gate level: what a synaptic operation, an update and an active one cost in them is fitted to training recordings, some of
them of hardly any events.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gates
import numpy as np
import picojoules
import runs
from memories import Choice
from scipy.optimize import nnls

import hw_model as hw
from hw_model.rtl.images import CoreProgram

COUNTS = (
    "synaptic_ops", "neuron_updates", "neuron_updates_active", "spikes", "input_events", "transpose_events",
)  # fmt: skip
LISTS = ("spikes", "input_events", "transpose_events")
"""Counts that stand for a list of synapses each."""
UPDATES, ACTIVE = ("neuron_updates",), ("neuron_updates_active",)
FITTED = ("synaptic_ops", *UPDATES, *ACTIVE)
"""Counts that logic and clocks go with."""
OF = {
    "states": ACTIVE,
    "synapses": LISTS,
    "axons": LISTS,
    "places": ("spikes",),
    "bitmap": ("input_events",),
}
WRITES = {"charges": ACTIVE}
"""Counts that accesses of a memory go with; those of others go with updates."""
WORD = 2
"""Synapses in a word."""


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
    """What the profile is made of: counts and gate-level activity of the recordings of some programs."""

    built: runs.Built
    played: list[gates.Activity]
    counts: list[list[hw.Counts]]


def make(
    built: runs.Built, sets: Sequence[tuple[hw.ChipProgram, np.ndarray, gates.Activity]]
) -> Made:
    """Count what the simulator does in recordings of programs that were played."""
    counts = [
        hw.simulate(program, recordings, probe=()).per_recording for program, recordings, _ in sets
    ]
    return Made(built, [played for _, _, played in sets], counts)


def accesses(made: Made) -> dict[str, np.ndarray]:
    """Return rows read and words written of every memory, (2,), of all recordings together."""
    found: dict[str, np.ndarray] = {}
    port = 0
    for instance in made.built.circuit.memories:
        name = picojoules.memory_of(instance.name)
        for letter in "AB"[: made.built.files.macros[instance.type].ports]:
            del letter
            if instance.name.endswith("_0"):
                here = sum(one.accesses[port].sum(axis=(1, 2)) for one in made.played)
                found[name] = found.get(name, np.zeros(2)) + here
            port += 1
    return found


def price(made: Made, wires: str) -> Priced:
    """Return what each count costs, with wires of a model or without."""
    total = {name: sum(c[name] for many in made.counts for c in many) for name in COUNTS}
    ops = total["synaptic_ops"]
    rows = accesses(made)
    chosen = {one.shape.name: one for one in made.built.chosen if isinstance(one, Choice)}
    memory = dict.fromkeys(COUNTS, 0.0)
    recordings = sum(len(many) for many in made.counts)
    cleaned = 0.0
    for name, one in chosen.items():
        reads, writes = rows[name][0] * one.read_pj, rows[name][1] * one.write_pj
        if name == "synapses":
            # Rows of synapses: one for every so many words, and what a list costs beyond that.
            within = ops / WORD / one.pack * one.read_pj
            memory["synaptic_ops"] += within / ops
            reads -= within
        if name == "charges":
            memory["synaptic_ops"] += one.read_pj + one.write_pj
            swept = recordings * runs.SIZES["slots"] * runs.SIZES["places"] * one.write_pj
            reads, writes, cleaned = (
                reads - ops * one.read_pj,
                writes - ops * one.write_pj - swept,
                cleaned + swept,
            )
        if name == "bitmap":
            swept = (rows[name][1] - total["input_events"]) * one.write_pj
            writes, cleaned = writes - swept, cleaned + swept
        for pj, names in (
            (reads, OF.get(name, UPDATES)),
            (writes, OF.get(name, WRITES.get(name, UPDATES))),
        ):
            for count in names:
                memory[count] += pj / sum(total[n] for n in names)
    pj = dict(memory)
    for name, its in zip(FITTED, fitted(made, wires), strict=True):
        pj[name] += its
    return Priced({name: float(x) for name, x in pj.items()}, cleaned / recordings, memory)


def fitted(made: Made, wires: str) -> np.ndarray:
    """Return picojoules of logic and clocks for each of :data:`FITTED`: those with the least relative errors, none below 0."""
    energies = [made.built.energy(one, wires) for one in made.played]
    spent = np.concatenate([one.of("logic") + one.of("clock") for one in energies])
    whole = np.concatenate([one.total for one in energies])
    counts = np.array([[c[name] for name in FITTED] for many in made.counts for c in many])
    return nnls(counts / whole[:, None], spent / whole)[0]


def compare(
    built: runs.Built,
    priced: Priced,
    program: hw.ChipProgram,
    recordings: np.ndarray,
    played: gates.Activity,
    wires: str,
) -> np.ndarray:
    """Return picojoules by the profile, at gate level, and of the latter in memories, (recordings, 3)."""
    found = hw.simulate(program, recordings, probe=("spikes", "u", "v"))
    assert (played.answers[:, 0] == found.prediction).all()
    assert (played.answers[:, 2] == [c.synaptic_ops for c in found.per_recording]).all()
    for i in range(len(recordings)):
        assert (updates_of(played, i) == expected(program, recordings, found, i)).all()
    by_profile = [priced.of(counts) for counts in found.per_recording]
    spent = built.energy(played, wires)
    return np.stack([by_profile, spent.total, spent.of("memory")], axis=1)


def updates_of(played: gates.Activity, recording: int) -> np.ndarray:
    """Return what the netlist showed of every update, (updates, 4): compartment, u, v and whether it fired."""
    assert played.probes is not None
    mine = played.probes[played.probes[:, 0] == recording, 1:].astype(np.int64)
    mine[:, 1:3] -= (mine[:, 1:3] >> 23) << 24
    return mine


def expected(
    program: hw.ChipProgram, recordings: np.ndarray, found: hw.SimulationResult, i: int
) -> np.ndarray:
    """Return what the simulator says of the updates of a recording, in the order of the core."""
    core, parts = CoreProgram(program, recordings.shape[1], sizes=runs.OURS.sizes), []
    for phase in core.phases:
        columns = program.columns_of(phase.name)
        numbers = np.concatenate([core.numbers[phase.name][at] for at in columns.values()])
        of = {
            kind: np.concatenate([getattr(found, kind)[n][i] for n in columns], axis=1)
            for kind in ("u", "v")
        }
        none = [np.zeros_like(found.u[n][i]) for n in columns]
        fired = np.concatenate(
            [
                found.spikes.get(n, [zero] * (i + 1))[i]
                for n, zero in zip(columns, none, strict=True)
            ],
            axis=1,
        )
        order = np.argsort(numbers)
        each = [np.broadcast_to(numbers, of["u"].shape), of["u"], of["v"], fired]
        parts.append(np.stack([one[:, order].ravel() for one in each], axis=1).astype(np.int64))
    return np.concatenate(parts)
