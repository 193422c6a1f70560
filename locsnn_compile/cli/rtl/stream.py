"""``locsnn rtl stream``: load a board over its serial line, stream recordings, and compare the answers.

Load a program onto a board that runs the open core, stream recordings to it, and compare its classes and counts with
the simulator. Exit code 3 if a recording differs.

example:
  locsnn rtl stream build/objects-hybrid --events examples/recordings/touches.npz --port sim:verilator --recordings 1

sim:verilator and sim:icarus simulate the board and its line; Icarus is slow. A board is named by its serial device,
such as /dev/ttyUSB0, and needs pyserial: pip install pyserial.
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse

import hw_model as hw
from hw_model.rtl.streaming import stream
from locsnn_compile.cli.shell import EXIT_GATE, print_result
from locsnn_compile.cli.step_options import assumption_lines, read_for_program


def run(args: argparse.Namespace) -> int:
    """Stream recordings to the board; print their classes and what differs, or the result as JSON.

    Returns 3 if the board answers differently from the simulator.
    """
    program = hw.load_program(args.program)
    recordings = read_for_program(args, args.events, program)
    # Without --recordings this is [:None], which takes all.
    spikes = recordings.spikes[: args.recordings]
    document = stream(program, spikes, args.port, args.baud, args.spikes)
    document["assumptions"] = list(recordings.assumed)
    lines: list[str] = []
    # The simulator expects no classes of a program without a readout.
    has_readout = document["expected"] is not None
    by_recording = zip(document["classes"], document["different"], strict=True)
    for number, (predicted_class, differences) in enumerate(by_recording):
        prediction = f"class {predicted_class}" if has_readout else "no readout"
        difference = f"; different: {', '.join(differences)}" if differences else ""
        lines.append(f"recording {number}: {prediction}{difference}")
    lines += assumption_lines(recordings)
    mismatches = document["mismatches"]
    lines.append(f"recordings {document['recordings']}, different from the simulator {mismatches}")
    print_result(args, document, lines)
    return EXIT_GATE if mismatches else 0
