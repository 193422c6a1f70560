"""Options that nobody gave, chosen from the recordings to train on, and why.

What is chosen: the network and its windows, the optimizer, the learning rate, dropout, class weights, the threshold of
neurons and the walk. An option that is given stays as it is, and so do those that say how data are read. The test part
is never looked at.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hw_model.io.records import said_of
from hw_model.values import Frozen
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import POLARITIES
from locsnn_compile.errors import counted
from locsnn_compile.models.architectures import ARCHITECTURES
from locsnn_compile.training.config import Need, TrainingConfig, config_from_mapping
from locsnn_compile.training.rates import rate_for_updates
from locsnn_compile.training.window_choice import choose_windows, levels_text

COUNTING, COUNTING_AND_SPIKING = "window-snn", "hybrid-window"
"""The network that is chosen, and the one where an option asks for neurons that the first does not have."""
DESCENT = frozenset(
    (
        *("learning_rate", "schedule", "batch_size", "loss", "count_scale", "label_smoothing"),
        *("neighbour_smoothing", "class_order", "class_weights", "weight_average", "pruned"),
        *("event_dropout", "channel_dropout", "taxel_dropout", "event_noise", "mixing", "cut_end"),
        *("time_stretch", "time_shift", "taxel_shift", "target"),
    )
)
"""Options that have an effect, or help, only where weights descend along a gradient."""
OPTIONS_OF_WINDOWS = ("window_steps", "window_stride", "window_levels")
SHORT_STEPS, SHORT_THETA = 50, 2.0
"""In recordings of so few steps, potentials hardly reach the published threshold. On grasps of 24 steps, a threshold of
2 instead of 10 doubled the accuracy of ``hybrid``."""
UNEVEN_FROM = 2.0
"""Ratio of the commonest and the rarest class from which classes are made to count alike."""


class Reason(Frozen):
    """Options that were chosen together, by name, and why."""

    values: Mapping[str, Any]
    why: str

    @property
    def words(self) -> str:
        """The line that states them."""
        return f"{', '.join(f'{name} {value}' for name, value in self.values.items())}: {self.why}"


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
    counts = np.bincount(labels, minlength=max(classes or 0, len(recordings.class_names or ())))
    facts = _facts(recordings, len(counts))
    if config.defaults == "fixed" or not recordings.spikes.any():
        return Chosen(config, facts, ())
    given = frozenset(values)
    reasons: list[Reason] = []

    def settle(why: str, **options: Any) -> None:
        nonlocal config
        open_options = {name: value for name, value in options.items() if name not in given}
        if open_options:
            config = replace(config, **open_options)
            reasons.append(Reason(open_options, why))

    if "model" not in given:
        model, why = _model(config, given)
        config = config_from_mapping({**values, "model": model})
        reasons.append(Reason({"model": model}, why))
    structure = ARCHITECTURES[config.model]
    prototypes = (
        config.model == COUNTING
        and config.optimizer in ("sgd", "prototypes")
        and not given & (DESCENT | {"optimizer"})
        and bool(counts.all())
        and len(counts) > 1
    )
    if structure.window_branch and not given & set(OPTIONS_OF_WINDOWS):
        sensor = config.sensor
        polarities = POLARITIES if sensor is None else sensor.polarities
        choice = choose_windows(recordings.spikes, labels, polarities, config.seed, progress)
        if choice is None:
            steps = min(config.window_steps, recordings.spikes.shape[1])
            settle(
                "there are too few recordings to compare others",
                window_steps=steps,
                window_levels="1" if steps < 2 else config.window_levels,
            )
        else:
            settle(
                f"the best of {choice.candidates} in {choice.folds}-fold cross-validation on "
                f"{counted(choice.recordings, 'recording')}, accuracy {choice.accuracy:.3f}",
                window_steps=choice.windows.steps,
                window_stride=choice.windows.stride,
                window_levels=levels_text(choice.windows.levels),
            )
            if prototypes:
                settle("the smoothing of that cross-validation", weight_decay=choice.smoothing)
    if prototypes:
        settle(
            "its output is computed, so it does not depend on the number of updates",
            optimizer="prototypes",
            event_dropout=0.0,
            channel_dropout=0.0,
            epochs=1,
        )
        return Chosen(config, facts, tuple(reasons))
    if structure.neurons in ("srm", "lif"):
        _settle_spiking(config, recordings, settle)
    rarest = int(counts[counts > 0].min())
    if counts.max() >= UNEVEN_FROM * rarest and config.optimizer != "prototypes":
        settle(f"classes have {rarest} to {counts.max()} recordings", class_weights="balanced")
    return Chosen(config, facts, tuple(reasons))


def _settle_spiking(
    config: TrainingConfig, recordings: Recordings, settle: Callable[..., None]
) -> None:
    """Choose the learning rate, the threshold and the walk of neurons that spike."""
    structure = ARCHITECTURES[config.model]
    learned_from = len(recordings) * (1.0 - config.validation_fraction)
    updates = config.epochs * math.ceil(learned_from / config.batch_size)
    rate = float(f"{rate_for_updates(updates):.2g}")
    if config.optimizer in ("adamw", "rmsprop") and rate != config.learning_rate:
        settle(f"there are {updates} updates of the weights", learning_rate=rate)
    steps = recordings.spikes.shape[1]
    if structure.neurons == "srm" and steps < SHORT_STEPS:
        settle(f"recordings have {steps} steps", theta=SHORT_THETA)
    if "location" in structure.branches and config.grid is not None:
        settle("neighbours on the grid are near on this walk", order="hilbert")


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
    return f"{sizes}, {recordings.spikes.mean():.2g} events a channel and step"
