"""Faults that the Lava emitter could have, planted in the arrays of a network that it wrote.

Keys of the arrays are ``run/part/name``, as in ``network.npz``. Tests check that each fault shows in the spikes or
registers of some program.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, NDArray[Any]]


def changed(name: str, change: Callable[[NDArray[Any]], Any]) -> Callable[[Arrays], Arrays]:
    """Return a fault that applies ``change`` to all arrays of a name."""

    def fault(arrays: Arrays) -> Arrays:
        faulty = dict(arrays)
        for key, array in arrays.items():
            if key.endswith(f"/{name}"):
                faulty[key] = np.asarray(change(array))
        return faulty

    return fault


def _later_rows(spikes: NDArray[Any]) -> NDArray[Any]:
    """Move all input spikes by one row."""
    late = np.roll(spikes, 1, axis=0)
    late[0] = 0
    return late


def _first_delay(delays: NDArray[Any]) -> NDArray[Any]:
    """Give all synapses of a sender the same delay, as if an axon had one delay."""
    return np.broadcast_to(delays[:1], delays.shape)


def _without_repeats(arrays: Arrays) -> Arrays:
    """Lose the last block of synapses of every run."""
    last_number: dict[str, int] = {}
    for key in arrays:
        run, part, *_ = key.split("/")
        if part.startswith("synapses"):
            number = int(part.removeprefix("synapses"))
            last_number[run] = max(last_number.get(run, 0), number)
    lost_prefixes = tuple(f"{run}/synapses{number}/" for run, number in last_number.items())
    return {key: array for key, array in arrays.items() if not key.startswith(lost_prefixes)}


FAULTS: Mapping[str, Callable[[Arrays], Arrays]] = {
    "du is the decay of u, not one less": changed("du", lambda du: du + 1),
    "dv is one more": changed("dv", lambda dv: np.minimum(dv + 1, 4095)),
    "the threshold is met at, not above": changed("vth", lambda vth: np.maximum(vth - 1, 0)),
    "the threshold is one more": changed("vth", lambda vth: np.minimum(vth + 1, 2**17 - 1)),
    "biases are left out": changed("bias_mant", lambda bias: 0 * bias),
    "biases lose their exponent": changed("bias_exp", lambda exponent: 0 * exponent),
    "delays are one more": changed("delays", lambda delays: delays + 1),
    "delays are left out": changed("delays", lambda delays: 0 * delays),
    "synapses of a sender share a delay": changed("delays", _first_delay),
    "exponents are left out": changed("weight_exp", lambda exponent: 0 * exponent),
    "exponents are one less": changed("weight_exp", lambda exponent: np.maximum(exponent - 1, 0)),
    "weights have the other sign": changed("weights", lambda weights: -weights),
    "all formats are of 6 bits": changed("num_weight_bits", lambda bits: 0 * bits + 6),
    "all formats have a sign": changed("sign_mode", lambda mode: "mixed"),
    "inputs act one step late": changed("spikes", _later_rows),
    "the last synapses are lost": _without_repeats,
}
"""Faults by description; each takes the arrays of a network and returns faulty ones.

``du`` and ``dv`` are Lava's decays: a ``du`` of d keeps 1 - (d + 1) / 4096 of a current.
"""
