"""``locsnn rtl sim``: what it prints, and exit code 3 on a planted fault."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from hw_model.rtl import simulators
from hw_model.rtl.cosimulation import UNKNOWN, bench_numbers
from locsnn_compile.cli import main as locsnn
from tests.support import benches

pytestmark = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)


@pytest.fixture
def arguments(tmp_path):
    """Return the arguments for a program and a recording of it."""
    program, spikes = benches.hybrid(22)
    program.save(tmp_path / "program")
    np.save(tmp_path / "spikes.npy", spikes.transpose(0, 2, 1))
    events = str(tmp_path / "spikes.npy")
    return [
        "rtl",
        "sim",
        str(tmp_path / "program"),
        "--events",
        events,
        "--simulator",
        "icarus",
        "--json",
    ]


@pytest.mark.slow
def test_equal(cores_of_this_run, arguments, capsys):
    """The core and the reference engine agree in every value and every cycle."""
    assert locsnn.main(arguments) == 0
    printed = json.loads(capsys.readouterr().out)
    keys = [
        "recordings",
        "compared_values",
        "mismatches",
        "cycles",
        "predicted_cycles",
        "cycle_mismatches",
        "assumptions",
    ]
    assert list(printed) == keys
    assert printed["recordings"] == 1
    assert printed["mismatches"] == 0
    assert printed["cycle_mismatches"] == 0
    assert printed["cycles"] == printed["predicted_cycles"]


@pytest.mark.slow
def test_a_fault(cores_of_this_run, arguments, capsys, monkeypatch):
    texts = benches.with_fault(simulators.sources())
    monkeypatch.setattr(simulators, "sources", lambda: texts)
    assert locsnn.main(arguments) == 3
    assert json.loads(capsys.readouterr().out)["mismatches"] > 0


def test_what_the_logic_leaves_undefined_equals_nothing(tmp_path):
    (tmp_path / "updates").write_text("3 x 0\nX z -1\n")
    numbers = bench_numbers(tmp_path / "updates", (2, 4))
    # What is undefined is UNKNOWN, and what the bench did not write is -1.
    assert numbers.tolist() == [[3, UNKNOWN, 0, UNKNOWN], [UNKNOWN, -1, -1, -1]]


def test_a_simulator_is_kept_where_it_can_be(tmp_path, monkeypatch):
    """Who has no cache folder, or none to write to, or no home at all, gets one that goes with the process."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert simulators.cache_path("a") == tmp_path / "locsnn/a"
    monkeypatch.setattr("os.access", lambda *_: False)
    temporary = simulators.cache_path("a")
    assert temporary.parent.is_dir()
    assert tmp_path not in temporary.parents
    # What is there already is used, even where nothing can be written.
    (tmp_path / "locsnn/a").touch()
    assert simulators.cache_path("a") == tmp_path / "locsnn/a"
    monkeypatch.undo()
    monkeypatch.setenv("XDG_CACHE_HOME", "/dev/null/cache")
    assert simulators.cache_path("a") == temporary
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr("os.path.expanduser", lambda path: path)
    assert simulators.cache_path("a") == temporary


@pytest.fixture
def no_core(tmp_path, monkeypatch):
    """Begin without any core that was built before."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_a_missing_simulator(no_core, arguments, capsys, monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert locsnn.main(arguments) == 2
    expected = "simulator 'icarus': iverilog is not installed. Install it with: apt-get install iverilog (Debian).\n"
    assert capsys.readouterr().err == expected


def test_what_plays_a_built_core_is_missing(cores_of_this_run, arguments, capsys, monkeypatch):
    assert locsnn.main(arguments) == 0
    capsys.readouterr()
    monkeypatch.setenv("PATH", "")
    assert locsnn.main(arguments) == 2
    expected = (
        "the open core: vvp is not installed. Install it with: apt-get install iverilog (Debian).\n"
    )
    assert capsys.readouterr().err == expected


@pytest.mark.slow
def test_building_the_core_is_named_and_done_once(no_core, arguments, caplog):
    caplog.set_level("INFO", logger="locsnn")
    built = "building the core with icarus, once for its sizes: up to a minute"
    assert locsnn.main(arguments) == 0
    assert caplog.messages.count(built) == 1
    caplog.clear()
    assert locsnn.main(arguments) == 0
    assert built not in caplog.messages
