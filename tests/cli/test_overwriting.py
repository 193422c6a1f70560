"""No command overwrites what it reads, or removes what it did not write.

Each is refused in one line, and afterwards the folder holds the same files with the same bytes as before.
"""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model.io.build_folder import write_build
from hw_model.io.files import replace_file
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn_main
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings
from locsnn_compile.emitters import NAMES_IN_FOLDERS

ROOT = Path(__file__).parents[2]
MODEL = ROOT / "examples/models/objects-hybrid.pt"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Recordings, a model and a chip under several names, two builds, and folders where a build has files."""
    monkeypatch.chdir(tmp_path)
    touches = synthetic_touches(4, steps=20, classes=2, seed=1)
    write_recordings("d.pt", touches)
    write_recordings("d.npz", touches)
    write_recordings("recs", touches)
    spikes = np.load("recs/sample_0_label_0.npy")
    np.save("few.npy", spikes[None])
    np.save("few_labels.npy", np.array([0]))
    for name in (
        "m.pt",
        "network.nir",
        "run/events.npz",
        "out/sanafe/arch.yaml",
        "out/report.json/mine",
    ):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_bytes(MODEL.read_bytes() if name == "m.pt" else b"mine")
    write_recordings("run/events.npz", touches)
    Path("chip.yaml").write_text(hw.chip("loihi-sim").document)
    Path("link.pt").symlink_to("d.pt")
    os.link("d.pt", "second-name.pt")
    for name in (
        "a/report.json",
        "b/program.yaml",
        "b/report.html",
        "vec/vectors/notes.txt",
        "old.csv",
        "old.svg",
    ):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text("mine")
    Path("file").mkdir()
    Path("file/vectors").write_text("mine")
    Path("here").symlink_to(".")
    os.mkfifo("pipe")
    return tmp_path


def tree(folder):
    """Return what lies in a folder: of files their bytes and numbers, of links where they lead."""
    contents = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        number = path.lstat().st_ino
        if path.is_symlink():
            contents[name] = (number, os.readlink(path))
        else:
            contents[name] = (number, path.read_bytes() if path.is_file() else None)
    return contents


ELSEWHERE = "Write somewhere else."
# Each row: its id, a command, and the line on standard error.
REFUSED = [
    ("train, its data", "locsnn train --data d.pt -o d.pt", f"-o 'd.pt': it would overwrite 'd.pt' (--data). {ELSEWHERE}"),
    ("train, otherwise spelt", "locsnn train --data d.pt -o ./recs/../d.pt", f"-o './recs/../d.pt': it would overwrite 'd.pt' (--data). {ELSEWHERE}"),
    ("train, by way of a linked folder", "locsnn train --data d.pt -o here/d.pt", f"-o 'here/d.pt': it would overwrite 'd.pt' (--data). {ELSEWHERE}"),
    ("train, a link to its data", "locsnn train --data d.pt -o link.pt", f"-o 'link.pt': it would overwrite 'link.pt' (--data). {ELSEWHERE}"),
    ("train, data by a link", "locsnn train --data link.pt -o d.pt", f"-o 'd.pt': it would overwrite 'd.pt' (--data). {ELSEWHERE}"),
    ("train, a second name of its data", "locsnn train --data d.pt -o second-name.pt", f"-o 'second-name.pt': it would overwrite 'second-name.pt' (--data). {ELSEWHERE}"),
    ("train, its start", "locsnn train --data d.npz --from m.pt -o m.pt", f"-o 'm.pt': it would overwrite 'm.pt' (--from). {ELSEWHERE}"),
    ("train, its configuration", "locsnn train --data d.npz --config c.csv -o c.pt", f"-o 'c.pt': it would overwrite 'c.csv' (--config). {ELSEWHERE}"),
    ("train, a table beside", "locsnn train --data d.npz -o old.pt", "-o 'old.pt': 'old.csv' next to it would be replaced, but no training wrote it. Write elsewhere."),
    ("junit, the model", "locsnn-compile m.pt -o o --max-cores 9 --junit m.pt", f"--junit 'm.pt': it would overwrite 'm.pt' (MODEL). {ELSEWHERE}"),
    ("junit, the events", "locsnn-compile m.pt -o o --events d.npz --max-cores 9 --junit d.npz", f"--junit 'd.npz': it would overwrite 'd.npz' (--events). {ELSEWHERE}"),
    ("junit, a recording of a folder", "locsnn-compile m.pt -o o --events recs --max-cores 9 --junit recs/sample_1_label_1.npy", f"--junit 'recs/sample_1_label_1.npy': it would overwrite 'sample_1_label_1.npy' (--events). {ELSEWHERE}"),
    ("junit, labels beside", "locsnn-compile m.pt -o o --events few.npy --max-cores 9 --junit few_labels.npy", f"--junit 'few_labels.npy': it would overwrite 'few_labels.npy' (--events). {ELSEWHERE}"),
    ("junit, the chip", "locsnn-compile m.pt -o o --target chip.yaml --max-cores 9 --junit chip.yaml", f"--junit 'chip.yaml': it would overwrite 'chip.yaml' (--target). {ELSEWHERE}"),
    ("junit, the profile", "locsnn-compile m.pt -o o --profile chip.yaml --max-cores 9 --junit chip.yaml", f"--junit 'chip.yaml': it would overwrite 'chip.yaml' (--profile). {ELSEWHERE}"),
    ("junit, the report", "locsnn-compile m.pt -o o --max-cores 9 --junit o/report.json", f"--junit 'o/report.json': -o 'o' writes 'report.json' there. {ELSEWHERE}"),
    ("junit, among vectors", "locsnn-compile m.pt -o o --emit vectors --max-cores 9 --junit o/vectors/g.xml", f"--junit 'o/vectors/g.xml': -o 'o' writes 'vectors' there. {ELSEWHERE}"),
    ("junit, a folder", "locsnn-compile m.pt -o o --max-cores 9 --junit recs", "--junit 'recs': it is a folder. Give the name of a file."),
    ("junit, a pipe", "locsnn-compile m.pt -o o --max-cores 9 --junit pipe", "--junit 'pipe': it is not a plain file. Give the name of a file."),
    ("compile, the model emitted again", "locsnn-compile network.nir --emit nir -o .", f"-o '.': it would overwrite 'network.nir' (MODEL). {ELSEWHERE}"),
    ("compile, a chip that was emitted", "locsnn-compile m.pt --target out/sanafe/arch.yaml --emit sanafe -o out", "output 'out': cannot be written: it holds a folder 'report.json', which would be removed. With -o, choose a folder that you may write to."),
    ("compile, a folder called as a report", "locsnn-compile m.pt -o out", "output 'out': cannot be written: it holds a folder 'report.json', which would be removed. With -o, choose a folder that you may write to."),
    ("compile, notes among vectors", "locsnn-compile m.pt -o vec --emit vectors", "output 'vec': cannot be written: it holds 'vectors/notes.txt', which was not written here and would be removed. With -o, choose a folder that you may write to."),
    ("compile, a file called as vectors", "locsnn-compile m.pt -o file --emit vectors", "output 'file': cannot be written: it holds a file 'vectors', which would be removed. With -o, choose a folder that you may write to."),
    ("compile, the root", "locsnn-compile m.pt -o /", "output '/': cannot be written: it is the root of the file system. With -o, choose a folder that you may write to."),
    ("explore, a part of the events", "locsnn explore m.pt --events run/events.npz --recordings 2 -o run", f"-o 'run': it would overwrite 'events.npz' (--events). {ELSEWHERE}"),
    ("explore, other events", "locsnn explore m.pt --events d.npz --recordings 2 --calibration run/events.npz -o run", f"-o 'run': it would overwrite 'events.npz' (--calibration). {ELSEWHERE}"),
    ("events, the same file", "locsnn events d.npz --to ./d.npz", f"--to 'd.npz': it would overwrite 'd.npz' (FILE). {ELSEWHERE}"),
    ("events, a file of the folder", "locsnn events recs --to recs/sample_0_label_0.npy", f"--to 'recs/sample_0_label_0.npy': it would overwrite 'sample_0_label_0.npy' (FILE). {ELSEWHERE}"),
    ("events, the folder itself", "locsnn events recs --to recs", "folder 'recs': it is not empty, and recordings would mix. Name a new folder, or a .zip."),
    ("diff, a report", "locsnn diff a b --html a/report.json", f"--html 'a/report.json': it would overwrite 'report.json' (BUILD_A, report.json). {ELSEWHERE}"),
    ("diff, a program", "locsnn diff a b --html b/program.yaml", f"--html 'b/program.yaml': it would overwrite 'program.yaml' (BUILD_B, program.yaml). {ELSEWHERE}"),
    ("diff, a page", "locsnn diff a b --html b/report.html", f"--html 'b/report.html': it would overwrite 'report.html' (BUILD_B, report.html). {ELSEWHERE}"),
    ("stress, the chip", "locsnn stress --quick --target chip.yaml -o chip.yaml", f"-o 'chip.yaml': it would overwrite 'chip.yaml' (--target). {ELSEWHERE}"),
]  # fmt: skip


def run(command):
    """Run a command as typed; return its exit code."""
    program, *arguments = shlex.split(command)
    return (compile_main if program == "locsnn-compile" else locsnn_main)(arguments)


@pytest.mark.parametrize(
    ("command", "line"), [row[1:] for row in REFUSED], ids=[row[0] for row in REFUSED]
)
def test_outputs_that_would_take_the_place_of_something(command, line, folder, capsys):
    Path("c.csv").write_text("hidden: 4\n")
    before = tree(folder)
    assert (run(command), capsys.readouterr()) == (2, ("", f"{line}\n"))
    assert tree(folder) == before


def test_a_file_in_a_folder_of_recordings_that_is_none_may_be_written_again(folder, capsys):
    for _ in range(2):
        assert run("locsnn events recs -o recs/raster.svg") == 0
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_a_model_may_lie_in_the_folder_of_its_build(folder, capsys):
    Path("own").mkdir()
    os.link("m.pt", "own/m.pt")
    assert run("locsnn-compile own/m.pt --events few.npy --strategy dendrite -o own --quiet") == 0
    assert Path("own/m.pt").read_bytes() == MODEL.read_bytes()
    assert Path("own/report.json").is_file()


def test_writing_to_a_link_writes_what_it_leads_to(tmp_path):
    (tmp_path / "real").write_bytes(b"1")
    (tmp_path / "link").symlink_to("real")
    replace_file(tmp_path / "link", b"2", "out")
    assert (os.readlink(tmp_path / "link"), (tmp_path / "real").read_bytes()) == ("real", b"2")


def test_a_program_is_not_saved_over_folders(tmp_path):
    builder = hw.ProgramBuilder(hw.chip("tiny-sim"))
    builder.connect(
        builder.add_input("x", 1),
        builder.add_compartments("h", 1, decay_u=4096, decay_v=0, threshold=10),
        [[20]],
    )
    (tmp_path / "program.npz").mkdir()
    with pytest.raises(hw.InputError) as caught:
        builder.build().save(tmp_path)
    assert str(caught.value) == (
        f"folder {tmp_path.name!r}: cannot be written: it holds a folder 'program.npz', which would be removed. "
        "Choose a folder that you may write to."
    )
    assert [path.name for path in tmp_path.iterdir()] == ["program.npz"]


def test_a_build_removes_what_an_earlier_build_had_in_its_folders_alone(tmp_path):
    earlier = (
        "vectors/core12/spikes.hex",
        "vectors/README.md",
        "sanafe/location.yaml",
        "csv/spikes.csv",
    )
    write_build(tmp_path, dict.fromkeys(earlier, b"old"), NAMES_IN_FOLDERS)
    write_build(
        tmp_path,
        {"vectors/manifest.yaml": b"new", "sanafe/time.yaml": b"new", "csv/figures.csv": b"new"},
        NAMES_IN_FOLDERS,
    )
    files = sorted(
        path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()
    )
    assert files == ["csv/figures.csv", "sanafe/time.yaml", "vectors/manifest.yaml"]
