"""From a checkpoint in the integers of a Xylo to the parts of a Network."""

import numpy as np

from hw_model.arithmetic import xylo
from locsnn_compile.frontends.parts import VIEW_NAMES, Parts
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.xylo_entry import XyloNumbers
from locsnn_compile.network.network import InputView, Population
from locsnn_compile.network.projections import ChipProjection, matrix
from locsnn_compile.network.xylo_neurons import XyloNeuron

HIDDEN = "time_hidden"
"""The hidden population, and the name of its input weights in a checkpoint."""
OUTPUTS = "time_output"
"""The output population, and the name of its weights in a checkpoint."""
RECURRENT = "time_recurrent"
"""The name of the weights among hidden neurons in a checkpoint; there is no population of this name."""


def add_xylo(parts: Parts, checkpoint: Checkpoint, numbers: XyloNumbers) -> None:
    """Add hidden neurons with recurrent weights, and outputs, with the integers of a checkpoint."""
    description = checkpoint.description
    neuron = description.xylo_neuron
    hidden_dashes = neuron.hidden_dashes(description.hidden)
    hidden = XyloNeuron(
        dash_syn=hidden_dashes.syn,
        dash_mem=hidden_dashes.mem,
        threshold=np.full(description.hidden, numbers.hidden_threshold),
        most_spikes=xylo.HIDDEN_SPIKES_MAX,
    )
    outputs = XyloNeuron.of(
        description.classes,
        dash_syn=neuron.output_dash_syn,
        dash_mem=neuron.output_dash_mem,
        threshold=numbers.output_threshold,
        most_spikes=xylo.OUTPUT_SPIKES_MAX,
    )
    view = InputView(VIEW_NAMES["time"], "time", description.input.channels)
    parts.views.append(view)
    parts.populations.append(Population(HIDDEN, "time", description.hidden, hidden))
    parts.populations.append(Population(OUTPUTS, "time", description.classes, outputs))
    for source, target, name in (
        (view.name, HIDDEN, HIDDEN),
        (HIDDEN, HIDDEN, RECURRENT),
        (HIDDEN, OUTPUTS, OUTPUTS),
    ):
        mantissas = matrix(checkpoint.weights[name], np.int64)
        shift = numbers.populations[name].shift
        parts.projections.append(
            ChipProjection(source, target, mantissas, shift, xylo.WEIGHT_BITS, "mixed")
        )
    parts.outputs[OUTPUTS] = None
