"""Everything that reads files: how a whole file is made, which part of it is damaged, and how it is read.

``fuzz.py`` damages the files and counts how the readers take it.
"""

import contextlib
import hashlib
import io
import json
import pickle
import re
import shutil
import sys
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import torch

TESTS = Path(__file__).parents[1]
sys.path.insert(0, str(TESTS.parent))

import nir  # noqa: E402

import hw_model as hw  # noqa: E402
import locsnn_compile as lc  # noqa: E402
from hw_model.program.sealed import SEAL  # noqa: E402
from locsnn_compile.cli import diff  # noqa: E402
from locsnn_compile.data import Recordings, read_recordings, synthetic_touches, write_recordings  # noqa: E402
from locsnn_compile.data.sensor import LOCATION_ORDERS, neutouch, read_layout  # noqa: E402
from locsnn_compile.errors import InputError  # noqa: E402
from locsnn_compile.models.checkpoint import Checkpoint  # noqa: E402
from locsnn_compile.models.description import InputLayout, NetworkDescription  # noqa: E402
from locsnn_compile.models.networks import build_network  # noqa: E402
from locsnn_compile.training.config import config_from_mapping, read_config  # noqa: E402
from tests.support.net_files import dense, even, write_net  # noqa: E402
from tests.support.nir_graphs import graphs  # noqa: E402
from tests.support.slayer_files import LOIHI, SRM, write  # noqa: E402

EXAMPLES = TESTS.parent / "examples"


@dataclass(frozen=True)
class Reader:
    """One thing that reads files.

    - ``kind``: how a file is damaged: ``bytes``, ``text``, ``zip`` or ``hdf5``
    - ``make``: writes whole files into a folder, and returns the names of those to damage, one in each case
    - ``read``: reads a folder in which the file of this name is damaged
    - ``mend``: makes the other files fit the damaged one, so that they do not reveal the damage at once
    """

    name: str
    kind: str
    make: Callable[[Path], list[str]]
    read: Callable[[Path, str], object]
    mend: Callable[[Path, str], None] | None = None


def checkpoints(folder):
    """Write a small checkpoint, a shipped one, and one in torch's old format."""
    layout = InputLayout(neutouch(1), steps=6, step_seconds=0.02)
    order = {"location_order": "arch", "location_taxels": LOCATION_ORDERS["arch"]}
    description = NetworkDescription("hybrid", layout, classes=3, hidden=4, name="small", **order)
    spikes = (np.random.default_rng(0).random((2, 6, 78)) < 0.2).astype(np.uint8)
    Checkpoint(
        description,
        build_network(description, seed=1).weights(),
        recordings=Recordings(spikes, np.array([0, 2]), step_seconds=0.02, source="small"),
    ).save(folder / "a.pt")
    (folder / "b.pt").write_bytes((EXAMPLES / "models/objects-hybrid-loihi.pt").read_bytes())
    return ["a.pt", "b.pt", as_before_torch_1_6(folder / "a.pt")]


class OldPickler(pickle.Pickler):
    """Numbers storages in their order: torch writes their addresses, with which no case could be repeated."""

    def persistent_id(self, held):
        if not isinstance(held, torch.storage.TypedStorage):
            return None
        self.storages.append(held)
        kind, key = getattr(torch, held._pickle_storage_type()), f"{len(self.storages):04}"
        return "storage", kind, key, "cuda:0", held._size(), None


def as_before_torch_1_6(path):
    """Write a file once more in torch's old format; return its name."""
    with path.with_name("old.pt").open("wb") as old:
        for part in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": True}):
            pickle.dump(part, old, protocol=2)
        pickler = OldPickler(old, protocol=2)
        pickler.storages = []
        pickler.dump(torch.load(path, weights_only=True))
        pickle.dump(
            [f"{number + 1:04}" for number in range(len(pickler.storages))], old, protocol=2
        )
        for storage in pickler.storages:
            values = torch.tensor([], dtype=storage.dtype).set_(storage).numpy()
            old.write(len(values).to_bytes(8, "little") + values.tobytes())
    return old.name


