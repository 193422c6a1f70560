"""Print the least processor seconds that Lava takes for the first run of a folder: ``time_lava.py FOLDER TURNS``.

The time of all its processes counts, their start included; importing Lava does not count.
"""

import os
import sys
from pathlib import Path

from drive_lava import script_at


def processor_seconds():
    """Return the processor time of this process and of those that it started and that ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def main():
    folder, turns = sys.argv[1:]
    network = script_at(Path(folder) / "network.py")
    run = network.load(Path(folder) / "network.npz")["run0"]
    least = float("inf")
    for _ in range(int(turns)):
        started = processor_seconds()
        network.play(run)
        least = min(least, processor_seconds() - started)
    print(least)


if __name__ == "__main__":
    main()
