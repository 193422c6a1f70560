"""Folders of ``--emit xylo`` in rockpool, the vendor's framework: their own script ``run.py`` says that every spike is equal."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from make_environments import python_of, why_missing
from recorded_sets import RECORDINGS
from trained_for_xylo import CHIP, SETS, compiled_for

import locsnn_compile as lc
from hw_model.xylo.fast import play_fast
from hw_model.xylo.playing import rows_of
from locsnn_compile.emitters import ShownRecording
from tests.support.small_xylo_networks import NETWORKS, touches
from tests.support.witness_files import REGISTERS
from tests.xylo.record import ask_witness

pytestmark = pytest.mark.peers

WITHOUT_SAMNA = Path(__file__).parent / "without_samna.py"


@pytest.fixture
def python() -> Path:
    reason = why_missing("xylosim")
    if reason:
        pytest.skip(f"xylosim: {reason}")
    return python_of("xylosim")


def last_line_of_script(python: Path, compiled: lc.CompiledXylo, recording, folder: Path) -> str:
    """Write the folder for a recording, run its script in rockpool, and return the last line that it prints."""
    for file, content in compiled.files(["xylo"], ShownRecording(recording)).items():
        (folder / file).parent.mkdir(exist_ok=True)
        (folder / file).write_bytes(content)
    run = subprocess.run(
        [str(python), str(WITHOUT_SAMNA), str(folder / "xylo" / "run.py")],
        env={"HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout.splitlines()[-1]


@pytest.mark.parametrize("chip", ["xylo-audio2", "xylo-audio3", "xylo-imu"])
@pytest.mark.parametrize("name", NETWORKS)
def test_the_emitted_script_finds_every_spike_equal_in_rockpool(name, chip, python, tmp_path):
    compiled = lc.compile(NETWORKS[name](), target=chip, events=touches())
    last_line = last_line_of_script(python, compiled, touches()[0], tmp_path)
    assert last_line == f"{chip}: every spike is equal"


@pytest.mark.parametrize("name", SETS)
def test_trained_networks_play_as_in_xylosim_and_rockpool(name, python, tmp_path):
    """Every register of all recordings in xylosim, and the emitted folder of the first in rockpool."""
    compiled, recordings = compiled_for(name, RECORDINGS)
    network = compiled.program.network
    cases = [(network, rows_of(recording)) for recording in recordings]
    values = 0
    spikes = 0
    for (_, rows), witness in zip(cases, ask_witness(python, cases, tmp_path), strict=True):
        result = play_fast(network, rows)
        for register in REGISTERS:
            assert (getattr(result, register) == witness[register]).all(), register
            values += witness[register].size
        spikes += int(result.spikes.sum())
    assert spikes > 100
    last_line = last_line_of_script(python, compiled, recordings[0], tmp_path)
    assert last_line == f"{CHIP}: every spike is equal"
    played = f"{len(cases)} recordings, {values:,} values, 0 differ ({spikes:,} hidden spikes)"
    print(f"\nxylosim: {name}, {played}; rockpool: {last_line}")
