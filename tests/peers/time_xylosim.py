"""Print the least processor seconds that xylosim takes for the one network of a file: ``time_xylosim.py NETWORKS TURNS``."""

import sys
import time

from drive_xylosim import layer_of, read


def main():
    path, turns = sys.argv[1:]
    (network,) = read(path).values()
    events = network["events"].tolist()
    least = float("inf")
    for _ in range(int(turns)):
        layer, owned = layer_of(network)
        started = time.process_time()
        layer.evolve(events)
        least = min(least, time.process_time() - started)
        del layer, owned
    print(least)


if __name__ == "__main__":
    main()
