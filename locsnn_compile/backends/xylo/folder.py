"""``--emit xylo``: write a program for a Xylo chip as a specification for rockpool, the library of its vendor.

The folder also has a recording with the spikes to expect, and a script that plays it in rockpool's simulator and
compares every spike. With the same specification, rockpool configures a device.

``run.py.txt`` of this folder is the script, with places for the chip's name and rockpool's module, so it is not Python.
"""

import json
from importlib.resources import files

import numpy as np

from hw_model.io.files import pack_arrays
from hw_model.values import AnyArray, ByteArray
from hw_model.xylo.playing import play_rows, rows_of
from hw_model.xylo.program import XyloProgram

FOLDER = "xylo"


def xylo_folder(program: XyloProgram, recording: ByteArray) -> dict[str, bytes]:
    """Return the content of the files by name, for a recording (steps, inputs); equal input gives equal bytes."""
    script = (files(__package__) / "run.py.txt").read_text("utf-8")
    chip = program.chip
    return {
        f"{FOLDER}/specification.npz": pack_arrays(specification(program), compressed=True),
        f"{FOLDER}/expected.npz": pack_arrays(expected(program, recording), compressed=True),
        f"{FOLDER}/run.py": script.format(
            chip=json.dumps(chip.name), module=json.dumps(chip.simulator)
        ).encode(),
    }


def specification(program: XyloProgram) -> dict[str, AnyArray]:
    """Return the arguments of rockpool's ``from_specification`` by name; single numbers as arrays of no dimension.

    Names are rockpool's. A *dash* is the number of bits by which a state is shifted right, to get what it loses in a
    step. A weight shift is the number of bits by which arriving weights are shifted left. Only compiled programs are
    emitted, and the compiler makes no aliases (neurons that repeat the spikes of others), so none are written.
    """
    network = program.network
    hidden = network.hidden
    outputs = network.outputs
    arguments: dict[str, AnyArray] = {
        "weights_in": network.weights_in,
        "weights_rec": network.weights_hidden,
        "weights_out": network.weights_out,
        "dash_mem": hidden.dash_mem,
        "dash_mem_out": outputs.dash_mem,
        "dash_syn": hidden.dash_syn[:, 0],
        "dash_syn_out": outputs.dash_syn[:, 0],
        "threshold": hidden.threshold,
        "threshold_out": outputs.threshold,
        "weight_shift_in": np.array(network.shift_in),
        "weight_shift_rec": np.array(network.shift_hidden),
        "weight_shift_out": np.array(network.shift_out),
    }
    # rockpool takes the second current of each hidden neuron as an argument of its own.
    if hidden.states == 2:
        arguments["dash_syn_2"] = hidden.dash_syn[:, 1]
    if hidden.bias is not None and outputs.bias is not None:
        arguments["bias"] = hidden.bias
        arguments["bias_out"] = outputs.bias
    return arguments


def expected(program: XyloProgram, recording: ByteArray) -> dict[str, AnyArray]:
    """Return the rows of a recording as the chip gets them, and the spikes of each row to expect."""
    rows = rows_of(recording)
    result = play_rows(program.network, rows)
    return {
        "rows": rows,
        "hidden_spikes": result.spikes,
        "output_spikes": result.output_spikes,
    }
