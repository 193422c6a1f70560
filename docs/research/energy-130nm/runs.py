"""From the core's sources and a folder with the libraries to the energy of recordings.

:class:`Library` reads the files, :class:`Built` synthesises the core and simulates it. Synthesis, simulation and energies take
minutes to hours, so each result is kept under ``build/energy``, in a file whose name has a hash of all that it depends on.
"""

import hashlib
import io
import os
import pickle
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

import gates
import liberty
import memories
import netlist
import numpy as np
import picojoules
import repeats
import timing
import traffic
from latches import Latches

import hw_model as hw
from hw_model.engine.playing import read_streams
from hw_model.rtl.cosimulation import words_of
from hw_model.rtl.images import SIMULATED, CoreProgram, Sizes, sizes_for

ROOT = Path(__file__).parents[3]
LIBRARY = ROOT.parent / "shared/data/ihp-sg13g2"
RECORDINGS = ROOT.parent / "shared/data/neutouch"
CELLS = "sg13g2_stdcell_typ_1p20V_25C.lib"
KEPT = ROOT / "build" / "energy"
SIZES = {
    "axons": 1024, "synapses": 16384, "compartments": 512, "slots": 2, "charge": 16, "join": 26, "bitmap": 2048,
    "visits": 128, "entries": 128, "step": 3, "places": 256, "sums": 32,
}  # fmt: skip
"""Parameters of the core in the chip file: it holds the hybrids of both examples."""
SAVING = {"at_once": 1, "lazy": 1}
"""Parameters of the core that save energy: charges in latches, which answer in the same cycle, and states that are read and written
only if needed. The charges of a larger core lie in macros, which do not answer at once."""
HELD = {
    "axons": 744, "synapses": 7424, "bitmap": 1024, "visit_list": 80, "tallies": 72, "weights": 4, "phases": 16,
}  # fmt: skip
"""Words that memories really have, as many as the two hybrids need; the parameters of the core are powers of two above them."""
COMPARTMENTS = 416
"""Compartments that memories really hold, of the 512 of the parameter."""


@dataclass(frozen=True)
class Core:
    """A core to be made: its parameters, the words and compartments that its memories hold, and parameters that save energy."""

    sizes: Sizes
    held: Mapping[str, int]
    compartments: int
    saving: Mapping[str, int]


OURS = Core(Sizes(**SIZES), HELD, COMPARTMENTS, SAVING)