def nir_files(folder):
    """Write one graph of each kind that the tests of NIR have."""
    names = []
    for name, (graph, *_) in graphs().items():
        nir.write(folder / f"{name}.nir", graph)
        names.append(f"{name}.nir")
    return names


def net_files(folder):
    """Write lava-dl networks: dense layers with delays and biases, and a convolution."""
    rng = np.random.default_rng(2)
    write_net(
        folder / "a.net",
        [
            dense(rng, outs=5, ins=4),
            dense(rng, outs=3, ins=5, delay=np.arange(3.0), bias=even(rng, 3)),
        ],
    )
    conv = dense(rng, outs=2, ins=2) | {
        "type": "conv",
        "weight": even(rng, 2, 1, 3, 3),
        "inChannels": 1,
        "outChannels": 2,
    }
    conv |= {
        "kernelSize": [3, 3],
        "stride": [1, 1],
        "padding": [1, 1],
        "dilation": [1, 1],
        "groups": 1,
    }
    conv["shape"] = np.array([2, 4, 4])
    layers = [
        {"type": "input", "shape": np.array([1, 4, 4])},
        conv,
        {"type": "flatten", "shape": np.array([32])},
    ]
    write_net(folder / "b.net", [*layers, dense(rng, outs=3, ins=32)])
    return ["a.net", "b.net"]


def slayer_files(folder, neuron):
    """Write a checkpoint of slayerPytorch and its YAML."""
    rng = np.random.default_rng(3)
    write(folder, {"fc1": rng.normal(size=(4, 78)) * 3, "fc2": rng.normal(size=(3, 4)) * 3}, neuron)


def slayer_checkpoints(folder):
    """Write such files; the checkpoint is damaged, in both of torch's formats."""
    slayer_files(folder, SRM)
    return ["model.pt", as_before_torch_1_6(folder / "model.pt")]


def slayer_configs(folder):
    """Write such files; the YAML is damaged."""
    slayer_files(folder, LOIHI)
    return ["net.yaml"]


TOUCHES = synthetic_touches(2, steps=12, seed=1)


def recordings(*names, members="npy", structured=False, one=False):
    """Return a ``make`` that writes touches under these names, whose endings are the formats.

    ``one``: only one recording, for formats that hold no more.
    """

    def make(folder):
        for name in names:
            touches = TOUCHES.subset([1]) if one else TOUCHES
            if name == "a.npy":
                touches = Recordings(touches.spikes, labels=None, step_seconds=None, source="x")
            write_recordings(folder / name, touches, members=members, structured=structured)
        return list(names)

    return make


def raw_text(folder):
    """Write raw events of a touch as text, with the times of its phases; the events are damaged."""
    times = np.sort(np.random.default_rng(4).uniform(100, 101, 60))
    lines = [
        f"{i % 2} {cell} {t:.6f}"
        for i, (cell, t) in enumerate(zip(np.arange(60) % 16 + 1, times, strict=True))
    ]
    (folder / "a.tact").write_text("\n".join(lines))
    (folder / "a.startend").write_text(
        "start 1\nreaching 2\nreached 3\ngrasping 100.0\nlifting 105\nholding 110\n"
    )
    return ["a.tact"]


def phases(folder):
    """Write the same files; the times of the phases are damaged."""
    raw_text(folder)
    return ["a.startend"]


def labels_beside(folder):
    """Write an array of recordings and the file of its labels, which is damaged."""
    np.save(folder / "a.npy", TOUCHES.spikes.transpose(0, 2, 1))
    np.save(folder / "a_labels.npy", np.array([1, 0]))
    return ["a_labels.npy"]


def member_folder(folder):
    """Write a folder with a file for each recording."""
    write_recordings(folder / "set", TOUCHES)
    return ["set/sample_0_label_0.npy", "set/sample_1_label_1.npy"]


