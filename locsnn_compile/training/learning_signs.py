"""Warn the user, early in a run, if it learns nothing, and suggest an option that helps.

A spiking layer whose neurons are silent sends no gradient to the layer before it, and an optimizer such as AdamW moves
a weight by about one learning rate per update, whatever the gradient. A run of few updates may therefore never reach
the weights at which its outputs spike. The *reach* of a run is how far its updates can move a weight.
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
"""How many recordings are evaluated to see whether neurons spike; chosen by hand."""
STEPS_WITH_THE_GRADIENT = ("adamw", "rmsprop")
"""Optimizers that divide a gradient by its size, so that an update moves a weight by about the learning rate."""


def epoch_to_look_at(epochs: int) -> int:
    """Return the epoch after which the early remark is made: a tenth of all epochs, but from 3 to 10.

    Earlier, even good runs are at chance; later, a user has waited for nothing. Chosen by hand.
    """
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
    updates_per_epoch = math.ceil(recordings / config.batch_size)
    rates = [learning_rate(config, epoch, epochs) for epoch in range(1, epochs + 1)]
    return Reach(updates_per_epoch * epochs, updates_per_epoch * math.fsum(rates))


class Activity(Frozen):
    """What the neurons of a network do on a few recordings of the train part.

    - ``hidden_silence``: of all pairs of a hidden neuron and a recording, the share without a spike; None if the
      network has no hidden neurons that learn
    - ``predicted``: (samples,), the predicted classes, -1 where the scores of all classes are equal
    """

    hidden_silence: float | None
    predicted: IntArray


@torch.no_grad()
def activity_of(network: TouchModel, spikes: ByteArray) -> Activity:
    """Return the activity on recordings ``spikes`` (samples, steps, channels)."""
    like = next(network.parameters())
    result = network(torch.from_numpy(np.array(spikes)).to(like))
    silent_shares = [
        (hidden.sum(dim=1) == 0).double().mean() for hidden in network.hidden_spikes(result)
    ]
    hidden_silence = float(torch.stack(silent_shares).mean()) if silent_shares else None
    return Activity(hidden_silence, decided(network.total(result).cpu().numpy()))


def advice(config: TrainingConfig, reach: Reach) -> str:
    """Return the sentence that says what to do about a run that does not learn."""
    if config.model == XYLO_MODEL:
        return "Give more --epochs, or another --learning-rate."
    # A rate that is hardly larger than the run's would not help.
    rate = rate_for_updates(reach.updates)
    if config.optimizer in STEPS_WITH_THE_GRADIENT and rate > 1.2 * config.learning_rate:
        return f"Give --learning-rate {rate:.2g}."
    return "Give more --epochs, or --model window-snn."


def early_remark(
    config: TrainingConfig, network: TouchModel, spikes: ByteArray, labels: IntArray, epoch: int
) -> str | None:
    """Return a sentence if a run has learned nothing up to this epoch of its first phase; None if it has.

    ``spikes`` and ``labels`` are the recordings that it learns from.
    """
    # Spread over all recordings, which files often list class by class; no row twice if there are few.
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
    """Return whether theta, an option of the run, is the threshold of the network's neurons."""
    return network.description.structure.neurons == "srm"
