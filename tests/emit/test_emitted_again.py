"""A build into the folder of an earlier build: files that ``--emit`` wrote are replaced, files of others are kept.

A folder that holds a file of somebody else is not touched, and the build is refused.
"""

from __future__ import annotations

import itertools
import re

import nir
import numpy as np
import pytest

import hw_model as hw
from hw_model.description.boards import BOARDS
from hw_model.rtl.folder import rtl_files
from locsnn_compile.cli.compile import main
from locsnn_compile.emitters import EMITTERS, NAMES_IN_FOLDERS

CHANNELS = 6
FOLDERS = {emitter.kind: emitter for emitter in EMITTERS if emitter.path.endswith("/")}
"""The emitters that write a folder, by kind."""
TARGETS = {"xylo": "xylo-audio3", "pynn": "spinnaker1"}
"""The chip that a kind is for; all other kinds are for loihi-sim."""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with a small NIR graph of leaky neurons with a current, and recordings for it."""
    folder = tmp_path_factory.mktemp("again")
    r = np.random.default_rng(0)
    nodes = {
        "input": nir.Input(np.array([CHANNELS])),
        "into": nir.Linear(r.normal(0.05, 0.3, (4, CHANNELS))),
        "hidden": leaky(4),
        "out of": nir.Linear(r.normal(0.05, 0.4, (2, 4))),
        "classes": leaky(2),
        "output": nir.Output(np.array([2])),
    }
    edges = list(itertools.pairwise(nodes))
    nir.write(folder / "leaky.nir", nir.NIRGraph(nodes, edges, type_check=False))
    np.save(folder / "few.npy", (r.random((3, CHANNELS, 20)) < 0.2).astype(np.uint8))
    return folder


def leaky(size):
    """Return a NIR node of leaky neurons with a current."""
    ones = np.ones(size)
    return nir.CubaLIF(
        tau_syn=4e-3 * ones,
        tau_mem=8e-3 * ones,
        r=8 * ones,
        w_in=4 * ones,
        v_leak=0 * ones,
        v_threshold=ones,
        v_reset=0 * ones,
    )


def build(place, folder, kind):
    """Build the graph of ``place`` into a folder with files of a kind, and return the exit code."""
    # Xylo subtracts its threshold after a spike; the other chips reset to 0.
    reset = "subtract" if kind == "xylo" else "zero"
    arguments = [place / "leaky.nir", "--dt", "1e-3", "--reset", reset]
    arguments += ["--events", place / "few.npy", "--target", TARGETS.get(kind, "loihi-sim")]
    arguments += ["--emit", kind, "--quiet", "-o", folder]
    return main([str(argument) for argument in arguments])


@pytest.mark.slow
@pytest.mark.parametrize("kind", FOLDERS)
def test_a_second_build_replaces_the_folder_that_the_first_emitted(kind, place, tmp_path):
    assert build(place, tmp_path / "out", kind) == 0
    emitted = tmp_path / "out" / FOLDERS[kind].path
    names = sorted(path for path in emitted.rglob("*") if path.is_file())
    names[0].write_bytes(b"of the first build")
    assert build(place, tmp_path / "out", kind) == 0
    assert sorted(path for path in emitted.rglob("*") if path.is_file()) == names
    assert names[0].read_bytes() != b"of the first build"


@pytest.mark.slow
@pytest.mark.parametrize("target", sorted({*BOARDS.values(), "locsnn-130nm"}))
def test_all_files_of_an_open_core_may_be_replaced(target):
    """``NAMES_IN_FOLDERS`` matches the names of files that emitters write, which a later build may remove."""
    builder = hw.ProgramBuilder(hw.chip(target))
    line = builder.add_input("line", 1)
    cell = builder.add_compartments("cell", 2, decay_u=4096, threshold=15)
    builder.connect(line, cell, [[20], [20]])
    builder.read_out(cell)
    emitted = rtl_files(builder.build(), np.ones((4, 1), np.uint8))
    assert [name for name in emitted if not re.fullmatch(NAMES_IN_FOLDERS, name)] == []


@pytest.mark.parametrize("kind", FOLDERS)
def test_a_build_is_refused_where_others_wrote_into_the_folder(kind, place, tmp_path, capsys):
    path = FOLDERS[kind].path
    (tmp_path / "out" / path).mkdir(parents=True)
    notes = tmp_path / "out" / path / "notes.txt"
    notes.write_text("mine")
    assert build(place, tmp_path / "out", kind) == 2
    assert capsys.readouterr().err.strip() == (
        f"output {str(tmp_path / 'out')!r}: cannot be written: it holds '{path}notes.txt', which "
        "was not written here and would be removed. With -o, choose a folder that you may write to."
    )
    assert notes.read_text() == "mine"


@pytest.mark.parametrize("name", ["rtl/solver/boolector", "rtl/core.smt2", "lava/network.py"])
def test_what_tools_leave_in_an_emitted_folder_is_replaced_with_it(name):
    assert re.fullmatch(NAMES_IN_FOLDERS, name)
