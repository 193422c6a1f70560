"""Play a job file to the emulator of nengo-loihi 1.1: ``drive_nengo_loihi.py JOB RESULT``, in an environment of its own.

The emulator's model is built directly, from integers, and not from a Nengo network, whose floats nengo-loihi would round.
``quirks.py`` says how inputs are translated.
"""

import json
import sys
import warnings

import numpy as np
from nengo_loihi.block import Axon, LoihiBlock, Synapse
from nengo_loihi.builder import Model
from nengo_loihi.builder.discretize import discretize_weights
from nengo_loihi.emulator import EmulatorInterface
from nengo_loihi.inputs import SpikeInput
from nengo_loihi.probe import LoihiProbe

PROBES = {"spikes": "spiked", "u": "current", "v": "voltage"}
FANOUT_TYPES = {"mixed": 1, "excitatory": 2, "inhibitory": 3}
"""The codes of sign modes. The emulator itself only distinguishes type 1 from the others."""
WIDEST_FORMAT = 7
"""The code of 8 weight bits; smaller widths are their own codes."""


def compartments(population):
    """Return a block with the parameters of a population."""
    block = LoihiBlock(population["size"])
    compartment = block.compartment
    compartment.decay_u = np.array(population["decay_u"], np.int32) - 1
    compartment.decay_v = np.array(population["decay_v"], np.int32)
    compartment.vth = np.array(population["threshold"], np.int32) * 64
    compartment.bias = np.array(population["bias"], np.int32)
    compartment.refract_delay = np.array(population["refractory"], np.int32)
    compartment.vmin, compartment.vmax = population["vmin"], population["vmax"]
    compartment.scale_u = compartment.scale_v = False
    return block


def synapses(projection):
    """Return synapses; the peer itself rounds their mantissas to the format and shifts them by the exponent."""
    if np.any(projection["delay"]):
        raise ValueError("the emulator has no delays")
    sources = np.array(projection["weights"], np.float32).T
    synapse = Synapse(len(sources))
    synapse.set_weights(sources)
    synapse.format(
        weight_exp=projection["exponent"],
        weight_bits=min(projection["weight_bits"], WIDEST_FORMAT),
        fanout_type=FANOUT_TYPES[projection["sign_mode"]],
    )
    synapse.weights = [
        discretize_weights(synapse.synapse_cfg, w.astype(np.float64)) for w in synapse.weights
    ]
    return synapse


def run(network):
    """Return the arrays of one network by key."""
    spikes = np.array(network["spikes"])
    model, inputs = Model(), SpikeInput(spikes.shape[1])
    model.add_input(inputs)
    blocks = {population["name"]: compartments(population) for population in network["populations"]}
    for projection in network["projections"]:
        synapse = synapses(projection)
        blocks[projection["target"]].add_synapse(synapse)
        axon = Axon(synapse.n_axons)
        axon.target = synapse
        (inputs if projection["source"] == "x" else blocks[projection["source"]]).add_axon(axon)
    probes = {}
    for name, block in blocks.items():
        model.add_block(block)
        for probe, key in PROBES.items():
            probes[f"{network['name']}/{name}/{probe}"] = LoihiProbe(target=block, key=key)
    for probe in probes.values():
        model.add_probe(probe)
    emulator = EmulatorInterface(model, seed=0)
    for row, fired in enumerate(spikes):
        inputs.add_spikes(row + 1, np.flatnonzero(fired))  # its steps count from 1
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one for each overflow
        emulator.run_steps(len(spikes))
    return {
        key: np.array(emulator.collect_probe_output(probe), np.int64)
        for key, probe in probes.items()
    }


if __name__ == "__main__":
    with open(sys.argv[1]) as file:
        job = json.load(file)
    # Only in mantissas that have none to lose.
    warnings.filterwarnings("ignore", message="Lost .* extra bits")
    np.savez_compressed(
        sys.argv[2], **{key: array for network in job for key, array in run(network).items()}
    )
