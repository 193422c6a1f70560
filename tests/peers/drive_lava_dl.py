"""Play a job file to the CUBA neuron of lava-dl 0.6: ``drive_lava_dl.py JOB RESULT``, in an environment of its own.

``quirks.py`` says how inputs are translated.
"""

import json
import sys
import types

import numpy as np
import torch

sys.modules["lava.lib.dl.slayer.object_detection"] = types.ModuleType(
    "unused"
)  # the only part that needs torchvision
from lava.lib.dl import slayer  # noqa: E402

WEIGHT_SCALE = 64
"""lava-dl counts weights and thresholds in 64ths of a mantissa."""
STATE_SCALE = 4096
"""lava-dl counts currents, voltages and decays in 4096ths."""
VOLTAGE_MAX = 2**23 - 1


def one_value(population, key):
    """Return the value that all compartments share."""
    (value,) = set(population[key])
    return value


def neuron_of(population):
    """Return a neuron that keeps its state from call to call, so that it can be stepped."""
    if (
        any(population["bias"])
        or population["vmax"] != VOLTAGE_MAX
        or population["vmin"] != -VOLTAGE_MAX
    ):
        raise ValueError("the neuron has no bias and no voltage limits")
    if one_value(population, "refractory") != 1:
        raise ValueError("the neuron has no refractory count")
    return slayer.neuron.cuba.Neuron(
        threshold=one_value(population, "threshold") / WEIGHT_SCALE,
        current_decay=one_value(population, "decay_u") / STATE_SCALE,
        voltage_decay=one_value(population, "decay_v") / STATE_SCALE,
        persistent_state=True,
    )


def synapse_of(projection, neuron):
    """Return a dense synapse that rounds its weights as a CUBA block does."""
    if projection["exponent"]:
        raise ValueError("the synapse has no weight exponent")
    weights = np.array(projection["weights"])
    synapse = slayer.synapse.Dense(weights.shape[1], weights.shape[0])
    synapse.weight.data = torch.tensor(weights / WEIGHT_SCALE, dtype=torch.float32).reshape(
        synapse.weight.shape
    )
    synapse.pre_hook_fx = neuron.quantize_8bit
    return synapse


def axon_of(projection):
    """Return an axonal delay."""
    delay = np.array(projection["delay"])
    if np.any(delay != delay[0]):
        raise ValueError("delays differ from synapse to synapse of a source")
    axon = slayer.axon.Delay(max_delay=62)
    axon.delay.data = torch.tensor(delay[0], dtype=torch.float32)
    axon.init = True
    return axon


def play(neuron, charge, feedback):
    """Step a neuron over charges (1, n, steps), with the spikes of one step fed back in the next; return spikes, u and v.

    lava-dl shows v before the reset; the chip's v after a spike is 0.
    """
    spike, rows = torch.zeros((*charge.shape[:2], 1)), []
    for t in range(charge.shape[2]):
        total = charge[..., t : t + 1] + sum(synapse(spike) for synapse in feedback)
        current, voltage = neuron.dynamics(total)
        spike = neuron.spike(voltage)
        rows.append(
            torch.cat([spike, current * STATE_SCALE, voltage * STATE_SCALE * (1 - spike)], dim=2)
        )
    return torch.stack(rows, dim=3)[0]


def run(network):
    """Return the arrays of one network by key."""
    spikes = {"x": torch.tensor(network["spikes"], dtype=torch.float32).T[None]}
    arrays = {}
    for population in network["populations"]:
        name, neuron = population["name"], neuron_of(population)
        charge, feedback = torch.zeros(1, population["size"], len(network["spikes"])), []
        for projection in network["projections"]:
            if projection["target"] != name:
                continue
            synapse = synapse_of(projection, neuron)
            if projection["source"] == name:
                if np.any(projection["delay"]):
                    raise ValueError("the recurrence of a layer has no delay")
                feedback.append(synapse)
                continue
            # A synapse of lava-dl acts in the step of its spike; on the chip it acts a step later.
            arriving = slayer.axon.delay(axon_of(projection)(spikes[projection["source"]]), 1)
            charge = charge + synapse(arriving)
        probes = play(neuron, charge, feedback)
        spikes[name] = probes[:, 0][None]
        for index, probe in enumerate(("spikes", "u", "v")):
            arrays[f"{network['name']}/{name}/{probe}"] = probes[:, index].T.numpy()
    return arrays


if __name__ == "__main__":
    with open(sys.argv[1]) as file:
        job = json.load(file)
    with torch.no_grad():
        np.savez_compressed(
            sys.argv[2], **{key: array for network in job for key, array in run(network).items()}
        )
