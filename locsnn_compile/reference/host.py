"""The spikes that layers on the host send to the chip, from recordings of numbers in place of spikes.

The layers are evaluated with the same reference as any network, outside the chip.
"""

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
"""Number of values (neurons times steps times recordings) that are computed at a time: of 8 bytes each, 160 MB."""


def host_recordings(host: HostLayers, inputs: RealValues, steps: int | None = None) -> Recordings:
    """Return the spikes that the host sends for numbers, as recordings of the chip's input lines.

    ``steps``: for how many steps numbers without a step axis are repeated.
    """
    values = inputs.steps_of(host.input_shape, steps)
    neurons = sum(population.size for population in host.network.populations)
    recordings_at_once = max(1, MOST_VALUES // (values.shape[1] * neurons))
    parts = [
        _sent(host, values[first : first + recordings_at_once])
        for first in range(0, len(values), recordings_at_once)
    ]
    spikes = np.concatenate(parts)
    # Line i of the host is channel i of the chip's recordings: a single row of channels.
    lines = Channels(columns=host.lines)
    recordings = Recordings(
        spikes, inputs.labels, inputs.step_seconds, inputs.source, channels=lines
    )
    if host.scaling is not None:
        for sentence in host.scaling.cut_sentences(inputs.values):
            recordings = recordings.assuming(sentence)
    return recordings


def _wide_registers() -> Registers:
    """Return registers so wide that nothing wraps: integer neurons of frameworks have registers without a width."""
    widest = {"charge_bits": 40, "current_bits": 40, "voltage_bits": 40}
    return replace(hw.chip("loihi-sim").registers, **widest)


def _sent(host: HostLayers, values: FloatArray) -> ByteArray:
    """Return the spikes (samples, steps, lines), each in the step of the numbers that cause it."""
    steps = values.shape[1]
    # A population fires ``depth`` steps after its input: play as many steps more, and cut as many off at the front.
    numbers = values if host.scaling is None else host.scaling.scaled(values)
    played = np.pad(numbers, ((0, 0), (0, host.depth), (0, 0)))
    spikes = evaluate(host.network, played, registers=_wide_registers()).spikes
    in_step = [spikes[sent.population][:, sent.depth : sent.depth + steps] for sent in host.sends]
    return np.concatenate(in_step, axis=2)
