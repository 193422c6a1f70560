"""Choose the options of a training run that the user did not give, from the training recordings, and say why.

What is chosen: the network and its windows, the optimizer, the learning rate, dropout, class weights, the threshold of
neurons and the walk (the order in which a location branch visits the channels). An option that is given is never
changed, nor are options that say how data are read. The test part is never looked at.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hw_model.io.records import said_of
from hw_model.values import Frozen, IntArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES
from locsnn_compile.errors import counted
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.training.config import XYLO_MODEL, Need, TrainingConfig, config_from_mapping
from locsnn_compile.training.rates import rate_for_updates
from locsnn_compile.training.window_choice import choose_windows, levels_text

COUNTING = "window-snn"
"""The network that is chosen, whose neurons count events in windows of time."""
COUNTING_AND_SPIKING = "hybrid-window"
"""The network that is chosen if the user gave an option of spiking neurons, which the first does not have."""
_OF_DESCENT = """
    learning_rate schedule batch_size loss count_scale label_smoothing
    neighbour_smoothing class_order class_weights weight_average pruned
    event_dropout channel_dropout taxel_dropout event_noise mixing cut_end
    time_stretch time_shift taxel_shift target
"""
DESCENT = frozenset(_OF_DESCENT.split())
"""Options that have an effect, or help, only if weights are learned by gradient descent."""
OPTIONS_OF_WINDOWS = ("window_steps", "window_stride", "window_levels")
SHORT_STEPS = 50
"""Recordings of fewer steps are short: potentials hardly reach the published threshold in them."""
SHORT_THETA = 2.0
"""The threshold for short recordings. On grasps of 24 steps, it doubled the accuracy of ``hybrid``, compared with the
published threshold of 10."""
LARGEST_SCORE = 10.0
"""The score of a class whose output spikes in every step (``count_scale`` times the steps). If the largest score is
smaller, cross-entropy asks for ever more spikes, and hidden neurons end up spiking all the time."""
UNEVEN_FROM = 2.0
"""The number of recordings of the commonest class divided by that of the rarest, from which on recordings of rare
classes weigh more, so that all classes count alike. Chosen by hand."""


class Reason(Frozen):
    """Options that were chosen together, name -> value, and why."""

    values: Mapping[str, Any]
    why: str

    @property
    def words(self) -> str:
        """The line that states them."""
        options = ", ".join(f"{name} {value}" for name, value in self.values.items())
        return f"{options}: {self.why}"


class Chosen(Frozen):
    """A complete configuration, what of it was chosen from the data (``reasons``), and from which (``facts``)."""

    config: TrainingConfig
    facts: str
    reasons: tuple[Reason, ...]

    @property
    def lines(self) -> tuple[str, ...]:
        """The lines that state what was chosen; empty if nothing was."""
        if not self.reasons:
            return ()
        return (
            f"chosen from the train part ({self.facts}):",
            *(f"  {reason.words}" for reason in self.reasons),
        )

    @property
    def text(self) -> str:
        """The text that a checkpoint stores."""
        return "; ".join(reason.words for reason in self.reasons)


def choose(
    values: Mapping[str, Any],
    recordings: Recordings,
    classes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Chosen:
    """Return the configuration of the given ``values``, completed from the train part ``recordings``.

    With ``defaults: fixed``, nothing is chosen. ``classes``: their number, if it is more than the labels show.
    ``progress`` is called with (windows judged, windows to judge).
    """
    config = config_from_mapping(values)
    labels = recordings.needed_labels(purpose="train on")
    known_classes = max(classes or 0, len(recordings.class_names or ()))
    recordings_of_class = np.bincount(labels, minlength=known_classes)
    facts = _facts(recordings, len(recordings_of_class))
    choices = _Choices(config, frozenset(values))
    if config.defaults == "data" and recordings.spikes.any():
        _choose_all(choices, values, recordings, recordings_of_class, progress)
    return Chosen(choices.config, facts, tuple(choices.reasons))


@dataclass(eq=False)
class _Choices:
    """The configuration so far, the options that were ``given`` and must not change, and the choices made so far."""

    config: TrainingConfig
    given: frozenset[str]
    reasons: list[Reason] = field(default_factory=list)

    def settle(self, why: str, **options: Any) -> None:
        """Set these options, except those that were given, for the reason ``why``."""
        open_options = {name: value for name, value in options.items() if name not in self.given}
        if open_options:
            self.config = replace(self.config, **open_options)
            self.reasons.append(Reason(open_options, why))


def _choose_all(
    choices: _Choices,
    values: Mapping[str, Any],
    recordings: Recordings,
    recordings_of_class: IntArray,
    progress: Callable[[int, int], None] | None,
) -> None:
    """Choose the network, and then the options that suit it and the recordings."""
    if "model" not in choices.given and choices.config.model != XYLO_MODEL:
        model, why = _model(choices.config, choices.given)
        # A network has defaults of its own, so all options are read anew.
        choices.config = config_from_mapping({**values, "model": model})
        choices.reasons.append(Reason({"model": model}, why))
    computes_output = _may_compute_output(choices, recordings_of_class)
    structure = ARCHITECTURES[choices.config.model]
    if structure.window_branch and not choices.given & set(OPTIONS_OF_WINDOWS):
        _choose_windows(choices, recordings, progress, smoothing_too=computes_output)
    if computes_output:
        # Nothing is learned by descent, so dropout and further epochs would change nothing.
        choices.settle(
            "its output is computed, so it does not depend on the number of updates",
            optimizer="prototypes",
            event_dropout=0.0,
            channel_dropout=0.0,
            epochs=1,
        )
        return
    if structure.neurons in ("srm", "lif"):
        _choose_for_spiking(choices, recordings)
    if structure.neurons == "xylo":
        _choose_for_xylo(choices, recordings)
    rarest = int(recordings_of_class[recordings_of_class > 0].min())
    commonest = int(recordings_of_class.max())
    if commonest >= UNEVEN_FROM * rarest and choices.config.optimizer != "prototypes":
        why = f"classes have {rarest} to {commonest} recordings"
        choices.settle(why, class_weights="balanced")


def _may_compute_output(choices: _Choices, recordings_of_class: IntArray) -> bool:
    """Return whether the output may be computed from prototypes instead of being learned by descent.

    That is so if no option asks for descent, and at least two classes exist, of which all occur.
    """
    network_can = choices.config.model == COUNTING
    optimizer_is_open = choices.config.optimizer in ("sgd", "prototypes")
    asks_for_descent = bool(choices.given & (DESCENT | {"optimizer"}))
    all_classes_occur = bool(recordings_of_class.all()) and len(recordings_of_class) > 1
    return network_can and optimizer_is_open and not asks_for_descent and all_classes_occur


def _choose_windows(
    choices: _Choices,
    recordings: Recordings,
    progress: Callable[[int, int], None] | None,
    *,
    smoothing_too: bool,
) -> None:
    """Choose windows and levels by cross-validation; if ``smoothing_too``, also the smoothing of prototypes."""
    config = choices.config
    labels = recordings.needed_labels(purpose="train on")
    polarities = POLARITIES if config.sensor is None else config.sensor.polarities
    choice = choose_windows(recordings.spikes, labels, polarities, config.seed, progress)
    if choice is None:
        # The defaults, cut to the recordings: a window cannot be longer, and a level of 2 needs two steps.
        steps = min(config.window_steps, recordings.spikes.shape[1])
        levels = "1" if steps < 2 else config.window_levels
        why = "there are too few recordings to compare others"
        choices.settle(why, window_steps=steps, window_levels=levels)
        return
    choices.settle(
        f"the best of {choice.candidates} in {choice.folds}-fold cross-validation on "
        f"{counted(choice.recordings, 'recording')}, accuracy {choice.accuracy:.3f}",
        window_steps=choice.windows.steps,
        window_stride=choice.windows.stride,
        window_levels=levels_text(choice.windows.levels),
    )
    if smoothing_too:
        choices.settle("the smoothing of that cross-validation", weight_decay=choice.smoothing)


def _choose_for_spiking(choices: _Choices, recordings: Recordings) -> None:
    """Choose the learning rate, the threshold and the walk of neurons that spike."""
    config = choices.config
    structure = ARCHITECTURES[config.model]
    learned_from = len(recordings) * (1.0 - config.validation_fraction)
    updates = config.epochs * math.ceil(learned_from / config.batch_size)
    # Two digits, as a user would write the option.
    rate = float(f"{rate_for_updates(updates):.2g}")
    if config.optimizer in ("adamw", "rmsprop") and rate != config.learning_rate:
        choices.settle(f"there are {updates} updates of the weights", learning_rate=rate)
    steps = recordings.spikes.shape[1]
    if structure.neurons == "srm" and steps < SHORT_STEPS:
        choices.settle(f"recordings have {steps} steps", theta=SHORT_THETA)
    if "location" in structure.branches and config.grid is not None:
        choices.settle("neighbours on the grid are near on this walk", order="hilbert")


def _choose_for_xylo(choices: _Choices, recordings: Recordings) -> None:
    """Choose ``count_scale``, the amount that a spike of an output adds to the score of its class."""
    config = choices.config
    steps = recordings.spikes.shape[1]
    count_scale = float(f"{LARGEST_SCORE / steps:.2g}")
    if config.loss == "cross-entropy" and count_scale != config.count_scale:
        why = f"an output spikes at most once in each of {counted(steps, 'step')}"
        choices.settle(why, count_scale=count_scale)


def _model(config: TrainingConfig, given: frozenset[str]) -> tuple[str, str]:
    """Return (network, why): the one that counts, unless a ``given`` option has no effect there."""
    counting = replace(config, model=COUNTING)
    for option in sorted(given):
        for need in said_of(TrainingConfig)[option]:
            if isinstance(need, Need) and not need.counts(counting, ARCHITECTURES[COUNTING]):
                return COUNTING_AND_SPIKING, f"{option} was given, which {COUNTING} does not have"
    return COUNTING, "its neurons count events in windows of time"


def _facts(recordings: Recordings, classes: int) -> str:
    """Return the sizes of the recordings in words."""
    samples, steps, channels = recordings.spikes.shape
    sizes = (
        f"{counted(samples, 'recording')}, {channels} channels, {steps} steps, {classes} classes"
    )
    return f"{sizes}, {recordings.spikes.mean():.2g} events per channel and step"