def spike_times(folder):
    """Write HDF5 files: one of spike times, one of bins."""
    with h5py.File(folder / "a.h5", "w") as file:
        for name, top, kind in (("times", 1.0, np.float16), ("units", 78, np.uint16)):
            rows = file.create_dataset(f"spikes/{name}", (3,), dtype=h5py.vlen_dtype(kind))
            for index in range(3):
                rows[index] = np.random.default_rng(index).uniform(0, top, 5).astype(kind)
        file["labels"], file["extra/keys"] = [0, 1, 0], [b"left", b"right"]
    with h5py.File(folder / "b.h5", "w") as file:
        file["spikes"], file["labels"], file["class_names"] = (
            TOUCHES.spikes,
            [0, 1],
            ["left", "right"],
        )
        file["axes"], file["step_seconds"] = "samples,steps,channels", 0.02
    return ["a.h5", "b.h5"]


def class_folders(folder):
    """Write a folder for each class, with recordings in the format of N-MNIST."""
    for name in ("left", "right"):
        (folder / "set" / name).mkdir(parents=True)
        write_recordings(folder / f"{name}_label_1.bs2", TOUCHES.subset([1]))
        (folder / f"{name}_label_1.bs2").rename(folder / "set" / name / "a.bin")
    return ["set/left/a.bin"]


def layouts(folder):
    """Write the description of a sensor."""
    lines = [
        "name: glove",
        "polarities: 2",
        "surfaces: 1",
        "positions: [[0, 0], [1.5, 0], [0, 2]]",
        "names: [a, b, c]",
    ]
    (folder / "glove.yaml").write_text("\n".join([*lines, ""]))
    return ["glove.yaml"]


def programs(folder):
    """Write a small program for a chip, without the checksum of its text."""
    chip = hw.chip("loihi-sim")
    builder = hw.ProgramBuilder(chip)
    x = builder.add_input("x", 4)
    h = builder.add_compartments(
        "h", 3, decay_u=1024, decay_v=128, threshold=10, bias=3, refractory=2
    )
    builder.connect(x, h, np.arange(-6, 6).reshape(3, 4) * 2, weight_bits=8, delay=1)
    builder.connect(h, h, np.eye(3) * 4, weight_bits=8)
    builder.build().save(folder)
    text = folder / "program.yaml"
    # Without its own checksum: else no damage that still makes a program is ever played.
    text.write_text(text.read_text().rpartition(SEAL)[0])


def play_program(folder, _):
    """Load a program, and play a few steps if it is small: compiled loops trust that loading checks everything."""
    program = hw.load_program(folder)
    if all(size <= 1000 for size in program.streams.values()) and all(
        (p.steps or 0) <= 1000 for p in program.phases
    ):
        spikes = {
            name: np.ones((4, size), dtype=np.uint8) for name, size in program.streams.items()
        }
        hw.simulate(program, spikes, engine="fast")


def program_texts(folder):
    """Write a program; its text is damaged."""
    programs(folder)
    return ["program.yaml"]


def program_arrays(folder):
    """Write a program; its arrays are damaged."""
    programs(folder)
    return ["program.npz"]


def mend_checksum(folder, name):
    """Let the text name the checksum of the damaged arrays: otherwise the checksum is all that is ever checked."""
    digest = hashlib.sha256((folder / name).read_bytes()).hexdigest()
    text = (folder / "program.yaml").read_text()
    (folder / "program.yaml").write_text(
        re.sub("arrays_sha256: .*", f"arrays_sha256: {digest}", text)
    )


def chip_files(folder):
    """Write the description of a chip."""
    (folder / "chip.yaml").write_text(hw.chip("loihi-sim").document)
    return ["chip.yaml"]


def training_configs(folder):
    """Write a training configuration."""
    lines = [
        "model: hybrid",
        "order: whorl",
        "hidden: 16",
        "learning_rate: 0.003",
        "refit: true",
        "epochs: 20",
    ]
    (folder / "run.yaml").write_text(
        "\n".join([*lines, "event_dropout: 0.5", "target: float", "theta: 10.0", ""])
    )
    return ["run.yaml"]


