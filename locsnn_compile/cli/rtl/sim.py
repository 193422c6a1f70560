"""``locsnn rtl sim``: play recordings to the core and to the simulator, and compare every value.

Play recordings to the open core's SystemVerilog and to the simulator, and compare every spike, u, v, potential, count
and class, and every cycle with its prediction. Exit code 3 if anything differs.

example:
  locsnn rtl sim build/objects-hybrid --events examples/recordings/touches.npz --recordings 1

It needs Verilator (Debian: apt-get install verilator) or, with --simulator icarus, Icarus Verilog. The simulator is
built once, in half a minute, and kept in ~/.cache/locsnn. Nothing here runs on a board.
"""

import argparse

import hw_model as hw
from hw_model.rtl import simulators
from hw_model.rtl.comparison import compare
from locsnn_compile.cli.shell import EXIT_GATE, say
from locsnn_compile.cli.step_options import assumption_lines, read_for_program


def run(args: argparse.Namespace) -> int:
    """Compare; print the result in a few lines, or as JSON."""
    program = hw.load_program(args.program)
    recordings = read_for_program(args, args.events, program)
    spikes = recordings.spikes[: args.recordings]
    found = compare(program, spikes, simulators.sources(), args.simulator)
    cycles = found["cycles"]
    lines = (
        f"recordings {found['recordings']}, compared values {found['compared_values']}",
        f"mismatches {found['mismatches']}, cycles predicted wrongly {found['cycle_mismatches']}",
        f"cycles per recording: {sum(cycles) / len(cycles):.0f} on average, {max(cycles)} at most",
    )
    found["assumptions"] = list(recordings.assumed)
    say(args, found, [*lines, *assumption_lines(recordings)])
    return EXIT_GATE if found["mismatches"] or found["cycle_mismatches"] else 0