def holding(program: hw.ChipProgram, rows: int) -> tuple[CoreProgram, Core]:
    """Return a larger program mapped for recordings of so many rows, and the smallest core that holds it."""
    mapped = CoreProgram(program, rows, sizes=replace(SIMULATED, sums=SIZES["sums"]))
    needs = mapped.needs
    held = {"axons": needs.axons, "synapses": needs.synapses // 2, "bitmap": needs.bitmap, "visit_list": needs.visits,
            "tallies": needs.entries, "weights": mapped.words.weights, "phases": mapped.words.phases}  # fmt: skip
    return mapped, Core(
        sizes_for(needs, Sizes(**SIZES)), held, needs.compartments, SAVING | {"at_once": 0}
    )


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
    """The core in cells and macros: netlist, circuit, simulator, and times with each model of wires.

    ``chosen``: what every memory is made of. ``gated``: with clock gates. ``sources``: the folder of the core's SystemVerilog.
    """

    def __init__(
        self,
        files: Library,
        chosen: Sequence[memories.Choice | Latches],
        gated: bool,
        sources: Path = netlist.CORE,
        core: Core = OURS,
    ) -> None:
        self.files, self.chosen, self.gated, self.core = files, chosen, gated, core
        source_bytes = b"".join(p.read_bytes() for p in netlist.parts(sources))
        # The scripts that make netlist and simulator are part of the hash: a change of theirs builds the core again.
        names = ("netlist.py", "memories.py", "latches.py", "repeats.py", "gates.py", "gates.cpp")
        script_bytes = b"".join((Path(__file__).parent / name).read_bytes() for name in names)
        plan = repr([(c.shape, c.text) for c in chosen])
        sizes = asdict(core.sizes)
        build_key = hashlib.sha256(
            source_bytes + script_bytes + repr((sizes, core.saving, plan, gated)).encode()
        ).hexdigest()[:12]
        self.folder = KEPT / build_key
        if not (self.folder / "netlist.json").exists():
            split = repeats.splits(core.sizes)
            netlist.synthesise(
                self.folder,
                sizes | core.saving,
                chosen,
                split,
                files.folder / CELLS,
                gated,
                sources,
            )
        self.netlist = netlist.load(self.folder / "netlist.json")
        self.circuit = gates.circuit(self.netlist, files.cells, files.macros)
        self.binary = self.folder / "gates"
        if not self.binary.exists():
            states = gates.states_of((sources / "locsnn_core.sv").read_text("utf-8"))
            gates.build(self.folder, gates.source(self.circuit, files.cells, files.macros, states))

    @cached_property
    def cell_area(self) -> float:
        """Square micrometres of standard cells."""
        return sum(
            self.files.cells[i.type].area
            for i in self.netlist.instances
            if i.type in self.files.cells
        )

    @cached_property
    def macro_area(self) -> float:
        """Square micrometres of macros."""
        return sum(one.area for one in self.chosen if isinstance(one, memories.Choice))

    @cached_property
    def leakage_nw(self) -> tuple[float, float]:
        """Nanowatts of cells and of macros."""
        cells = sum(
            self.files.cells[i.type].leakage_nw
            for i in self.netlist.instances
            if i.type in self.files.cells
        )
        return cells, sum(one.leakage_nw for one in self.chosen if isinstance(one, memories.Choice))

    @cached_property
    def wires(self) -> timing.Wires:
        """The library's wire load for this area of cells."""
        return timing.wires_for(self.files.group, self.cell_area)

    @cached_property
    def times(self) -> dict[str, timing.Timing]:
        """Times without wires, with those of modules placed as blocks, and with those of a flat layout."""
        arrays = [one.shape.name for one in self.chosen if isinstance(one, Latches)]
        models: dict[str, timing.Wires | timing.Blocks] = {"none": timing.Wires()}
        for name, flat in (("modelled", False), ("flat", True)):
            models[name] = timing.Blocks(
                self.files.group, self.circuit, self.files.cells, arrays, flat
            )
        return {
            k: timing.analyse(self.circuit, self.files.cells, self.files.macros, w)
            for k, w in models.items()
        }

    def play(
        self,
        program: hw.ChipProgram,
        recordings: np.ndarray,
        by_class: bool = False,
        probes: bool = False,
    ) -> gates.Activity:
        """Play recordings (batch, steps, channels), or load what the netlist did with them in an earlier run."""
        key = hashlib.sha256(recordings.tobytes() + program.name.encode())
        key.update(
            repr(
                (
                    recordings.shape,
                    by_class,
                    probes,
                    [c.axons.mantissa.sum() for c in program.cores],
                )
            ).encode()
        )
        result_file = self.folder / f"played-{key.hexdigest()[:12]}.pkl"
        if not result_file.exists():
            core = CoreProgram(program, recordings.shape[1], sizes=self.core.sizes)
            load = core.load_words(self.core.sizes)
            words = [words_of(core, one) for one in recordings]
            with tempfile.TemporaryDirectory(dir=self.folder) as folder:
                activity = gates.play(
                    Path(folder), self.binary, load, words, self.circuit, probes, by_class
                )
            result_file.write_bytes(pickle.dumps(activity))
        return pickle.loads(result_file.read_bytes())

    def energy(self, found: gates.Activity, wires: str) -> picojoules.Energy:
        """Return the energy of what was played, by recording, or by class of all together, from the kept file if there is one."""
        # Part of a run: take it out of the energy of the run, which is kept as a whole.
        if found.whole is not None:
            whole, begin, end = found.whole
            return self.energy(whole, wires).part(begin, end)
        made_by = b"".join(
            (Path(__file__).parent / name).read_bytes() for name in ("picojoules.py", "timing.py")
        )
        toggles = np.ascontiguousarray(found.toggles).tobytes()
        key = hashlib.sha256(toggles + wires.encode() + made_by).hexdigest()[:12]
        kept = self.folder / f"energy-{key}.pkl"
        if not kept.exists():
            kept.write_bytes(pickle.dumps(self._energy(found, wires)))
        return pickle.loads(kept.read_bytes())

    def _energy(self, found: gates.Activity, wires: str) -> picojoules.Energy:
        # Columns of the toggles are recordings or the three classes; three recordings are taken for recordings.
        by_class = found.toggles.shape[1] == 3 and len(found.answers) != 3
        cycles, accesses = found.answers[:, 4:7], found.accesses
        cycles = cycles.sum(axis=0) if by_class else cycles.sum(axis=1)
        accesses = accesses.sum(axis=3) if by_class else accesses.sum(axis=2)
        tree = wires != "none"
        cells, macros = self.files.cells, self.files.macros
        return picojoules.measure(
            self.circuit, cells, macros, self.times[wires], found.toggles, cycles, accesses, tree
        )


