"""Play a job file to brian2-loihi 0.5: ``drive_brian2_loihi.py JOB RESULT``, in an environment of its own.

The job is what ``Network.job`` of ``peer_networks.py`` gives, for several networks. ``quirks.py`` says how inputs are translated.
"""

import json
import sys

import numpy as np
from brian2 import prefs
from brian2_loihi import (
    LoihiNetwork,
    LoihiNeuronGroup,
    LoihiSpikeGeneratorGroup,
    LoihiSpikeMonitor,
    LoihiStateMonitor,
    LoihiSynapses,
    synapse_sign_mode,
)

VOLTAGE_MAX = 2**23 - 1


def one_value(population, key):
    """Return the value that all compartments share; a neuron group cannot have one per neuron."""
    (value,) = set(population[key])
    return value


def neurons(population):
    """Return a neuron group with the parameters of a population."""
    if (
        any(population["bias"])
        or population["vmax"] != VOLTAGE_MAX
        or population["vmin"] != -VOLTAGE_MAX
    ):
        raise ValueError("a neuron group has no bias and no voltage limits")
    return LoihiNeuronGroup(
        population["size"],
        refractory=one_value(population, "refractory"),
        threshold_v_mant=one_value(population, "threshold"),
        decay_v=one_value(population, "decay_v"),
        decay_I=one_value(population, "decay_u"),
    )


def synapses(projection, source, target):
    """Yield one synapse group for every delay: a group has one delay."""
    weights, delay = np.array(projection["weights"]), np.array(projection["delay"])
    for steps in np.unique(delay):
        targets, sources = np.nonzero((delay == steps) & (weights != 0))
        if len(sources) == 0:
            continue
        group = LoihiSynapses(
            source,
            target,
            delay=int(steps),
            w_exp=projection["exponent"],
            sign_mode=getattr(synapse_sign_mode, projection["sign_mode"].upper()),
            num_weight_bits=projection["weight_bits"],
        )
        group.connect(i=sources, j=targets)
        group.w = weights[np.array(group.j), np.array(group.i)]
        yield group


def run(network):
    """Return the arrays of one network by key."""
    spikes = np.array(network["spikes"])
    rows, lines = np.nonzero(spikes)
    # A spike acts in the row it is given.
    groups = {"x": LoihiSpikeGeneratorGroup(spikes.shape[1], lines, rows + 1)}
    groups.update(
        {population["name"]: neurons(population) for population in network["populations"]}
    )
    objects = list(groups.values())
    for projection in network["projections"]:
        objects += synapses(projection, groups[projection["source"]], groups[projection["target"]])
    del groups["x"]
    fired = {name: LoihiSpikeMonitor(group) for name, group in groups.items()}
    current = {name: LoihiStateMonitor(group, "I") for name, group in groups.items()}
    voltage = {name: LoihiStateMonitor(group, "v") for name, group in groups.items()}
    LoihiNetwork(*objects, *fired.values(), *current.values(), *voltage.values()).run(len(spikes))
    arrays = {}
    for name, group in groups.items():
        raster = np.zeros((len(spikes), len(group)), np.int64)
        # Spike times are in seconds, with steps of a millisecond.
        raster[np.rint(fired[name].t_ * 1000).astype(int), np.array(fired[name].i)] = 1
        arrays[f"{network['name']}/{name}/spikes"] = raster
        arrays[f"{network['name']}/{name}/u"] = current[name].I.T
        arrays[f"{network['name']}/{name}/v"] = voltage[name].v.T
    return arrays


if __name__ == "__main__":
    prefs.codegen.target = "numpy"
    with open(sys.argv[1]) as file:
        job = json.load(file)
    np.savez_compressed(
        sys.argv[2], **{key: array for network in job for key, array in run(network).items()}
    )
