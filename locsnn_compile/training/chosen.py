"""Options that nobody gave, chosen from the recordings to train on, and why.

What is chosen: the network and its windows, the optimizer, the learning rate, dropout, class weights, the threshold of
neurons and the walk. An option that is given stays as it is, and so do those that say how data are read. The test part
is never looked at.
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
COUNTING_AND_SPIKING = "hybrid-window"
"""The network that is chosen, and the one where an option asks for neurons that the first does not have."""
_OF_DESCENT = """
    learning_rate schedule batch_size loss count_scale label_smoothing
    neighbour_smoothing class_order class_weights weight_average pruned
    event_dropout channel_dropout taxel_dropout event_noise mixing cut_end
    time_stretch time_shift taxel_shift target
"""
DESCENT = frozenset(_OF_DESCENT.split())
"""Options that have an effect, or help, only where weights descend along a gradient."""
OPTIONS_OF_WINDOWS = ("window_steps", "window_stride", "window_levels")
SHORT_STEPS = 50
SHORT_THETA = 2.0
"""In recordings of so few steps, potentials hardly reach the published threshold. On grasps of 24 steps, a threshold of
2 instead of 10 doubled the accuracy of ``hybrid``."""
LARGEST_SCORE = 10.0
"""Of a class whose output spikes in every step. Where it is smaller, a loss asks for ever more spikes, and hidden
neurons end in spiking all the time."""
UNEVEN_FROM = 2.0
"""Ratio of the commonest and the rarest class from which classes are made to count alike."""


class Reason(Frozen):
    """Options that were chosen together, by name, and why."""

    values: Mapping[str, Any]
    why: str

    @property
    def words(self) -> str:
        """The line that states them."""
        options = ", ".join(f"{name} {value}" for name, value in self.values.items())
        return f"{options}: {self.why}"


class Chosen(Frozen):
    """A complete configuration, and what of it was chosen from the data."""

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
        """What a checkpoint keeps of it."""
        return "; ".join(reason.words for reason in self.reasons)


def choose(
    values: Mapping[str, Any],
    recordings: Recordings,
    classes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Chosen:
    """Return the configuration of the given ``values``, completed from the train part ``recordings``.

    With ``defaults: fixed``, nothing is chosen. ``classes``: their number, if it is more than the labels show.
    ``progress`` is called with the number of windows judged and to judge.
    """
    config = config_from_mapping(values)
    labels = recordings.needed_labels("train on")
    known_classes = max(classes or 0, len(recordings.class_names or ()))
    recordings_of_class = np.bincount(labels, minlength=known_classes)
    facts = _facts(recordings, len(recordings_of_class))
    choices = _Choices(config, frozenset(values))
    if config.defaults == "data" and recordings.spikes.any():
        _choose_all(choices, values, recordings, recordings_of_class, progress)
    return Chosen(choices.config, facts, tuple(choices.reasons))


@dataclass(eq=False)
class _Choices:
    """The configuration so far, the options that were ``given`` and stay as they are, and why others changed."""

    config: TrainingConfig
    given: frozenset[str]
    reasons: list[Reason] = field(default_factory=list)

    def settle(self, why: str, **options: Any) -> None:
        """Take these options, except those that were given."""
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
    """Choose the network, then what suits it."""
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
    """Tell whether prototypes are computed: if no option asks for descent, and all of two classes or more occur."""
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
    """Choose the windows of time and their levels by cross-validation, and with them the smoothing of prototypes."""
    config = choices.config
    labels = recordings.needed_labels("train on")
    polarities = POLARITIES if config.sensor is None else config.sensor.polarities
    choice = choose_windows(recordings.spikes, labels, polarities, config.seed, progress)
    if choice is None:
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
    rate = float(f"{rate_for_updates(updates):.2g}")
    if config.optimizer in ("adamw", "rmsprop") and rate != config.learning_rate:
        choices.settle(f"there are {updates} updates of the weights", learning_rate=rate)
    steps = recordings.spikes.shape[1]
    if structure.neurons == "srm" and steps < SHORT_STEPS:
        choices.settle(f"recordings have {steps} steps", theta=SHORT_THETA)
    if "location" in structure.branches and config.grid is not None:
        choices.settle("neighbours on the grid are near on this walk", order="hilbert")


def _choose_for_xylo(choices: _Choices, recordings: Recordings) -> None:
    """Choose what a spike of an output adds to the score of its class."""
    config = choices.config
    steps = recordings.spikes.shape[1]
    count_scale = float(f"{LARGEST_SCORE / steps:.2g}")
    if config.loss == "cross-entropy" and count_scale != config.count_scale:
        why = f"an output spikes at most once in each of {counted(steps, 'step')}"
        choices.settle(why, count_scale=count_scale)


def _model(config: TrainingConfig, given: frozenset[str]) -> tuple[str, str]:
    """Return the network for options that are ``given``, and why."""
    counting = replace(config, model=COUNTING)
    for option in sorted(given):
        for need in said_of(TrainingConfig)[option]:
            if isinstance(need, Need) and not need.counts(counting, ARCHITECTURES[COUNTING]):
                return COUNTING_AND_SPIKING, f"{option} was given, which {COUNTING} does not have"
    return COUNTING, "its neurons count events in windows of time"


def _facts(recordings: Recordings, classes: int) -> str:
    samples, steps, channels = recordings.spikes.shape
    sizes = (
        f"{counted(samples, 'recording')}, {channels} channels, {steps} steps, {classes} classes"
    )
    return f"{sizes}, {recordings.spikes.mean():.2g} events per channel and step"
