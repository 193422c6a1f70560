"""Play many recordings, batch after batch: ``stream.py PROGRAM RECORDINGS BATCHES``. Prints seconds and peak memory."""

import json
import sys
import time

import numpy as np
from peak_memory import peak_mib

import hw_model as hw

if __name__ == "__main__":
    program, recordings = hw.load_program(sys.argv[1]), np.load(sys.argv[2])
    hw.simulate(program, recordings)
    start = time.perf_counter()
    for _ in range(int(sys.argv[3])):
        hw.simulate(program, recordings)
    print(
        json.dumps(
            {
                "recordings": len(recordings) * int(sys.argv[3]),
                "seconds": time.perf_counter() - start,
                "peak_mib": peak_mib(),
            }
        )
    )
