"""Networks that start at the first touch, and recordings of which some begin late.

A view (the input of one axis of a network) with ``align_events`` starts at the first step with that many events.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

KINDS = ["as drawn", "late", "at the last step", "empty"]
"""What :func:`late` makes of each of four recordings."""


def aligned(network, time=1, location=1):
    """Return the network with views that start at the first step of so many events, by axis; None: at step 0."""
    events = {"time": time, "location": location}
    return replace(
        network, views=tuple(replace(v, align_events=events[v.axis]) for v in network.views)
    )


def without_biases(network):
    """Return the network without biases on the time axis, since neurons with a bias may spike before the first touch."""
    populations = []
    for population in network.populations:
        neuron = population.neuron
        if population.axis == "time" and hasattr(neuron, "bias_mantissa"):
            neuron = replace(neuron, bias_mantissa=np.zeros_like(neuron.bias_mantissa))
            population = replace(population, neuron=neuron)
        populations.append(population)
    return replace(network, populations=tuple(populations))


def late(played, seed):
    """Return four recordings (4, steps, channels) as :data:`KINDS` says, silent before their first steps."""
    r = np.random.default_rng(seed)
    steps = played.shape[1]
    first_steps = []
    for kind in KINDS:
        late_step = int(r.integers(steps))  # drawn for every kind, so that seeds agree
        first_of_kind = {"late": late_step, "at the last step": steps - 1, "empty": steps}
        first_steps.append(first_of_kind.get(kind, 0))
    has_begun = np.arange(steps) >= np.array(first_steps)[:, None]
    return played * has_begun[:, :, None].astype(np.uint8)
