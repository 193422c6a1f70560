"""Files and folders are written whole or not at all, whenever the writer is killed, and other files in a folder stay.

Folders are replaced by exchanging two names or, where the system or the folder does not allow it, by a second way or
a journal. Each way is a ``mode`` of these tests.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model.io import folders
from hw_model.io.files import replace_file
from hw_model.io.partial import locked, partial_path
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL

WRITER = Path(__file__).with_name("kill_writer.py")


def kill_writers(mode, folder):
    """Run ``kill_writer.py``, which kills writers at many moments, and return what each left behind."""
    process = subprocess.run(
        [sys.executable, str(WRITER), mode, str(folder)],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert (process.returncode, process.stderr) == (0, "")
    return json.loads(process.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["exchange", "no exchange", "journal", "file", "random"])
def test_a_killed_writer_leaves_old_or_new(mode, tmp_path):
    outcomes = kill_writers(mode, tmp_path / "place")
    assert outcomes["other"] == []
    assert outcomes["old"] + outcomes["new"] == outcomes["killed"]
    assert min(outcomes["old"], outcomes["new"]) >= 1


@pytest.fixture(params=["exchange", "no exchange", "journal"])
def mode(request, monkeypatch):
    """A way in which folders are replaced."""
    if request.param == "no exchange":
        monkeypatch.setattr(folders, "_renameat2", lambda: None)
    if request.param == "journal":
        monkeypatch.setattr(folders, "_must_stay", lambda folder: True)
    return request.param


def names(folder):
    """Return the paths of everything in a folder."""
    return sorted(file.relative_to(folder).as_posix() for file in folder.rglob("*"))


def test_other_files_of_a_folder_stay_when_its_own_are_replaced(mode, tmp_path):
    out = tmp_path / "out"
    folders.replace_entries(out, {"a": b"1", "deep/b": b"1", "deep/c": b"1"})
    (out / "points").mkdir()
    (out / "points/p.json").write_bytes(b"{}")
    (out / "link").symlink_to("nowhere")
    out.chmod(0o750)
    folders.replace_entries(out, {"a": b"2", "deep/b": b"2"})
    assert names(tmp_path) == [
        "out",
        "out/a",
        "out/deep",
        "out/deep/b",
        "out/link",
        "out/points",
        "out/points/p.json",
    ]
    assert ((out / "a").read_bytes(), (out / "deep/b").read_bytes()) == (b"2", b"2")
    assert (os.readlink(out / "link"), oct(out.stat().st_mode & 0o777)) == ("nowhere", "0o750")


@pytest.mark.parametrize(
    ("files", "line"),
    [
        ({"a/d": b"2"}, "it holds a file 'a', which would be removed"),
        ({"b": b"2"}, "it holds a folder 'b', which would be removed"),
        ({"b/d": b"2"}, "it holds 'b/c', which was not written here and would be removed"),
    ],
    ids=["a folder for a file", "a file for a folder", "what is not ours"],
)
def test_a_file_takes_the_place_of_files_alone_and_a_folder_of_folders(mode, files, line, tmp_path):
    out = tmp_path / "out"
    folders.replace_entries(out, {"a": b"1", "b/c": b"1"})
    with pytest.raises(OSError, match=f"] {line}$"):
        folders.replace_entries(out, files, ours="b/d")
    assert names(tmp_path) == ["out", "out/a", "out/b", "out/b/c"]
    assert (out / "a").read_bytes() == b"1"


def test_a_folder_that_is_linked_to_stays_linked_to(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "latest").symlink_to("real")
    folders.replace_entries(tmp_path / "latest", {"a": b"1"})
    assert os.readlink(tmp_path / "latest") == "real"
    assert (tmp_path / "real/a").read_bytes() == b"1"


def test_the_folder_that_somebody_works_in_stays_that_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    inode = tmp_path.stat().st_ino
    for content in (b"1", b"2"):
        folders.replace_entries(Path("."), {"a": content, "deep/b": content})
    assert tmp_path.stat().st_ino == inode
    assert names(tmp_path) == ["a", "deep", "deep/b"]
    assert Path("a").read_bytes() == b"2"


def test_a_failed_write_leaves_the_folder_as_it_was(mode, tmp_path):
    out = tmp_path / "out"
    folders.replace_entries(out, {"a": b"1"})
    with pytest.raises(OSError, match="File name too long"):
        folders.replace_entries(out, {"a": b"2", "n" * 300: b"2"})
    assert names(tmp_path) == ["out", "out/a"]
    assert (out / "a").read_bytes() == b"1"


def test_leftovers_of_the_dead_are_removed_and_those_of_the_living_stay(tmp_path):
    out = tmp_path / "out.bin"
    dead = partial_path(out)
    living = partial_path(out)
    foreign = tmp_path / ".out.bin.partial-mine"
    for path in (dead, living, foreign):
        path.write_bytes(b"x")
    with locked(living):
        replace_file(out, b"1", "out")
        assert names(tmp_path) == sorted([living.name, foreign.name, out.name])
    replace_file(out, b"2", "out")
    assert names(tmp_path) == sorted([foreign.name, out.name])


def test_the_longest_name_can_be_written(tmp_path):
    name = "ü" * 127  # 254 bytes in UTF-8, of 255 that a name may have
    replace_file(tmp_path / name, b"1", "out")
    folders.replace_entries(tmp_path / ("f" + name), {"a": b"1"})
    assert names(tmp_path) == sorted([name, f"f{name}", f"f{name}/a"])


def program(weight):
    """Return a program all of whose weights are ``weight``."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x = builder.add_input("x", 2)
    h = builder.add_compartments("h", 2, decay_u=FORGETS_AT_ONCE, decay_v=KEEPS_ALL, threshold=10)
    builder.connect(x, h, np.full((2, 2), weight), weight_bits=8)
    return builder.build()


def test_a_program_whose_writing_was_cut_off_is_read(tmp_path):
    out = tmp_path / "out"
    program(4).save(out)
    os.rename(out, tmp_path / "journal")
    program(8).save(out)
    os.rename(tmp_path / "journal", out / folders.JOURNAL)
    loaded = hw.load_program(out)
    assert set(loaded.cores[0].axons.mantissa.tolist()) == {4}
    assert names(out) == ["program.npz", "program.yaml"]
