"""Play networks in SpiNNaker's machine code: ``drive_spinnaker.py NETWORKS RESULT``.

Both files hold arrays by ``number/name``. With ``--exponentials`` instead of networks, the result
holds both exponential functions of the machine code for every argument within their range, and for
one argument beyond each end.
"""

import sys

import numpy as np
from spinnaker_machine import Core, Machine, installed_file, read_checked

EXPONENT_MIN = -340695
EXPONENT_MAX = 363408
"""The range of arguments, in s16.15, beyond which the functions return 0 or the largest number."""
RECEPTORS = 2


def cores_of(content, network):
    """Return the cores of all populations, and for each the neurons that it has."""
    cores = []
    neurons = []
    first = 0
    names = [name for name in network if name.startswith("parameters.")]
    for size, slots, per_core, *shifts in network["populations"].tolist():
        for start in range(first, first + size, per_core):
            of_core = np.arange(start, min(start + per_core, first + size))
            parameters = {name.partition(".")[2]: network[name][of_core] for name in names}
            cores.append(Core(Machine(content), parameters, shifts, slots))
            neurons.append(of_core)
        first += size
    return cores, neurons


def rows_of(network, neurons):
    """Return the synapses of each source on each core, (neuron of the core, receptor, weight, delay), by source and core."""
    core_of = np.concatenate([np.full(len(part), core) for core, part in enumerate(neurons)])
    place_of = np.concatenate([np.arange(len(part)) for part in neurons])
    source, target, receptor, weight, delay = network["synapses"].T
    columns = np.column_stack([place_of[target], receptor, weight, delay])
    rows = {}
    for n in range(len(source)):
        rows.setdefault((int(source[n]), int(core_of[target[n]])), []).append(columns[n])
    return {key: np.array(row) for key, row in rows.items()}


def play(content, network):
    """Return the constants, and registers and spikes of every step."""
    cores, neurons = cores_of(content, network)
    rows = rows_of(network, neurons)
    spikes = network["spikes"]
    lateness = network["lateness"]
    constants = [core.constants() for core in cores]
    result = {name: joined([part[name] for part in constants]) for name in constants[0]}
    steps = {name: [] for name in ("fired", "recorded_v", "v", "current", "refractory")}
    waiting = {}
    for t in range(len(spikes)):
        fired = np.concatenate([core.step(t) for core in cores])
        registers = [core.registers() for core in cores]
        steps["fired"].append(fired)
        steps["recorded_v"].append(np.concatenate([core.recorded_v() for core in cores]))
        for name in ("v", "current", "refractory"):
            steps[name].append(joined([part[name] for part in registers]))
        # A spike is processed when it arrives: in its own step, or `late` steps later, when only its time stamp tells.
        for source in np.flatnonzero(np.concatenate([spikes[t], fired])).tolist():
            late = int(lateness[t, source])
            waiting.setdefault(t + late, []).append((source, late))
        for source, late in waiting.pop(t, []):
            for number, core in enumerate(cores):
                if (source, number) in rows:
                    core.process_row(t, late, rows[source, number])
    result |= {name: np.stack(parts) for name, parts in steps.items()}
    result["counts"] = np.sum([core.counts() for core in cores], axis=0)
    return result


def joined(parts):
    return np.concatenate(parts)


def exponentials(content):
    """Return the arguments and the values of both exponential functions."""
    machine = Machine(content)
    x = range(EXPONENT_MIN - 1, EXPONENT_MAX + 2)
    return {
        "x": np.array(x),
        "expk": np.array([machine.call("expk", argument) for argument in x]),
        "expulr": np.array([machine.call("expulr", argument) for argument in x]),
    }


def main():
    networks_file, result_file = sys.argv[1:]
    content = read_checked(installed_file())
    if networks_file == "--exponentials":
        np.savez_compressed(result_file, **exponentials(content))
        return
    networks = {}
    with np.load(networks_file) as arrays:
        for key, array in arrays.items():
            number, name = key.split("/")
            networks.setdefault(number, {})[name] = array
    results = {}
    for number, network in networks.items():
        for name, array in play(content, network).items():
            results[f"{number}/{name}"] = array
    np.savez_compressed(result_file, **results)


if __name__ == "__main__":
    main()
