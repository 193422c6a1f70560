"""From a checkpoint of ``window-snn`` to a Network: hidden neurons without memory, outputs whose potentials are read.

The whole recording is one location step: every event has a line of its own, which the hidden neurons of its windows
hear. They spike in the next step, and one later the potential of an output is the sum of the weights of these spikes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from hw_model.mapping.graph import Readout
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.windows import BIAS, WEIGHT
from locsnn_compile.network.network import InputView, Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import ChipProjection, Projection, matrix, row_sums

Parts = tuple[Sequence[InputView], Sequence[Population], Sequence[Projection | ChipProjection], Readout]
"""Views, populations, projections and readout of a network."""
LAYERS = 2
"""Steps from an event to the outputs."""
UNREACHED = 1.1
"""The threshold of an output, as a multiple of all that can come at once: it never spikes, rounded weights or not."""


def window_parts(checkpoint: Checkpoint) -> Parts:
    """Return the parts of the network of a checkpoint of ``window-snn``."""
    description = checkpoint.description
    layout, windows = description.input, description.windows
    lines = layout.channels * layout.steps
    view = InputView("touch_transposed", "location", lines, description.walk, together=layout.channels, silence=LAYERS)
    synapses = windows.synapses(layout.steps, layout.channels)
    levels = np.tile(np.array(windows.levels, dtype=np.float64), synapses.shape[0] // len(windows.levels))
    hidden = Population(
        "location_hidden", "location", len(levels), Cuba.of(len(levels), decay_v=1.0, threshold=levels - 0.5)
    )
    weights = checkpoint.weights[WEIGHT].astype(np.float64)
    populations: list[Population] = [hidden]
    projections: list[Projection | ChipProjection] = [
        Projection(view.name, hidden.name, matrix(synapses, np.float64)),
    ]
    outputs = description.populations("location")[1:]
    # A share for each, so that none has to hold it all.
    bias = checkpoint.weights[BIAS].astype(np.float64) / len(outputs)
    for name, part in zip(outputs, description.output_parts, strict=True):
        heard = np.zeros_like(weights)
        heard[:, part] = weights[:, part]
        projections.append(Projection(hidden.name, name, matrix(sparse.csr_array(heard), np.float64)))
        most = float(row_sums(heard).max() + np.abs(bias).max())
        neuron = Cuba.of(len(bias), decay_v=1.0, threshold=UNREACHED * most if most > 0 else 1.0, bias=bias)
        populations.append(Population(name, "location", len(bias), neuron))
    return (view,), populations, projections, Readout(outputs, (1.0,) * len(outputs), potentials_from=LAYERS)
