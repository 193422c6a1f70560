"""Record what Lava, Intel's framework, does with emitted folders and with faulty ones: the witness of the tests.

Run ``python -m tests.lava.record_lava PYTHON``, where PYTHON is an interpreter that has lava-nc 0.10.0. The result is a
file next to this one, so that the tests need no Lava.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tests.support.emitter_faults import FAULTS, Arrays
from tests.support.lava_folders import (
    arrays_of,
    cases,
    differences,
    play_file,
    stand_in_script,
    write_folder,
)

DRIVER = Path(__file__).parents[1] / "peers" / "drive_lava.py"
RECORDED = Path(__file__).parent / "recorded-by-lava.npz"
"""The arrays ``name/network/key`` are Lava's input for a program, ``name/played/key`` its output.

``fault-K/program`` is the name of the program in which fault K was planted.
"""
SEEDS = range(6)
"""Seeds of the random programs."""
TIMEOUT_SECONDS = 7200


def ask_lava(python: Path | str, folder: Path, driver: Path = DRIVER) -> dict[str, Arrays]:
    """Return what Lava does with each of the emitted folders in ``folder``, by their names."""
    results = folder.with_name(f"{folder.name}-results")
    results.mkdir(exist_ok=True)
    script = folder.with_name(f"{folder.name}-network.py")
    script.write_bytes(next(folder.glob("*/network.py")).read_bytes())
    call = [str(python), str(driver), str(script), str(folder), str(results)]
    subprocess.run(call, check=True, timeout=TIMEOUT_SECONDS)
    return {path.stem: arrays_of(path) for path in sorted(results.iterdir())}


def write_faulty(folder: Path, sound: Mapping[str, Path], script: Any) -> dict[str, str]:
    """Write a folder for each fault; return the name of the faulty program, by the name of the folder.

    The fault is planted in the first program in which it makes a difference, as played by the stand-in for Lava. (A
    test checks that the stand-in does what Lava does.)
    """
    programs = {}
    for number, fault in enumerate(FAULTS.values()):
        target = folder / f"fault-{number}"
        target.mkdir()
        for name, source in sound.items():
            np.savez(target / "network.npz", **fault(arrays_of(source / "network.npz")))
            played = play_file(script, target / "network.npz")
            if differences(played, arrays_of(source / "expected.npz")):
                programs[target.name] = name
                break
    return programs


def main() -> None:
    """Play all programs and all faults with Lava, and write the record."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "folders"
        sound = {key: write_folder(folder / key, case) for key, case in cases(SEEDS).items()}
        programs = write_faulty(folder, sound, stand_in_script(Path(name)))
        arrays: Arrays = {f"{key}/program": np.array(of) for key, of in programs.items()}
        for key, played in ask_lava(sys.argv[1], folder).items():
            arrays |= {f"{key}/played/{part}": array for part, array in played.items()}
            if key in sound:
                network = arrays_of(folder / key / "network.npz")
                arrays |= {f"{key}/network/{part}": array for part, array in network.items()}
        np.savez_compressed(RECORDED, **arrays)


if __name__ == "__main__":
    main()