def read_training_config(folder, name):
    """Read a training configuration and check its values."""
    return config_from_mapping(read_config(folder / name))


def reports(folder):
    """Write two equal builds, the report of one of which is damaged."""
    report = {
        "schema": "locsnn-report/1",
        "model": {"name": "m", "sha256": "0"},
        "match": {"samples": 3, "x": [1, 2.5]},
    }
    programs(folder)
    (folder / "report.json").write_text(json.dumps(report, indent=1))
    shutil.copytree(folder, folder / "before")
    return ["report.json"]


def compare_builds(folder, _):
    """Compare both builds, as a summary and figure by figure."""
    with contextlib.redirect_stdout(io.StringIO()):
        builds = {
            "before": folder / "before",
            "after": folder,
            "json": False,
            "html": None,
            "events": None,
        }
        # The summary asks for figures that the small report here does not have.
        with contextlib.suppress(InputError):
            diff.run(Namespace(**builds, all=False))
        diff.run(Namespace(**builds, all=True))


def read_events(folder, name):
    """Read recordings from a file, or from the folder that holds it."""
    recordings_read = read_recordings(folder / Path(name).parts[0])
    assert recordings_read.spikes.dtype == np.uint8
    return recordings_read


def read_raw(folder, _):
    """Read raw events, whichever of their two files is damaged."""
    return read_recordings(folder / "a.tact")


READERS = [
    Reader("checkpoint", "zip", checkpoints, lambda folder, name: lc.load(folder / name)),
    Reader("NIR graph", "hdf5", nir_files, lambda folder, name: lc.load(folder / name, dt=1e-3)),
    Reader("lava-dl network", "hdf5", net_files, lambda folder, name: lc.load(folder / name)),
    Reader("slayer checkpoint", "zip", slayer_checkpoints, lambda folder, name: lc.load(folder / name, folder / "net.yaml")),
    Reader("slayer YAML", "text", slayer_configs, lambda folder, _: lc.load(folder / "model.pt", folder / "net.yaml")),
    Reader("events .npy", "bytes", recordings("a.npy"), read_events),
    Reader("labels .npy", "bytes", labels_beside, lambda folder, _: read_recordings(folder / "a.npy")),
    Reader("events .npz", "zip", recordings("a.npz"), read_events),
    Reader("events .pt", "zip", recordings("a.pt"), read_events),
    Reader("structured .npy", "bytes", recordings("a_label_1.npy", structured=True, one=True), read_events),
    Reader("structured .npz", "zip", recordings("a_label_1.npz", structured=True, one=True), read_events),
    Reader("raw .tact", "text", raw_text, read_raw),
    Reader("raw .startend", "text", phases, read_raw),
    Reader("SLAYER .bs1", "bytes", recordings("a_label_1.bs1", one=True), read_events),
    Reader("SLAYER .bs2", "bytes", recordings("a_label_1.bs2", one=True), read_events),
    Reader("archive", "zip", recordings("a.zip"), read_events),
    Reader("archive of .bs1", "zip", recordings("a.zip", members="bs1"), read_events),
    Reader("archive of .tact", "zip", recordings("a.zip", members="tact"), read_events),
    Reader("folder", "bytes", member_folder, read_events),
    Reader("HDF5 recordings", "hdf5", spike_times, read_events),
    Reader("N-MNIST .bin", "bytes", class_folders, read_events),
    Reader("layout YAML", "text", layouts, lambda folder, name: read_layout(folder / name)),
    Reader("program.yaml", "text", program_texts, play_program),
    Reader("program.npz", "zip", program_arrays, play_program, mend_checksum),
    Reader("chip file", "text", chip_files, lambda folder, name: hw.chip(folder / name)),
    Reader("training YAML", "text", training_configs, read_training_config),
    Reader("report.json", "text", reports, compare_builds),
]  # fmt: skip
torch.set_num_threads(1)
