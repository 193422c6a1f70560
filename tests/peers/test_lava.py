"""Emitted programs in Lava's fixed-point models: every spike of every step, and u and v after the last one.

A thousand random programs are played by Lava's models in one process, and some by Lava as a whole.
``LOCSNN_LAVA_PROGRAMS`` is the number of these: 60 take a minute or two on an idle machine.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from make_environments import python_of, why_missing

import hw_model as hw
import locsnn_compile as lc

sys.path.insert(0, str(Path(__file__).parents[1] / "lava"))
from lava_folders import arrays_of, cases, differences, write_folder
from lava_programs import Case
from record_lava import DRIVER, ask_lava

pytestmark = pytest.mark.peers

ROOT = Path(__file__).parents[2]
PROGRAMS = int(os.environ.get("LOCSNN_LAVA_PROGRAMS", "60"))
PROGRAMS_OF_MODELS = int(os.environ.get("LOCSNN_LAVA_MODELS", "1000"))
MODELS = Path(__file__).parent / "drive_lava_models.py"
SHIPPED = {
    "objects-hybrid": "touches.npz",
    "containers-hybrid": "touches.npz",
    "two-fingertips": "two-fingertips.npz",
}
"""The shipped networks that Lava can play, lowered by ``reset``, with recordings for their channels."""


@pytest.fixture(autouse=True)
def needs_lava() -> None:
    reason = why_missing("lava")
    if reason:
        pytest.skip(f"lava: {reason}")


def compare(folder: Path, driver: Path = DRIVER) -> tuple[int, int]:
    """Play the folders below a folder; return how many values were compared, and how many spikes are among them."""
    compared = 0
    spikes = 0
    for name, played in ask_lava(python_of("lava"), folder, driver).items():
        expected = arrays_of(folder / name / "expected.npz")
        assert differences(played, expected) == 0, name
        compared += sum(values.size for values in expected.values())
        spikes += sum(
            int(values.sum()) for key, values in expected.items() if key.endswith("/spikes")
        )
    return compared, spikes


@pytest.mark.parametrize(
    ("driver", "count"),
    [
        pytest.param(DRIVER, PROGRAMS, id="Lava as a whole"),
        pytest.param(MODELS, PROGRAMS_OF_MODELS, id="its models in one process"),
    ],
)
def test_random_programs_and_edges_play_as_in_lava(driver, count, tmp_path):
    programs = cases(range(count))
    for name, case in programs.items():
        write_folder(tmp_path / "folders" / name, case)
    compared, spikes = compare(tmp_path / "folders", driver)
    print(f"\nlava: {len(programs)} programs, {compared:,} values, 0 differ ({spikes:,} spikes)")
    assert spikes > 50 * count


def shipped_case(model: str, recordings: str, number: int) -> Case:
    """Return a shipped network as compiled, and one recording."""
    network = lc.load(ROOT / "examples/models" / f"{model}.pt")
    compiled = lc.compile(network, strategy="reset", diagnosis=False)
    program = compiled.program
    assert isinstance(program, hw.ChipProgram)
    spikes = lc.read_recordings(ROOT / "examples/recordings" / recordings).spikes
    return program, np.asarray(spikes[number])


@pytest.mark.parametrize("model", SHIPPED)
def test_shipped_networks_play_as_in_lava(model, tmp_path):
    for number in range(2):
        case = shipped_case(model, SHIPPED[model], number)
        write_folder(tmp_path / "folders" / str(number), case)
    compared, spikes = compare(tmp_path / "folders")
    print(f"\nlava: {model}, {compared:,} values, 0 differ ({spikes:,} spikes)")
    assert spikes > 100
