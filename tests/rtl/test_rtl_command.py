"""``locsnn rtl sim``: what it prints, exit code 3 on a planted fault, and where built simulators are kept."""

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
    """Return the arguments of the command for a small program and its recording."""
    small, spikes = benches.hybrid(22)
    small.save(tmp_path / "program")
    np.save(tmp_path / "spikes.npy", spikes.transpose(0, 2, 1))
    events = str(tmp_path / "spikes.npy")
    program = str(tmp_path / "program")
    return ["rtl", "sim", program, "--events", events, "--simulator", "icarus", "--json"]


KEYS = [
    "recordings",
    "compared_values",
    "mismatches",
    "cycles",
    "predicted_cycles",
    "cycle_mismatches",
    "assumptions",
]


@pytest.mark.slow
def test_the_core_and_the_simulator_agree_in_every_value_and_every_cycle(
    cores_of_this_run, arguments, capsys
):
    assert locsnn.main(arguments) == 0
    printed = json.loads(capsys.readouterr().out)
    assert list(printed) == KEYS
    assert printed["recordings"] == 1
    assert printed["mismatches"] == 0
    assert printed["cycle_mismatches"] == 0
    assert printed["cycles"] == printed["predicted_cycles"]


@pytest.mark.slow
def test_a_fault_is_counted_and_ends_with_exit_code_3(
    cores_of_this_run, arguments, capsys, monkeypatch
):
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
    """A user without a cache folder that can be written, or without a home, gets a folder that the process removes."""
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


def test_a_simulator_that_is_not_installed_is_named(no_core, arguments, capsys, monkeypatch):
    monkeypatch.setenv("PATH", "")
    assert locsnn.main(arguments) == 2
    expected = "simulator 'icarus': iverilog is not installed. Install it with: apt-get install iverilog (Debian).\n"
    assert capsys.readouterr().err == expected


def test_a_missing_interpreter_of_a_built_core_is_named(
    cores_of_this_run, arguments, capsys, monkeypatch
):
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
