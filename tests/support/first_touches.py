"""Networks that start at the first touch, and recordings of which some begin late."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

KINDS = ["as drawn", "late", "at the last step", "empty"]


def aligned(network, time=1, location=1):
    """Return the network with views that start at a step of so many events, by axis; None: at the first step."""
    events = {"time": time, "location": location}
    return replace(
        network, views=tuple(replace(v, align_events=events[v.axis]) for v in network.views)
    )


def without_biases(network):
    """On-grid neurons of the time axis may have biases, with which no phase starts late."""
    kept = []
    for p in network.populations:
        none = (
            np.zeros_like(p.neuron.bias_mantissa)
            if p.axis == "time" and hasattr(p.neuron, "bias_mantissa")
            else None
        )
        kept.append(p if none is None else replace(p, neuron=replace(p.neuron, bias_mantissa=none)))
    return replace(network, populations=tuple(kept))


def late(played, seed):
    """The same recordings from some step on, from the last, or of none."""
    r, steps = np.random.default_rng(seed), played.shape[1]
    first = [
        {"late": int(r.integers(steps)), "at the last step": steps - 1, "empty": steps}.get(k, 0)
        for k in KINDS
    ]
    return played * (np.arange(steps) >= np.array(first)[:, None])[:, :, None].astype(np.uint8)
