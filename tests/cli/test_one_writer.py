"""Two processes that write one output at once, links that lead nowhere, and files that declare more than they hold.

Each is refused before any work is done.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from hw_model.errors import InputError
from hw_model.io.files import pack_files
from hw_model.io.npy import MAX_VALUES
from hw_model.io.partial import claimed
from hw_model.io.zip_directory import BoundedZip
from locsnn_compile.cli.main import main

BUSY = "another process is writing it. Wait for it, or write somewhere else.\n"
claims = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such locks")


@pytest.fixture
def few(tmp_path, monkeypatch):
    """A folder with recordings in which commands run."""
    monkeypatch.chdir(tmp_path)
    np.savez("few.npz", spikes=np.ones((2, 3, 20), dtype=np.uint8), labels=np.arange(2))
    return tmp_path


@claims
@pytest.mark.parametrize(
    ("command", "target", "where"),
    [
        (["events", "few.npz", "--to", "out"], "out", "folder 'out'"),
        (["train", "--data", "few.npz", "-o", "out.pt"], "out.pt", "-o 'out.pt'"),
    ],
    ids=["events", "train"],
)
def test_the_second_of_two_writers_is_refused(command, target, where, few, capsys):
    with claimed(Path(target), "first"):
        assert main(command) == 2
    assert capsys.readouterr() == ("", f"{where}: {BUSY}")
    assert sorted(os.listdir(few)) == ["few.npz"]


@claims
def test_a_claim_ends_with_its_writer(few):
    for _ in range(2):
        with claimed(Path("out"), "first"):
            assert len(os.listdir(few)) == 2
    with pytest.raises(KeyboardInterrupt), claimed(Path("out"), "first"):
        raise KeyboardInterrupt
    assert os.listdir(few) == ["few.npz"]


@pytest.mark.parametrize(
    "command",
    [["locsnn", "events", "few.npz", "--to", "loop"], ["compile", "few.npz", "-o", "loop"]],
    ids=["events", "compile"],
)
def test_a_link_that_leads_to_itself_is_refused_before_the_work(command, few, capsys):
    Path("loop").symlink_to("loop")
    assert main(command[command[0] == "locsnn" :]) == 2
    assert capsys.readouterr().err.endswith(
        "its links lead in a circle. Give another path, or remove them.\n"
    )


def test_a_header_that_claims_too_much_is_refused_before_its_values_are_unpacked(
    few, capsys, monkeypatch
):
    header = f"{{'descr': '|u1', 'fortran_order': False, 'shape': ({MAX_VALUES + 1},), }}".encode()
    entry = b"\x93NUMPY\1\0" + len(header).to_bytes(2, "little") + header + bytes(100_000)
    Path("large.npz").write_bytes(pack_files([("spikes.npy", entry)], compressed=True))
    unpacked = []
    content = BoundedZip.content

    def counted(*given):
        unpacked.append(len(content(*given)))
        return content(*given)

    monkeypatch.setattr(BoundedZip, "content", counted)
    assert main(["events", "large.npz"]) == 2
    line = "its declared shape is too large (200000001 against 200000000 values). Give a smaller array."
    assert capsys.readouterr().err == f"file 'large.npz', 'spikes.npy': {line}\n"
    assert unpacked == [16384]


def test_arrays_that_belong_to_nothing_in_a_program_are_refused(few):
    import hashlib

    import hw_model as hw

    builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
    x, y = builder.add_input("x", 1), builder.add_compartments("y", 1, threshold=1)
    builder.connect(x, y, np.full((1, 1), 2))
    builder.build().save("program")
    arrays = Path("program/program.npz")
    text = Path("program/program.yaml")
    with np.load(arrays) as stored:
        more = {**stored, "core9/extra": np.zeros(1, dtype=np.int64)}
    before = hashlib.sha256(arrays.read_bytes()).hexdigest()
    np.savez(arrays, **more)
    after = hashlib.sha256(arrays.read_bytes()).hexdigest()
    document = text.read_text().replace(before, after)
    text.write_text(document[: document.rindex("# SHA-256")])
    with pytest.raises(InputError) as caught:
        hw.load_program("program")
    line = "program.npz: it holds arrays without a meaning (core9/extra). Compile again."
    assert str(caught.value) == line
