"""Programs of ``--emit lava`` in Lava's fixed-point models: every spike of every step, and u and v after the last one.

A thousand random programs are played by Lava's models in one process, and some by Lava as a whole. The environment variables
``LOCSNN_LAVA_MODELS`` and ``LOCSNN_LAVA_PROGRAMS`` say how many; 60 in Lava as a whole take a minute or two on an idle machine.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from make_environments import python_of, why_missing
from recorded_sets import RECORDINGS, few_recordings, shipped_network

import hw_model as hw
import locsnn_compile as lc
from tests.lava.record_lava import DRIVER, ask_lava
from tests.support.lava_folders import arrays_of, cases, differences, write_folder

pytestmark = pytest.mark.peers

PROGRAMS = int(os.environ.get("LOCSNN_LAVA_PROGRAMS", "60"))
PROGRAMS_OF_MODELS = int(os.environ.get("LOCSNN_LAVA_MODELS", "1000"))
MODELS = Path(__file__).parent / "drive_lava_models.py"
SHIPPED = ("objects-hybrid", "containers-hybrid", "two-fingertips")
"""The shipped networks that Lava can play, lowered by ``reset``."""


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
    assert spikes > 50 * count  # or the programs would be too quiet to show a difference


@pytest.mark.parametrize(
    ("driver", "most"),
    [
        pytest.param(DRIVER, 2, id="Lava as a whole"),
        pytest.param(MODELS, RECORDINGS, id="its models in one process"),
    ],
)
@pytest.mark.parametrize("model", SHIPPED)
def test_shipped_networks_play_as_in_lava(model, driver, most, tmp_path):
    recordings = few_recordings(model)
    compiled = lc.compile(shipped_network(model), strategy="reset", diagnosis=False)
    program = compiled.program
    assert isinstance(program, hw.ChipProgram)
    for number, recording in enumerate(recordings.spikes[:most]):
        write_folder(tmp_path / "folders" / str(number), (program, recording))
    compared, spikes = compare(tmp_path / "folders", driver)
    played = f"{min(most, len(recordings))} recordings, {compared:,} values, 0 differ"
    print(f"\nlava: {model}, {played} ({spikes:,} spikes)")
    assert spikes > 100
