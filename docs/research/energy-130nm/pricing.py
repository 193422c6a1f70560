"""The energy profile of the chip file `locsnn-130nm`: what each count of the simulator costs.

The price of a count has two parts. Memory accesses are priced by the macros' files, and each access is assigned to the count that
causes it. Logic and clocks are measured at gate level; what a synaptic operation, an update and an active update take of them is
fitted to training recordings, some of which have hardly any events.
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
"""Counts of which each reads one list of synapses."""
UPDATES, ACTIVE = ("neuron_updates",), ("neuron_updates_active",)
FITTED = ("synaptic_ops", *UPDATES, *ACTIVE)
"""Counts to which the energy of logic and clocks is fitted."""
OF = {
    "states": ACTIVE,
    "synapses": LISTS,
    "axons": LISTS,
    "places": ("spikes",),
    "bitmap": ("input_events",),
}
WRITES = {"charges": ACTIVE}
"""The counts that reads (`OF`) and writes (`WRITES`, else `OF`) of a memory are assigned to; by default updates."""
WORD = 2
"""Synapses in a word of the memory of synapses."""


@dataclass
class Priced:
    """Picojoules of each of :data:`COUNTS`; ``fixed``: of every recording, whatever it does; ``memory``: the part in macros."""

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
    """Add the simulator's counts to what the netlist did, for some programs, each with its recordings."""
    counts = [
        hw.simulate(program, recordings, probe=()).per_recording for program, recordings, _ in sets
    ]
    return Made(built, [played for _, _, played in sets], counts)


def accesses(made: Made) -> dict[str, np.ndarray]:
    """Return rows read and words written of every memory, (2,), of all recordings together.

    The macros side by side in a bank are accessed together, so only the first of them (``..._0``) is counted.
    """
    accesses_of_memory: dict[str, np.ndarray] = {}
    port = 0
    for instance in made.built.circuit.memories:
        name = picojoules.memory_of(instance.name)
        for letter in "AB"[: made.built.files.macros[instance.type].ports]:
            del letter
            if instance.name.endswith("_0"):
                of_port = sum(one.accesses[port].sum(axis=(1, 2)) for one in made.played)
                accesses_of_memory[name] = accesses_of_memory.get(name, np.zeros(2)) + of_port
            port += 1
    return accesses_of_memory


def price(made: Made, wires: str) -> Priced:
    """Return what each count costs, with a model of wires (a name of ``Built.times``).

    Cleaning the memories before a recording is no count; it is taken out of the writes and becomes ``fixed``.
    """
    total = {
        name: sum(c[name] for counts_of_set in made.counts for c in counts_of_set)
        for name in COUNTS
    }
    ops = total["synaptic_ops"]
    rows = accesses(made)
    chosen = {
        choice.shape.name: choice for choice in made.built.chosen if isinstance(choice, Choice)
    }
    memory = dict.fromkeys(COUNTS, 0.0)
    recordings = sum(len(counts_of_set) for counts_of_set in made.counts)
    cleaned = 0.0
    for name, choice in chosen.items():
        reads, writes = rows[name][0] * choice.read_pj, rows[name][1] * choice.write_pj
        if name == "synapses":
            # A synaptic operation costs its share of a row. Rows that are read for less than their words are the cost of lists.
            words_pj = ops / WORD / choice.pack * choice.read_pj
            memory["synaptic_ops"] += words_pj / ops
            reads -= words_pj
        if name == "charges":
            # An operation reads and writes a charge. What is left are the updates, which take charges, and the cleaning.
            memory["synaptic_ops"] += choice.read_pj + choice.write_pj
            swept = recordings * runs.SIZES["slots"] * runs.SIZES["places"] * choice.write_pj
            reads, writes, cleaned = (
                reads - ops * choice.read_pj,
                writes - ops * choice.write_pj - swept,
                cleaned + swept,
            )
        if name == "bitmap":
            # An input event writes one mark; all other writes are cleaning.
            swept = (rows[name][1] - total["input_events"]) * choice.write_pj
            writes, cleaned = writes - swept, cleaned + swept
        for pj, names in (
            (reads, OF.get(name, UPDATES)),
            (writes, OF.get(name, WRITES.get(name, UPDATES))),
        ):
            for count in names:
                memory[count] += pj / sum(total[n] for n in names)
    pj = dict(memory)
    for name, fitted_pj in zip(FITTED, fitted(made, wires), strict=True):
        pj[name] += fitted_pj
    return Priced({name: float(x) for name, x in pj.items()}, cleaned / recordings, memory)


