"""Play a job file to SANA-FE 2.2 on its own Loihi chip: ``drive_sanafe.py JOB RESULT``, in an environment of its own.

For each network of the job the result holds ``<network>/<population>/spikes`` (steps, n), the energy of each part
``<network>/energy_joules/<part>``, the modelled duration ``<network>/sim_time_seconds``, and the counts
``<network>/counts/<count>`` under SANA-FE's names.

Weights and thresholds keep the mantissas' unit, so that a potential is v / 64: SANA-FE truncates potentials to 64ths,
which is rz of v, but does not truncate currents. A row acts in the next step there as here. Each population, the input
included, is mapped to one core: in the order of the job, or as ``network["cores"]`` says, {population: core number}.
"""

import json
import sys

import numpy as np
import sanafe

WEIGHT_SCALE = 64
DECAY_ONE = 4096
VOLTAGE_MAX = 2**23 - 1
CORE_NEURONS = 1024
"""Compartments, and input lines, that a core of its Loihi holds."""
COUNTS = ("spikes", "packets_sent", "neurons_updated", "neurons_fired")
"""What SANA-FE counts; its ``spikes`` are synaptic events."""


def check(network):
    """Raise ValueError for what SANA-FE's neurons and synapses do not have, or would silently ignore."""
    for population in network["populations"]:
        if population["vmax"] != VOLTAGE_MAX or abs(population["vmin"]) != VOLTAGE_MAX:
            raise ValueError("the soma has no voltage limits")
        if any(value != 1 for value in population["refractory"]):
            raise ValueError("the soma has no refractory count")
    for projection in network["projections"]:
        if np.any(projection["delay"]):
            raise ValueError("the dendrites that are used here have no delays")
    sizes = [
        len(network["projections"][0]["weights"][0]),
        *(p["size"] for p in network["populations"]),
    ]
    if max(sizes) > CORE_NEURONS:
        raise ValueError(f"a population is mapped to one core, which holds {CORE_NEURONS}")


def input_lines(net, core, lines):
    """Return a group of input neurons; each has a soma of its own, which plays its spikes."""
    group = net.create_neuron_group("x", lines)
    for line in range(lines):
        group[line].set_attributes(soma_hw_name=f"loihi_inputs[{line}]")
        group[line].map_to_core(core)
    return group


def neurons(net, core, population, log_spikes):
    """Return a group of LIF somas with a current of their own."""
    group = net.create_neuron_group(
        population["name"], population["size"], soma_hw_name="loihi_lif", log_spikes=log_spikes
    )
    columns = zip(
        *(population[key] for key in ("decay_u", "decay_v", "threshold", "bias")), strict=True
    )
    for neuron, (decay_u, decay_v, threshold, bias) in enumerate(columns):
        group[neuron].set_attributes(
            model_attributes={
                "input_decay": 1 - decay_u / DECAY_ONE,
                "leak_decay": 1 - decay_v / DECAY_ONE,
                "threshold": float(threshold),
                "bias": bias / WEIGHT_SCALE,
            }
        )
        group[neuron].map_to_core(core)
    return group


def connect(source, target, projection):
    """Connect two groups; a zero is no synapse. A negative exponent drops the lowest bits of weights, as on the chip."""
    mantissa = np.array(projection["weights"]).T  # (sources, targets)
    pairs = np.argwhere(mantissa != 0)
    weights = np.floor(mantissa[tuple(pairs.T)] * 2.0 ** projection["exponent"])
    source.connect_neurons_sparse(
        target, {"weight": weights.tolist()}, [tuple(pair) for pair in pairs.tolist()]
    )


def load(network, *, log_spikes=False):
    """Return a chip that holds a network, its input silent. Spikes are kept only on request."""
    check(network)
    architecture, net = sanafe.load_loihi(), sanafe.Network()
    all_cores = architecture.cores()
    names = ["x", *(population["name"] for population in network["populations"])]
    cores = {
        name: all_cores[network.get("cores", {}).get(name, index)]
        for index, name in enumerate(names)
    }
    lines = next(len(p["weights"][0]) for p in network["projections"] if p["source"] == "x")
    groups = {"x": input_lines(net, cores["x"], lines)}
    for population in network["populations"]:
        groups[population["name"]] = neurons(net, cores[population["name"]], population, log_spikes)
    for projection in network["projections"]:
        connect(groups[projection["source"]], groups[projection["target"]], projection)
    chip = sanafe.SpikingChip(architecture)
    chip.load(net)
    return chip


def feed(chip, spikes):
    """Reset the chip and give it a recording (steps, lines)."""
    chip.reset()
    for neuron, line in zip(chip.mapped_neuron_groups["x"], np.array(spikes, bool).T, strict=True):
        neuron.set_attributes(model_attributes={"spikes": line.tolist()})


def raster(trace, population, steps):
    """Return the spikes (steps, n) of a population from a trace of all populations."""
    spikes = np.zeros((steps, population["size"]), np.int64)
    for step, row in enumerate(trace):
        fired = [
            address.neuron_offset for address in row if address.group_name == population["name"]
        ]
        spikes[step, fired] = 1
    return spikes


def run(network, timing_model="detailed"):
    """Return the arrays of one network by key."""
    chip, steps = load(network, log_spikes=True), len(network["spikes"])
    feed(chip, network["spikes"])
    played = chip.sim(steps, timing_model=timing_model, processing_threads=1, spike_trace=True)
    name = network["name"]
    arrays = {
        f"{name}/{p['name']}/spikes": raster(played["spike_trace"], p, steps)
        for p in network["populations"]
    }
    arrays |= {f"{name}/energy_joules/{part}": value for part, value in played["energy"].items()}
    arrays |= {f"{name}/counts/{count}": played[count] for count in COUNTS}
    return arrays | {f"{name}/sim_time_seconds": played["sim_time"]}


if __name__ == "__main__":
    with open(sys.argv[1]) as file:
        job = json.load(file)
    np.savez_compressed(
        sys.argv[2], **{key: array for network in job for key, array in run(network).items()}
    )
