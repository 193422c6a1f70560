"""Whether a run learns, with numbers, after a few of its epochs and at its end, and the option that helps.

A spiking layer whose neurons are silent sends no gradient to the layer before it, and an optimizer such as AdamW moves
a weight by about one learning rate per update, whatever the gradient. A run of few updates may therefore never reach
the weights at which its outputs spike.
"""

import math
from collections.abc import Callable

import numpy as np
import torch

from hw_model.mapping.graph import decided
from hw_model.values import ByteArray, Frozen, IntArray
from locsnn_compile.errors import counted
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.config import XYLO_MODEL, TrainingConfig
from locsnn_compile.training.measure import chance_remarks, silent_outputs
from locsnn_compile.training.rates import rate_for_updates
from locsnn_compile.training.schedule import learning_rate

Notice = Callable[[str], None]
"""Called with a sentence about a run while it goes on."""

LOOKED_AT = 64
"""Recordings that are played to see whether neurons spike."""
STEPS_WITH_THE_GRADIENT = ("adamw", "rmsprop")
"""Optimizers that divide a gradient by its size, so that an update moves a weight by about the learning rate."""


def epoch_to_look_at(epochs: int) -> int:
    """Return the epoch after which a run is looked at: a tenth of all, from 3 to 10."""
    return min(max(3, epochs // 10), 10)


class Reach(Frozen):
    """How far a phase of a run can move its weights: by ``distance`` in ``updates`` steps of the optimizer."""

    updates: int
    distance: float

    @property
    def words(self) -> str:
        """The sentence that says so."""
        return f"each weight could move by {self.distance:.2g} in {self.updates} steps"


def reach_of(config: TrainingConfig, recordings: int, epochs: int) -> Reach:
    """Return the reach of a phase of so many ``epochs`` over so many ``recordings``."""
    updates = math.ceil(recordings / config.batch_size)
    rates = [learning_rate(config, epoch, epochs) for epoch in range(1, epochs + 1)]
    return Reach(updates * epochs, updates * math.fsum(rates))


class Activity(Frozen):
    """What the neurons of a network do on a few recordings of the train part.

    ``hidden_silence``: the share of pairs of a hidden neuron and a recording without a spike, None if no hidden neuron
    learns. ``predicted`` (samples,): the classes, -1 where all classes tie.
    """

    hidden_silence: float | None
    predicted: IntArray


@torch.no_grad()
def activity_of(network: TouchModel, spikes: ByteArray) -> Activity:
    """Return the activity on spikes (samples, steps, channels)."""
    like = next(network.parameters())
    played = network(torch.from_numpy(np.array(spikes)).to(like))
    silent = [(spikes.sum(dim=1) == 0).double().mean() for spikes in network.hidden_spikes(played)]
    share = float(torch.stack(silent).mean()) if silent else None
    return Activity(share, decided(network.total(played).cpu().numpy()))


def advice(config: TrainingConfig, reach: Reach) -> str:
    """Return what to do about a run that does not learn, as the end of a sentence."""
    if config.model == XYLO_MODEL:
        return "Give more --epochs, or another --learning-rate."
    rate = rate_for_updates(reach.updates)
    if config.optimizer in STEPS_WITH_THE_GRADIENT and rate > 1.2 * config.learning_rate:
        return f"Give --learning-rate {rate:.2g}."
    return "Give more --epochs, or --model window-snn."


def early_remark(
    config: TrainingConfig, network: TouchModel, spikes: ByteArray, labels: IntArray, epoch: int
) -> str | None:
    """Return a sentence if a run has learned nothing after an epoch of its first phase; None if it has.

    ``spikes`` and ``labels`` are those that it learns from.
    """
    rows = np.unique(np.linspace(0, len(labels) - 1, LOOKED_AT).astype(np.int64))
    activity = activity_of(network, spikes[rows])
    reach = reach_of(config, len(labels), config.epochs)
    if (activity.predicted < 0).all():
        what = silent_outputs(network, len(rows))
    else:
        accuracy = float((activity.predicted == labels[rows]).mean())
        at_chance = chance_remarks(accuracy, labels[rows], "it learns from")
        if not at_chance:
            return None
        what = at_chance[0].removesuffix(".")
    if config.optimizer in STEPS_WITH_THE_GRADIENT:
        what = f"{what}; {hidden_words(activity)}{reach.words}"
        if _has_theta(network):
            what = f"{what} (the threshold of a neuron is {config.theta:g})"
    of_all = f"After {epoch} of {counted(config.epochs, 'epoch')}"
    return f"{of_all}: {what[0].lower()}{what[1:]}. {advice(config, reach)}"


def hidden_words(activity: Activity) -> str:
    """Return how silent hidden neurons are, as the start of a sentence; empty if none learns."""
    if activity.hidden_silence is None:
        return ""
    return f"hidden neurons are silent in {activity.hidden_silence:.0%} of the recordings; "


def _has_theta(network: TouchModel) -> bool:
    return network.description.structure.neurons == "srm"
