"""Play a workload once, as a user's script would, and print the peak of memory as JSON: ``play_workload.py NAME``."""

import json
import sys

from peak_memory import peak_mib
from workloads import WORKLOADS

import hw_model as hw

if __name__ == "__main__":
    for network in WORKLOADS[sys.argv[1]]().networks:
        hw.simulate(network.program(), network.recordings)
    print(json.dumps({"peak_mib": peak_mib()}))
