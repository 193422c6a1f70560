"""Emitted programs against what Lava 0.10.0 was recorded to do with them (``record_lava.py``), so without Lava.

Lava's input must be what is emitted today, and its output what our engine computes. Planted faults of the emitter made a
difference in Lava, too. The stand-in for Lava, which other tests use, must do what Lava did.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from record_lava import RECORDED, SEEDS

from tests.support.emitter_faults import FAULTS, Arrays
from tests.support.lava_folders import (
    arrays_of,
    cases,
    differences,
    play_file,
    stand_in_script,
    write_folder,
)


@pytest.fixture(scope="module")
def recorded() -> Mapping[str, Arrays]:
    """The recorded arrays of each program or fault, by its name."""
    parts: dict[str, Arrays] = {}
    for key, array in arrays_of(RECORDED).items():
        name, part = key.split("/", 1)
        parts.setdefault(name, {})[part] = array
    return parts


def below(arrays: Arrays, folder: str) -> Arrays:
    """Return the arrays whose keys begin with ``folder/``, by the rest of their keys."""
    prefix = f"{folder}/"
    return {
        key.removeprefix(prefix): array for key, array in arrays.items() if key.startswith(prefix)
    }


@pytest.fixture(scope="module")
def emitted(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, tuple[Arrays, Arrays]]:
    """What is emitted today: for each program, the arrays for Lava, and the expected spikes and registers."""
    top = tmp_path_factory.mktemp("emitted")
    folders = {name: write_folder(top / name, case) for name, case in cases(SEEDS).items()}
    return {
        name: (arrays_of(folder / "network.npz"), arrays_of(folder / "expected.npz"))
        for name, folder in folders.items()
    }


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The emitted script as a module, with the stand-in in the place of Lava."""
    return stand_in_script(tmp_path_factory.mktemp("script"))


def test_lava_was_given_what_is_emitted_today(recorded, emitted):
    for name, (arrays, _) in emitted.items():
        assert differences(below(recorded[name], "network"), arrays) == 0, name


def test_lava_did_what_our_engine_does(recorded, emitted):
    for name, (_, expected) in emitted.items():
        assert differences(below(recorded[name], "played"), expected) == 0, name


@pytest.mark.parametrize("number", range(len(FAULTS)), ids=list(FAULTS))
def test_lava_shows_a_fault_of_the_emitter_as_the_stand_in_does(
    number, recorded, emitted, script, tmp_path
):
    played = below(recorded[f"fault-{number}"], "played")
    arrays, expected = emitted[str(recorded[f"fault-{number}"]["program"])]
    assert differences(played, expected) > 0
    faulty = list(FAULTS.values())[number](arrays)
    np.savez(tmp_path / "network.npz", **faulty)
    assert differences(play_file(script, tmp_path / "network.npz"), played) == 0


def test_the_stand_in_does_what_lava_did(recorded, emitted, script, tmp_path):
    for name in emitted:
        np.savez(tmp_path / "network.npz", **below(recorded[name], "network"))
        played = play_file(script, tmp_path / "network.npz")
        assert differences(played, below(recorded[name], "played")) == 0, name
