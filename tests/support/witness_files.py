"""Exchange networks of Xylo with a witness: another program that runs them, as xylosim.

Networks and results are arrays in files, see :mod:`tests.support.numbered_arrays`.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from hw_model.xylo.network import XyloNetwork, XyloPopulation
from tests.support import numbered_arrays

XYLO = Path(__file__).parents[1] / "xylo"
RECORDED = XYLO / "recorded-by-xylosim.npz"
"""Twelve networks, their inputs, and the registers of xylosim 0.1.3; ``python -m tests.xylo.record`` writes it."""
RECORDED_COMPILED = XYLO / "compiled-by-xylosim.npz"
"""Networks that the compiler wrote, recordings, and the registers of xylosim 0.1.3; ``record.py`` writes it as well."""
REGISTERS = ("spikes", "output_spikes", "i", "v", "output_i", "output_v")


def write_networks(path: Path, cases: Iterable[tuple[XyloNetwork, np.ndarray]]) -> None:
    """Write networks and their input events."""
    numbered_arrays.write(
        path, ({**_arrays_of(network), "events": events} for network, events in cases)
    )


def network_of(arrays: Mapping[str, np.ndarray]) -> XyloNetwork:
    """Return the network that one case of a file holds; :func:`write_networks` is the inverse."""
    aliases = json.loads(str(arrays["aliases"]))
    return XyloNetwork(
        hidden=XyloPopulation(
            arrays["dash_syn"], arrays["dash_mem"], arrays["threshold"], arrays.get("bias")
        ),
        outputs=XyloPopulation(
            arrays["dash_syn_out"],
            arrays["dash_mem_out"],
            arrays["threshold_out"],
            arrays.get("bias_out"),
        ),
        weights_in=arrays["weights_in"],
        weights_hidden=arrays["weights_hidden"],
        weights_out=arrays["weights_out"],
        shift_in=int(arrays["shift_in"]),
        shift_hidden=int(arrays["shift_hidden"]),
        shift_out=int(arrays["shift_out"]),
        aliases=tuple(map(tuple, aliases)) if aliases else None,
    )


def _arrays_of(network: XyloNetwork) -> dict[str, np.ndarray]:
    """Return a network as arrays; populations without biases have no array of them."""
    arrays = {
        "weights_in": network.weights_in,
        "weights_hidden": network.weights_hidden,
        "weights_out": network.weights_out,
        "shift_in": np.array(network.shift_in),
        "shift_hidden": np.array(network.shift_hidden),
        "shift_out": np.array(network.shift_out),
        "aliases": np.array(json.dumps(network.aliases or [])),
    }
    for population, ending in ((network.hidden, ""), (network.outputs, "_out")):
        arrays[f"dash_syn{ending}"] = population.dash_syn
        arrays[f"dash_mem{ending}"] = population.dash_mem
        arrays[f"threshold{ending}"] = population.threshold
        if population.bias is not None:
            arrays[f"bias{ending}"] = population.bias
    return arrays
