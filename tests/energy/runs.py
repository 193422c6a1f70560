"""From the core's sources and a folder with the libraries to the energy of recordings; what takes long is kept."""

import hashlib
import io
import os
import pickle
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import gates
import liberty
import memories
import netlist
import numpy as np
import picojoules
import timing

import hw_model as hw
from hw_model.engine.playing import read_streams
from hw_model.rtl.cosimulation import words_of
from hw_model.rtl.images import CoreProgram, Sizes

ROOT = Path(__file__).parents[2]
LIBRARY = ROOT.parent / "shared/data/ihp-sg13g2"
RECORDINGS = ROOT.parent / "shared/data/neutouch"
CELLS = "sg13g2_stdcell_typ_1p20V_25C.lib"
KEPT = ROOT / "build" / "energy"
SIZES = {
    "axons": 1024, "synapses": 16384, "compartments": 512, "slots": 2, "charge": 16, "join": 26, "bitmap": 2048,
    "visits": 128, "entries": 128,
}  # fmt: skip
"""The core of the chip file: it holds the hybrid of either example."""
USED = {"synapses": 14336, "bitmap": 1280}
"""Words that the macros hold, where the parameter of the core is a power of two above it."""


@dataclass(frozen=True)
class Library:
    """The files of the process."""

    folder: Path

    @cached_property
    def group(self) -> liberty.Group:
        """The standard cells as the file has them."""
        return liberty.read(self.folder / CELLS)

    @cached_property
    def cells(self) -> dict[str, liberty.Cell]:
        """Standard cells by name."""
        return liberty.cells(self.group)

    @cached_property
    def macros(self) -> dict[str, liberty.Macro]:
        """Memory macros by name."""
        return {macro.name: macro for macro in liberty.macros(self.folder / "sram")}


class Built:
    """The core in cells and macros: netlist, times without wires and with those of the library's model."""

    def __init__(
        self, files: Library, chosen: Sequence[memories.Choice], gated: bool, sources: Path = netlist.CORE
    ) -> None:
        self.files, self.chosen, self.gated = files, chosen, gated
        texts = b"".join(p.read_bytes() for p in netlist.parts(sources))
        names = ("netlist.py", "memories.py", "gates.py")
        made_by = b"".join((Path(__file__).parent / name).read_bytes() for name in names)
        plan = repr([(c.shape, [m.name for m in c.macros], c.banks, c.pack) for c in chosen])
        key = hashlib.sha256(texts + made_by + repr((SIZES, plan, gated)).encode()).hexdigest()[:12]
        self.folder = KEPT / key
        if not (self.folder / "netlist.json").exists():
            netlist.synthesise(self.folder, SIZES, chosen, files.folder / CELLS, gated, sources)
        self.netlist = netlist.load(self.folder / "netlist.json")
        self.circuit = gates.circuit(self.netlist, files.cells, files.macros)
        self.binary = self.folder / "gates"
        if not self.binary.exists():
            states = gates.states_of((sources / "locsnn_core.sv").read_text("utf-8"))
            gates.build(self.folder, gates.source(self.circuit, files.cells, files.macros, states))

    @cached_property
    def cell_area(self) -> float:
        """Square micrometres of standard cells."""
        return sum(self.files.cells[i.type].area for i in self.netlist.instances if i.type in self.files.cells)

    @cached_property
    def macro_area(self) -> float:
        """Square micrometres of macros."""
        return sum(choice.area for choice in self.chosen)

    @cached_property
    def leakage_nw(self) -> tuple[float, float]:
        """Nanowatts of cells and of macros."""
        cells = sum(self.files.cells[i.type].leakage_nw for i in self.netlist.instances if i.type in self.files.cells)
        return cells, sum(choice.leakage_nw for choice in self.chosen)

    @cached_property
    def wires(self) -> timing.Wires:
        """The library's wire load for this area of cells."""
        return timing.wires_for(self.files.group, self.cell_area)

    @cached_property
    def times(self) -> dict[str, timing.Timing]:
        """Times without wires, and with the modelled ones."""
        models = {"none": timing.Wires(), "modelled": self.wires}
        return {k: timing.analyse(self.circuit, self.files.cells, self.files.macros, w) for k, w in models.items()}

    def play(
        self, program: hw.ChipProgram, recordings: np.ndarray, by_class: bool = False, probes: bool = False
    ) -> gates.Activity:
        """Play recordings (batch, steps, channels); what was played before is not played again."""
        key = hashlib.sha256(recordings.tobytes() + program.name.encode())
        key.update(repr((recordings.shape, by_class, probes, [c.axons.mantissa.sum() for c in program.cores])).encode())
        kept = self.folder / f"played-{key.hexdigest()[:12]}.pkl"
        if not kept.exists():
            core = CoreProgram(program, recordings.shape[1])
            load = core.load_words(Sizes(**SIZES))
            words = [words_of(core, one) for one in recordings]
            found = gates.play(self.folder, self.binary, load, words, self.circuit, probes, by_class)
            kept.write_bytes(pickle.dumps(found))
        return pickle.loads(kept.read_bytes())

    def energy(self, found: gates.Activity, wires: str) -> picojoules.Energy:
        """Return the energy of what was played, by recording, or by class of all together."""
        by_class = found.toggles.shape[1] == 3 and len(found.answers) != 3
        cycles, accesses = found.answers[:, 4:7], found.accesses
        cycles = cycles.sum(axis=0) if by_class else cycles.sum(axis=1)
        accesses = accesses.sum(axis=3) if by_class else accesses.sum(axis=2)
        tree = wires == "modelled"
        cells, macros = self.files.cells, self.files.macros
        return picojoules.measure(self.circuit, cells, macros, self.times[wires], found.toggles, cycles, accesses, tree)


