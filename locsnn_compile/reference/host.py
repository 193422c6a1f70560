"""What the layers on the host send: the float reference of these layers, on numbers in place of spikes."""

import numpy as np

from hw_model.values import ByteArray, FloatArray
from locsnn_compile.data.real_values import RealValues
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import HostLayers
from locsnn_compile.reference.evaluate import evaluate

MOST_VALUES = 20_000_000
"""Numbers of neurons and steps that are held at a time, of 8 bytes each."""


def host_recordings(host: HostLayers, inputs: RealValues, steps: int | None = None) -> Recordings:
    """Return the spikes that the host sends for numbers, as recordings of the chip's input lines.

    ``steps``: for how many steps numbers without a step axis are held.
    """
    values = inputs.steps_of(host.input_shape, steps)
    neurons = sum(population.size for population in host.network.populations)
    at_a_time = max(1, MOST_VALUES // (values.shape[1] * neurons))
    parts = [
        _sent(host, values[first : first + at_a_time]) for first in range(0, len(values), at_a_time)
    ]
    return Recordings(np.concatenate(parts), inputs.labels, inputs.step_seconds, inputs.source)


def _sent(host: HostLayers, values: FloatArray) -> ByteArray:
    """Return the spikes (samples, steps, lines) in the step of the numbers that cause them."""
    steps = values.shape[1]
    # A population fires some steps after its input: as many more are played, and cut at the front.
    played = np.pad(values, ((0, 0), (0, host.depth), (0, 0)))
    spikes = evaluate(host.network, played).spikes
    in_step = [spikes[sent.population][:, sent.depth : sent.depth + steps] for sent in host.sends]
    return np.concatenate(in_step, axis=2)
