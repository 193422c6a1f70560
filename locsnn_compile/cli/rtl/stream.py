"""``locsnn rtl stream``: load a board over its serial line, stream recordings, and compare the answers.

Load a program onto a board that runs the open core, stream recordings to it, and compare its classes and counts with
the simulator. Exit code 3 if a recording differs.

example:
  locsnn rtl stream build/objects-hybrid --events examples/recordings/touches.npz --port sim:verilator --recordings 1

sim:verilator and sim:icarus simulate the board and its line; Icarus is slow. A board is named by its serial device,
such as /dev/ttyUSB0, and needs pyserial: pip install pyserial.
"""

import argparse

import hw_model as hw
from hw_model.rtl.streaming import stream
from locsnn_compile.cli.shell import EXIT_GATE, say
from locsnn_compile.cli.step_options import assumption_lines, read_for_program


def run(args: argparse.Namespace) -> int:
    """Stream; print the class of each recording and what differs, or the result as JSON."""
    program = hw.load_program(args.program)
    recordings = read_for_program(args, args.events, program)
    spikes = recordings.spikes[: args.recordings]
    found = stream(program, spikes, args.port, args.baud, args.spikes)
    said = "no readout" if found["expected"] is None else "class {}"
    found["assumptions"] = list(recordings.assumed)
    lines = [
        f"recording {index}: {said.format(winner)}"
        + (f"; different: {', '.join(differs)}" if differs else "")
        for index, (winner, differs) in enumerate(
            zip(found["classes"], found["different"], strict=True)
        )
    ]
    say(
        args,
        found,
        [
            *lines,
            *assumption_lines(recordings),
            f"recordings {found['recordings']}, different from the simulator {found['mismatches']}",
        ],
    )
    return EXIT_GATE if found["mismatches"] else 0