def real(dataset: str, part: str, count: int) -> np.ndarray:
    """Return the first recordings of a part of a public set, one of every class in turn, (count, steps, channels)."""
    archive = zipfile.ZipFile(RECORDINGS / f"Ev-{dataset}.zip")
    names = [n for n in archive.namelist() if f"/{part}/sample_" in n and n.endswith(".npy")]

    def place(name: str) -> tuple[int, int]:
        sample, label = name.rsplit("/", 1)[1][:-4].split("_")[1::2]
        return int(sample), int(label)

    by_class: dict[int, list[str]] = {}
    for name in sorted(names, key=place):
        by_class.setdefault(place(name)[1], []).append(name)
    order = [
        several[turn]
        for turn in range(max(map(len, by_class.values())))
        for _, several in sorted(by_class.items())
        if turn < len(several)
    ]
    arrays = [np.load(io.BytesIO(archive.read(name))) for name in order[:count]]
    return np.stack([a.reshape(-1, a.shape[-1]).T for a in arrays]).astype(np.uint8)


def stacked(program: hw.ChipProgram, recordings: np.ndarray) -> np.ndarray:
    """Return recordings in the order of the program's streams."""
    streams = read_streams(program, recordings)[0]
    return np.concatenate([streams[name] for name in program.streams], axis=2)


def compiled(model: str) -> hw.ChipProgram:
    """Return a shipped model as a program of ``loihi-sim``, compiled once."""
    import subprocess
    import sys

    path = ROOT / "examples/models" / f"{model}.pt"
    folder = KEPT / "programs" / f"{model}-{hashlib.sha256(path.read_bytes()).hexdigest()[:8]}"
    if not (folder / "program.npz").exists():
        command = [sys.executable, "-m", "locsnn_compile.cli.compile", str(path), "-o", str(folder), "--quiet"]
        subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    return hw.load_program(folder)


TRAFFIC = {
    "synapses": (257e3, 0), "axons": (15e3, 0), "charges": (324e3, 290e3), "states": (67e3, 55e3), "leaks": (67e3, 0),
    "fires": (67e3, 0), "sums": (23e3, 44e3), "places": (3e3, 3e3), "tallies": (18e3, 1e3), "bitmap": (5e3, 4e3),
    "visit_list": (1e2, 0), "phases": (2e1, 0), "weights": (1e2, 0),
}  # fmt: skip
"""Words read and written per recording of Objects, as counted; the plan is made for them."""
SEQUENTIAL = {"synapses": 0.94, "leaks": 0.99, "fires": 0.99}
"""The share of reads whose word follows the one before."""
PRICE = 6.0
"""Picojoules per recording that a square micrometre is worth: more area saves little beyond it."""


def plan(files: Library, price: float = PRICE) -> list[memories.Choice]:
    """Return the macros of every memory: the least picojoules per recording plus ``price`` for a square micrometre."""
    return [
        min(options(files, shape), key=lambda c: cost(c) + price * c.area)
        for shape in memories.shapes(SIZES, netlist.memory_names(netlist.CORE))
    ]


def options(files: Library, shape: memories.Shape) -> list[memories.Choice]:
    """Return what a memory may be made of."""
    return list(memories.choices(shape, list(files.macros.values()), USED.get(shape.name)))


def cost(choice: memories.Choice) -> float:
    """Return picojoules per recording of a memory made like this.

    With several words a row, reads of words that follow each other are mostly answered from the row read last.
    """
    reads, writes = TRAFFIC[choice.shape.name]
    rows = reads * (1 - SEQUENTIAL.get(choice.shape.name, 0.0) * (1 - 1 / choice.pack))
    return rows * choice.read_pj + writes * choice.write_pj