def real(dataset: str, part: str, count: int) -> np.ndarray:
    """Return the first recordings of a part of a public set, one of every class in turn, (count, steps, channels).

    A ``count`` of -1 gives all. Files are named ``sample_NUMBER_label_LABEL.npy``.
    """
    archive = zipfile.ZipFile(RECORDINGS / f"Ev-{dataset}.zip")
    names = [n for n in archive.namelist() if f"/{part}/sample_" in n and n.endswith(".npy")]

    def place(name: str) -> tuple[int, int]:
        sample, label = name.rsplit("/", 1)[1][:-4].split("_")[1::2]
        return int(sample), int(label)

    by_class: dict[int, list[str]] = {}
    for name in sorted(names, key=place):
        by_class.setdefault(place(name)[1], []).append(name)
    names_in_turn = [
        names_of_class[turn]
        for turn in range(max(map(len, by_class.values())))
        for _, names_of_class in sorted(by_class.items())
        if turn < len(names_of_class)
    ]
    arrays = [
        np.load(io.BytesIO(archive.read(name)))
        for name in (names_in_turn if count < 0 else names_in_turn[:count])
    ]
    return np.stack([a.reshape(-1, a.shape[-1]).T for a in arrays]).astype(np.uint8)


def training(dataset: str, many: int, quiet: int) -> np.ndarray:
    """Return the first ``many`` training recordings of a set, then the ``quiet`` ones of the others with the fewest events."""
    every = real(dataset, "train", -1)
    events = every[many:].sum(axis=(1, 2))
    return np.concatenate((every[:many], every[many:][np.argsort(events, kind="stable")[:quiet]]))


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
        command = [
            sys.executable,
            "-m",
            "locsnn_compile.cli.compile",
            str(path),
            "-o",
            str(folder),
            "--quiet",
        ]
        subprocess.run(command, cwd=ROOT, check=True, env={**os.environ, "PYTHONPATH": str(ROOT)})
    return hw.load_program(folder)


def traffic_of() -> dict[str, traffic.Memory]:
    """Return the memories of the core, constants in parts, with the accesses of a training recording of Objects to each."""
    program = compiled("objects-hybrid-loihi")
    return repeats.parts_of(counted(), CoreProgram(program, 250, sizes=OURS.sizes), OURS.sizes)


def counted() -> dict[str, traffic.Memory]:
    """Return the memories of the core as its sources have them, with the accesses of a training recording of Objects to each."""
    program = compiled("objects-hybrid-loihi")
    return counted_for(program, real("Objects", "train", count=4), OURS)


def counted_for(
    program: hw.ChipProgram, recordings: np.ndarray, core: Core
) -> dict[str, traffic.Memory]:
    """Return the memories of a core with the mean accesses of these recordings to each, from the kept file if there is one."""
    source_bytes = b"".join(p.read_bytes() for p in netlist.parts(netlist.CORE))
    script_bytes = (Path(__file__).parent / "traffic.py").read_bytes() + repr(
        (program.name, core.sizes, core.saving)
    ).encode()
    result_file = (
        KEPT
        / f"traffic-{hashlib.sha256(source_bytes + script_bytes + recordings.tobytes()).hexdigest()[:12]}.pkl"
    )
    if not result_file.exists():
        memories_counted = traffic.count(
            program, stacked(program, recordings), core.sizes, core.saving
        )
        result_file.parent.mkdir(parents=True, exist_ok=True)
        result_file.write_bytes(pickle.dumps({memory.name: memory for memory in memories_counted}))
    return pickle.loads(result_file.read_bytes())
