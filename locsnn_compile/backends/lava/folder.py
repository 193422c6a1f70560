"""Write a program and one recording as a script of Lava processes that compares itself."""

from importlib.resources import files

import numpy as np

from hw_model.io.files import pack_arrays
from hw_model.values import AnyArray
from locsnn_compile.backends.lava.limits import check_fits
from locsnn_compile.backends.lava.processes import LavaPart, PhaseProcesses
from locsnn_compile.backends.played import Played

FOLDER = "lava"


def lava_files(played: Played) -> dict[str, bytes]:
    """Return the files by name; ``InputError`` for what Lava does not play as the program does."""
    check_fits(played)
    parts = [
        part
        for phase in played.phases
        for part in PhaseProcesses(played.program, phase.name).parts()
    ]
    network: dict[str, AnyArray] = {}
    expected: dict[str, AnyArray] = {}
    for number, part in enumerate(parts):
        network |= _below(f"run{number}", _network(played, part))
        expected |= _below(f"run{number}", _expected(played, part))
    return {
        f"{FOLDER}/network.npz": pack_arrays(network, compressed=True),
        f"{FOLDER}/expected.npz": pack_arrays(expected, compressed=True),
        f"{FOLDER}/network.py": (files(__package__) / "network.py.txt").read_bytes(),
    }


def _below(folder: str, arrays: dict[str, AnyArray]) -> dict[str, AnyArray]:
    return {f"{folder}/{name}": array for name, array in arrays.items()}


def _network(played: Played, part: LavaPart) -> dict[str, AnyArray]:
    """Return the parameters of all processes of a part, and the spikes of its sources."""
    lines = played.lines[part.phase]
    arrays: dict[str, AnyArray] = {
        "phase": np.array(part.phase),
        "steps": np.array(played.steps(part.phase)),
    }
    for number, source in enumerate(part.sources):
        arrays |= _below(
            f"source{number}",
            {"input": np.array(source.input), "spikes": lines[:, source.columns]},
        )
    for number, neurons in enumerate(part.neurons):
        arrays |= _below(
            f"neurons{number}",
            {
                "population": np.array(neurons.population),
                "index": neurons.index,
                "du": np.array(neurons.du),
                "dv": np.array(neurons.dv),
                "vth": np.array(neurons.vth),
                "bias_mant": neurons.bias_mantissa,
                "bias_exp": neurons.bias_exponent,
            },
        )
    for number, synapses in enumerate(part.synapses):
        arrays |= _below(
            f"synapses{number}",
            {
                "sender": np.array(synapses.sender),
                "target": np.array(synapses.target),
                "weights": synapses.weights.astype(np.int16),
                "delays": synapses.delays.astype(np.uint8),
                "weight_exp": np.array(synapses.exponent),
                "num_weight_bits": np.array(synapses.weight_bits),
                "sign_mode": np.array(synapses.sign_mode),
            },
        )
    return arrays


def _expected(played: Played, part: LavaPart) -> dict[str, AnyArray]:
    """Return the spikes of every step, and both registers after the last one."""
    arrays: dict[str, AnyArray] = {}
    for number, neurons in enumerate(part.neurons):
        name = neurons.population
        arrays |= _below(
            f"neurons{number}",
            {
                "spikes": played.recorded(part.phase, "spikes", name)[:, neurons.index],
                "u": played.recorded(part.phase, "u", name)[-1, neurons.index],
                "v": played.recorded(part.phase, "v", name)[-1, neurons.index],
            },
        )
    return arrays
