"""The three groups of synapses of a Xylo, each of which has its own shift of weights.

All projections of the network within a group become one matrix on the chip.
"""

from enum import Enum
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from hw_model.values import FloatArray, IntArray
from locsnn_compile.network.projections import ChipProjection, Projection
from locsnn_compile.xylo.parts import XyloParts
from locsnn_compile.xylo.quantized import places

Numbers = TypeVar("Numbers", FloatArray, IntArray)


class SynapseGroup(Enum):
    """A group of synapses. Its value is the word for it in error messages."""

    INTO_HIDDEN = "inputs"
    AMONG_HIDDEN = "hidden neurons"
    INTO_OUTPUTS = "outputs"


class GroupedWeights(NamedTuple, Generic[Numbers]):
    """The weights of the three groups, source first: (inputs, hidden), (hidden, hidden) and (hidden, outputs)."""

    into_hidden: Numbers
    among_hidden: Numbers
    into_outputs: Numbers


def group_of(parts: XyloParts, projection: Projection | ChipProjection) -> SynapseGroup:
    """Return the group that a projection belongs to."""
    if projection.target == parts.outputs.name:
        return SynapseGroup.INTO_OUTPUTS
    if projection.source == parts.view.name:
        return SynapseGroup.INTO_HIDDEN
    return SynapseGroup.AMONG_HIDDEN


def no_weights(parts: XyloParts, of_type: type[np.generic]) -> GroupedWeights[Numbers]:
    """Return weights of 0 in the shapes of a network, to add projections to."""
    hidden = sum(population.size for population in parts.hidden)
    return GroupedWeights(
        into_hidden=np.zeros((parts.view.lines, hidden), dtype=of_type),
        among_hidden=np.zeros((hidden, hidden), dtype=of_type),
        into_outputs=np.zeros((hidden, parts.outputs.size), dtype=of_type),
    )


def add_weights(
    weights: GroupedWeights[Numbers],
    parts: XyloParts,
    projection: Projection | ChipProjection,
    added: Numbers,
) -> None:
    """Add the weights ``added`` (sources, targets) of a projection to its group, in place."""
    place = places(parts.hidden)
    match group_of(parts, projection):
        case SynapseGroup.INTO_OUTPUTS:
            weights.into_outputs[place[projection.source]] += added
        case SynapseGroup.INTO_HIDDEN:
            weights.into_hidden[:, place[projection.target]] += added
        case SynapseGroup.AMONG_HIDDEN:
            weights.among_hidden[place[projection.source], place[projection.target]] += added
