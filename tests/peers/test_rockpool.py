"""Emitted folders for a Xylo in rockpool itself: ``xylo/run.py`` finds every spike equal."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from make_environments import python_of, why_missing

import locsnn_compile as lc
from locsnn_compile.emitters import ShownRecording

sys.path.insert(0, str(Path(__file__).parents[1] / "xylo"))
from small_networks import NETWORKS, touches

pytestmark = pytest.mark.peers

WITHOUT_SAMNA = Path(__file__).parent / "without_samna.py"


@pytest.mark.parametrize("chip", ["xylo-audio2", "xylo-audio3", "xylo-imu"])
@pytest.mark.parametrize("name", NETWORKS)
def test_the_emitted_script_finds_every_spike_equal_in_rockpool(name, chip, tmp_path):
    reason = why_missing("xylosim")
    if reason:
        pytest.skip(f"xylosim: {reason}")
    compiled = lc.compile(NETWORKS[name](), target=chip, events=touches())
    for file, content in compiled.files(["xylo"], ShownRecording(touches()[0])).items():
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_bytes(content)
    run = subprocess.run(
        [str(python_of("xylosim")), str(WITHOUT_SAMNA), str(tmp_path / "xylo" / "run.py")],
        env={"HOME": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.stdout.splitlines()[-1:] == [f"{chip}: every spike is equal"], run.stderr
    assert run.returncode == 0