def fitted(made: Made, wires: str) -> np.ndarray:
    """Return picojoules of logic and clocks for each of :data:`FITTED`: the fit with the least relative errors, none below 0.

    Both sides are divided by the recording's whole energy, so that the error is relative to it; `nnls` allows no negative price.
    """
    energies = [made.built.energy(one, wires) for one in made.played]
    logic_and_clock_pj = np.concatenate([one.of("logic") + one.of("clock") for one in energies])
    total_pj = np.concatenate([one.total for one in energies])
    counts = np.array([[c[name] for name in FITTED] for many in made.counts for c in many])
    return nnls(counts / total_pj[:, None], logic_and_clock_pj / total_pj)[0]


def compare(
    built: runs.Built,
    priced: Priced,
    program: hw.ChipProgram,
    recordings: np.ndarray,
    played: gates.Activity,
    wires: str,
) -> np.ndarray:
    """Return picojoules by the profile, at gate level, and of the latter those in memories, (recordings, 3).

    First check that the netlist did what the simulator did: class, operations and every update.
    """
    simulated = hw.simulate(program, recordings, probe=("spikes", "u", "v"))
    assert (played.answers[:, 0] == simulated.prediction).all()
    assert (played.answers[:, 2] == [c.synaptic_ops for c in simulated.per_recording]).all()
    for i in range(len(recordings)):
        assert (updates_of(played, i) == expected(program, recordings, simulated, i)).all()
    by_profile = [priced.of(counts) for counts in simulated.per_recording]
    energy = built.energy(played, wires)
    return np.stack([by_profile, energy.total, energy.of("memory")], axis=1)


def updates_of(played: gates.Activity, recording: int) -> np.ndarray:
    """Return what the netlist showed of every update, (updates, 4): compartment, u, v and whether it fired."""
    assert played.probes is not None
    rows = played.probes[played.probes[:, 0] == recording, 1:].astype(np.int64)
    rows[:, 1:3] -= (rows[:, 1:3] >> 23) << 24  # u and v are 24-bit numbers with a sign
    return rows


def expected(
    program: hw.ChipProgram, recordings: np.ndarray, found: hw.SimulationResult, i: int
) -> np.ndarray:
    """Return what the simulator gives for the updates of recording ``i``, in the form and order of :func:`updates_of`.

    The core goes through the phases, in each through the steps, and in a step through the compartments by number.
    """
    core, parts = CoreProgram(program, recordings.shape[1], sizes=runs.OURS.sizes), []
    for phase in core.phases:
        columns = program.columns_of(phase.name)
        numbers = np.concatenate([core.numbers[phase.name][at] for at in columns.values()])
        states = {
            kind: np.concatenate([getattr(found, kind)[n][i] for n in columns], axis=1)
            for kind in ("u", "v")
        }
        silent = [np.zeros_like(found.u[n][i]) for n in columns]
        fired = np.concatenate(
            [
                found.spikes.get(n, [zero] * (i + 1))[i]
                for n, zero in zip(columns, silent, strict=True)
            ],
            axis=1,
        )
        order = np.argsort(numbers)
        columns_of_row = [
            np.broadcast_to(numbers, states["u"].shape),
            states["u"],
            states["v"],
            fired,
        ]
        parts.append(
            np.stack([one[:, order].ravel() for one in columns_of_row], axis=1).astype(np.int64)
        )
    return np.concatenate(parts)
