"""Play emitted folders in Lava: ``drive_lava.py SCRIPT FOLDERS RESULT``, in an environment of its own.

FOLDERS holds folders of ``--emit lava``, named by numbers, and SCRIPT is the ``network.py`` of one of them (all are equal).
The result has, for each folder, run and group of neurons, what the script's ``play`` returns. A folder ``NUMBER`` whose
result is in ``RESULT/NUMBER.npz`` is not played again.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np


def script_at(path):
    """Import the emitted script as a module."""
    spec = importlib.util.spec_from_file_location("network", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main():
    script, folders, results = map(Path, sys.argv[1:])
    network = script_at(script)
    for folder in sorted(folders.iterdir()):
        result = results / f"{folder.name}.npz"
        if result.exists():
            continue
        arrays = {}
        for number, run in enumerate(network.numbered(network.load(folder / "network.npz"), "run")):
            for group, played in enumerate(network.play(run)):
                for name, array in played.items():
                    arrays[f"run{number}/neurons{group}/{name}"] = array
        np.savez_compressed(result, **arrays)


if __name__ == "__main__":
    main()
