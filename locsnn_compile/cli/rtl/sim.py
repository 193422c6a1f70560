"""``locsnn rtl sim``: play recordings to the core and to the simulator, and compare every value.

Play recordings to the open core's SystemVerilog and to the simulator, and compare every spike, u, v, potential, count
and class, and every cycle with its prediction. Exit code 3 if anything differs.

example:
  locsnn rtl sim build/objects-hybrid --events examples/recordings/touches.npz --recordings 1

It needs Verilator (Debian: apt-get install verilator) or, with --simulator icarus, Icarus Verilog. The simulator is
built once, in half a minute, and kept in ~/.cache/locsnn. Nothing here runs on a board.
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse

import hw_model as hw
from hw_model.rtl import simulators
from hw_model.rtl.comparison import compare
from locsnn_compile.cli.shell import EXIT_GATE, print_result
from locsnn_compile.cli.step_options import assumption_lines, read_for_program


def run(args: argparse.Namespace) -> int:
    """Compare the core with the simulator; print the result in a few lines, or as JSON.

    Returns 3 if a value differs, or if a recording took another number of cycles than predicted.
    """
    program = hw.load_program(args.program)
    recordings = read_for_program(args, args.events, program)
    # Without --recordings this is [:None], which takes all.
    spikes = recordings.spikes[: args.recordings]
    document = compare(program, spikes, simulators.sources(), args.simulator)
    mismatches = document["mismatches"]
    cycle_mismatches = document["cycle_mismatches"]
    cycles = document["cycles"]
    lines = (
        f"recordings {document['recordings']}, compared values {document['compared_values']}",
        f"mismatches {mismatches}, cycles predicted wrongly {cycle_mismatches}",
        f"cycles per recording: {sum(cycles) / len(cycles):.0f} on average, {max(cycles)} at most",
    )
    document["assumptions"] = list(recordings.assumed)
    print_result(args, document, [*lines, *assumption_lines(recordings)])
    return EXIT_GATE if mismatches or cycle_mismatches else 0
