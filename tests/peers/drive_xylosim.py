"""Play networks to xylosim 0.1.3: ``drive_xylosim.py NETWORKS RESULT``, in an environment of its own.

Both files hold arrays by ``number/name``.
"""

import json
import sys

import numpy as np
from xylosim.v2 import XyloLayer, XyloSynapse


def synapses(weights):
    """Return a list of synapses for every source of weights (sources, targets, currents)."""
    lists = [[] for _ in weights]
    for source, target, current in np.argwhere(weights).tolist():
        weight = int(weights[source, target, current])
        lists[source].append(XyloSynapse(target, current, weight))
    return lists


def layer_of(network):
    """Return a layer at rest, and its synapses. The layer only points to them, so the caller must keep them alive."""
    owned = [synapses(network[name]) for name in ("weights_in", "weights_hidden")]
    owned.append(synapses(network["weights_out"][:, :, None]))
    hidden, outputs = network["weights_out"].shape
    biased = "bias" in network
    layer = XyloLayer(
        synapses_in=owned[0],
        synapses_rec=owned[1],
        synapses_out=owned[2],
        aliases=json.loads(str(network["aliases"])) or [[]] * hidden,
        threshold=network["threshold"].tolist(),
        threshold_out=network["threshold_out"].tolist(),
        has_bias=biased,
        bias=network["bias"].tolist() if biased else [0] * hidden,
        bias_out=network["bias_out"].tolist() if biased else [0] * outputs,
        weight_shift_inp=int(network["shift_in"]),
        weight_shift_rec=int(network["shift_hidden"]),
        weight_shift_out=int(network["shift_out"]),
        dash_mem=network["dash_mem"].tolist(),
        dash_mem_out=network["dash_mem_out"].tolist(),
        dash_syns=network["dash_syn"].tolist(),
        dash_syns_out=network["dash_syn_out"].tolist(),
        name="witness",
    )
    return layer, owned


def play(network, events):
    """Return registers and spikes of every row."""
    layer, owned = layer_of(network)
    output_spikes = np.array(layer.evolve(events.tolist()))
    del owned
    currents = [layer.rec_i_syn, layer.rec_i_syn2][: network["dash_syn"].shape[1]]
    return {
        "spikes": np.array(layer.rec_recurrent_spikes),
        "output_spikes": output_spikes,
        "i": np.stack([np.array(current).T for current in currents], axis=-1),
        "v": np.array(layer.rec_v_mem).T,
        "output_i": np.array(layer.rec_i_syn_out).T,
        "output_v": np.array(layer.rec_v_mem_out).T,
    }


def read(path):
    """Return the networks of a file, each a mapping of arrays, by their number."""
    networks = {}
    with np.load(path) as arrays:
        for key, array in arrays.items():
            number, name = key.split("/")
            networks.setdefault(number, {})[name] = array
    return networks


def main():
    networks_file, result_file = sys.argv[1:]
    networks = read(networks_file)
    results = {}
    for number, network in networks.items():
        for name, array in play(network, network["events"]).items():
            results[f"{number}/{name}"] = array
    np.savez_compressed(result_file, **results)


if __name__ == "__main__":
    main()
