"""What Lava 0.10.0 did with emitted programs, recorded: it says no without Lava."""

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
    """All that was recorded, by the name of the program or fault."""
    parts: dict[str, Arrays] = {}
    for key, array in arrays_of(RECORDED).items():
        name, part = key.split("/", 1)
        parts.setdefault(name, {})[part] = array
    return parts


def below(arrays: Arrays, folder: str) -> Arrays:
    """Return the arrays below a folder, by the rest of their keys."""
    begin = f"{folder}/"
    return {
        key.removeprefix(begin): array for key, array in arrays.items() if key.startswith(begin)
    }


@pytest.fixture(scope="module")
def emitted(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, tuple[Arrays, Arrays]]:
    """What is emitted today, with the spikes and registers that it expects."""
    top = tmp_path_factory.mktemp("emitted")
    folders = {name: write_folder(top / name, case) for name, case in cases(SEEDS).items()}
    return {
        name: (arrays_of(folder / "network.npz"), arrays_of(folder / "expected.npz"))
        for name, folder in folders.items()
    }


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The emitted script, with the stand-in in the place of Lava."""
    return stand_in_script(tmp_path_factory.mktemp("script"))


def test_lava_was_given_what_is_emitted_today(recorded, emitted):
    for name, (arrays, _) in emitted.items():
        assert differences(below(recorded[name], "network"), arrays) == 0, name


def test_lava_did_what_our_engine_does(recorded, emitted):
    for name, (_, expected) in emitted.items():
        assert differences(below(recorded[name], "played"), expected) == 0, name


@pytest.mark.parametrize("number", range(len(FAULTS)), ids=list(FAULTS))
def test_lava_tells_a_fault_of_the_emitter(number, recorded, emitted, script, tmp_path):
    played = below(recorded[f"fault-{number}"], "played")
    arrays, expected = emitted[str(recorded[f"fault-{number}"]["program"])]
    assert differences(played, expected) > 0
    faulty = list(FAULTS.values())[number](arrays)
    np.savez(tmp_path / "network.npz", **faulty)
    assert differences(play_file(script, tmp_path / "network.npz"), played) == 0


def test_the_stand_in_does_what_lava_did(recorded, emitted, script, tmp_path):
    for name in emitted:
        np.savez(tmp_path / "network.npz", **below(recorded[name], "network"))
        found = play_file(script, tmp_path / "network.npz")
        assert differences(found, below(recorded[name], "played")) == 0, name
