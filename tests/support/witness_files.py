"""Networks of Xylo and what a witness says of them, as arrays by ``number/name`` in a file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from hw_model.xylo.network import XyloNetwork, XyloPopulation

XYLO = Path(__file__).parents[1] / "xylo"
RECORDED = XYLO / "recorded-by-xylosim.npz"
"""Twelve networks, their inputs, and what xylosim 0.1.3 did: ``python -m tests.xylo.record`` writes it."""
RECORDED_COMPILED = XYLO / "compiled-by-xylosim.npz"
"""Networks that the compiler made, recordings, and what xylosim 0.1.3 did with them, by ``record.py`` as well."""
REGISTERS = ("spikes", "output_spikes", "i", "v", "output_i", "output_v")


def write_networks(path: Path, cases: Iterable[tuple[XyloNetwork, np.ndarray]]) -> None:
    """Write networks and their events; biases that are off are left out."""
    arrays = {}
    for number, (network, events) in enumerate(cases):
        for name, value in _arrays_of(network).items():
            arrays[f"{number}/{name}"] = value
        arrays[f"{number}/events"] = events
    np.savez_compressed(path, **arrays)


def read(path: Path) -> list[dict[str, np.ndarray]]:
    """Return the arrays of a file by name, number by number."""
    parts: dict[int, dict[str, np.ndarray]] = {}
    with np.load(path) as arrays:
        for key, array in arrays.items():
            number, name = key.split("/")
            parts.setdefault(int(number), {})[name] = array
    return [parts[number] for number in sorted(parts)]


def network_of(arrays: Mapping[str, np.ndarray]) -> XyloNetwork:
    """Return the network that a file holds."""
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
