"""Load a program and play recordings twice, in a fresh process: ``start_up.py PROGRAM RECORDINGS``. Prints seconds."""

import json
import sys
import time

start = time.perf_counter()  # before the imports, whose time counts

import numpy as np  # noqa: E402

import hw_model as hw  # noqa: E402

if __name__ == "__main__":
    times = {}

    def timed(part, run):
        begin = time.perf_counter()
        result = run()
        times[part] = time.perf_counter() - begin
        return result

    recordings = np.load(sys.argv[2])
    program = timed("load", lambda: hw.load_program(sys.argv[1]))
    timed("first_call", lambda: hw.simulate(program, recordings))
    timed("second_call", lambda: hw.simulate(program, recordings))
    print(json.dumps({**times, "all": time.perf_counter() - start}))
