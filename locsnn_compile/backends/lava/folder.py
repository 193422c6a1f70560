"""``--emit lava``: write a program as Lava processes, with a script that plays a recording and compares every spike.

Lava can run only processes that are connected, so each phase of the program is cut into its connected parts. Each part
is a run of Lava of its own, one after the other. Names of arrays of the first run begin with ``run0/``; those of its
first source, LIF process and block of synapses begin with ``run0/source0/``, ``run0/neurons0/`` and
``run0/synapses0/``. Sources and LIF processes of a run are its *nodes*; they are numbered from 0, sources first.

``network.py.txt`` of this folder becomes the script ``network.py``. It ends in .txt here because it imports Lava, which
is not installed with this package, so linters and the type checker must not take it for a module.
"""

from importlib.resources import files

import numpy as np

from hw_model.io.files import pack_arrays
from hw_model.values import AnyArray
from locsnn_compile.backends.lava.limits import check_fits
from locsnn_compile.backends.lava.processes import (
    LavaNeurons,
    LavaPart,
    LavaSource,
    LavaSynapses,
    PhaseProcesses,
)
from locsnn_compile.backends.played import Played

FOLDER = "lava"


def lava_files(played: Played) -> dict[str, bytes]:
    """Return the content of the files by name, for a recording that was played to a program.

    Raise InputError if Lava would not play the program alike.
    """
    check_fits(played)
    network: dict[str, AnyArray] = {}
    expected: dict[str, AnyArray] = {}
    for number, part in enumerate(_parts(played)):
        network |= _in_folder(f"run{number}", _network_arrays(played, part))
        expected |= _in_folder(f"run{number}", _expected_arrays(played, part))
    return {
        f"{FOLDER}/network.npz": pack_arrays(network, compressed=True),
        f"{FOLDER}/expected.npz": pack_arrays(expected, compressed=True),
        f"{FOLDER}/network.py": (files(__package__) / "network.py.txt").read_bytes(),
    }


def _parts(played: Played) -> list[LavaPart]:
    """Return the parts of all phases, in the order in which they run."""
    parts: list[LavaPart] = []
    for phase in played.phases:
        parts.extend(PhaseProcesses(played.program, phase.name).parts())
    return parts


def _in_folder(folder: str, arrays: dict[str, AnyArray]) -> dict[str, AnyArray]:
    """Return the arrays with ``folder/`` in front of their names."""
    return {f"{folder}/{name}": array for name, array in arrays.items()}


def _network_arrays(played: Played, part: LavaPart) -> dict[str, AnyArray]:
    """Return the parameters of all processes of a part, and the spikes of its sources."""
    arrays: dict[str, AnyArray] = {
        "phase": np.array(part.phase),
        "steps": np.array(played.steps(part.phase)),
    }
    for number, source in enumerate(part.sources):
        # Of all input lines of the phase, (steps, lines).
        spikes_of_lines = played.lines[part.phase]
        source_arrays = _source_arrays(source, spikes_of_lines)
        arrays |= _in_folder(f"source{number}", source_arrays)
    for number, neurons in enumerate(part.neurons):
        arrays |= _in_folder(f"neurons{number}", _neuron_arrays(neurons))
    for number, synapses in enumerate(part.synapses):
        arrays |= _in_folder(f"synapses{number}", _synapse_arrays(synapses))
    return arrays


def _source_arrays(source: LavaSource, lines: AnyArray) -> dict[str, AnyArray]:
    """Return the spikes of a source, (steps, lines of the source); ``lines`` are those of all inputs of its phase."""
    return {"input": np.array(source.input), "spikes": lines[:, source.columns]}


def _neuron_arrays(neurons: LavaNeurons) -> dict[str, AnyArray]:
    """Return the parameters of a LIF process by their names in Lava, and which neurons of our program it plays."""
    return {
        "population": np.array(neurons.population),
        "index": neurons.index,
        "du": np.array(neurons.du),
        "dv": np.array(neurons.dv),
        "vth": np.array(neurons.vth),
        "bias_mant": neurons.bias_mantissa,
        "bias_exp": neurons.bias_exponent,
    }


def _synapse_arrays(synapses: LavaSynapses) -> dict[str, AnyArray]:
    """Return the parameters of a Dense process by their names in Lava, and the numbers of the nodes it connects."""
    return {
        "sender": np.array(synapses.sender),
        "target": np.array(synapses.target),
        # Mantissas have up to 8 bits and a sign. Delays fit a byte on our chips; a user's chip may have longer ones.
        "weights": synapses.weights.astype(np.int16),
        "delays": synapses.delays.astype(np.min_scalar_type(synapses.delays.max(initial=0))),
        "weight_exp": np.array(synapses.exponent),
        "num_weight_bits": np.array(synapses.weight_bits),
        "sign_mode": np.array(synapses.sign_mode),
    }


def _expected_arrays(played: Played, part: LavaPart) -> dict[str, AnyArray]:
    """Return the spikes of every step, (steps, neurons), and u and v after the last step, for each LIF process."""
    arrays: dict[str, AnyArray] = {}
    for number, neurons in enumerate(part.neurons):
        spikes = played.recorded(part.phase, "spikes", neurons.population)
        current = played.recorded(part.phase, "u", neurons.population)
        potential = played.recorded(part.phase, "v", neurons.population)
        arrays[f"neurons{number}/spikes"] = spikes[:, neurons.index]
        arrays[f"neurons{number}/u"] = current[-1, neurons.index]
        arrays[f"neurons{number}/v"] = potential[-1, neurons.index]
    return arrays
