"""What the layers on the host send: the reference of these layers, on numbers in place of spikes."""

from dataclasses import replace

import numpy as np

import hw_model as hw
from hw_model.description.chip import Registers
from hw_model.values import ByteArray, FloatArray
from locsnn_compile.data.channels import Channels
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
    spikes = np.concatenate(parts)
    # Line i is input i of the chip: the host numbers both.
    lines = Channels(columns=host.lines)
    recordings = Recordings(
        spikes, inputs.labels, inputs.step_seconds, inputs.source, channels=lines
    )
    if host.scaling is not None:
        for sentence in host.scaling.cut_sentences(inputs.values):
            recordings = recordings.assuming(sentence)
    return recordings


def _wide_registers() -> Registers:
    """Return registers that hold what integer neurons of frameworks reach: those have no width."""
    widest = {"charge_bits": 40, "current_bits": 40, "voltage_bits": 40}
    return replace(hw.chip("loihi-sim").registers, **widest)


def _sent(host: HostLayers, values: FloatArray) -> ByteArray:
    """Return the spikes (samples, steps, lines) in the step of the numbers that cause them."""
    steps = values.shape[1]
    # A population fires some steps after its input: as many more are played, and cut at the front.
    numbers = values if host.scaling is None else host.scaling.scaled(values)
    played = np.pad(numbers, ((0, 0), (0, host.depth), (0, 0)))
    spikes = evaluate(host.network, played, registers=_wide_registers()).spikes
    in_step = [spikes[sent.population][:, sent.depth : sent.depth + steps] for sent in host.sends]
    return np.concatenate(in_step, axis=2)
