"""The training loop: choose the epoch on a validation part of the train part, then train on all of it.

The test part is never used here. Equal configuration, data, torch and machine give equal bits, also after a resume.
"""

import csv
import io
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import astuple, replace
from itertools import chain
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hw_model.io.files import replace_file
from hw_model.values import Frozen, IntArray
from locsnn_compile.data.division import stratified_split
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.chip_entry import ChipNumbers
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.networks import build_network
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training.batches import batches, epoch_generator
from locsnn_compile.training.config import EpochRecord, Progress, TrainingConfig
from locsnn_compile.training.describe import check_recordings, describe
from locsnn_compile.training.measure import Loss, check_events, class_weights, data_remarks, evaluate, result_remarks
from locsnn_compile.training.profile import profile
from locsnn_compile.training.prototypes import PROTOTYPES, set_prototypes
from locsnn_compile.training.schedule import WeightAverage, choose_epoch, learning_rate
from locsnn_compile.training.state import TrainingState, load_state, run_key, save_state
from locsnn_compile.training.target import chip_numbers

MOMENTUM = 0.9
"""Momentum of the optimizer sgd."""
_PHASES = {"select": 1, "refit": 2}


class TrainingResult(Frozen, eq=False):
    """A trained network.

    ``validation_accuracy`` is that of the chosen epoch, None if nothing was held out. ``remarks`` are sentences about
    what was not learned.
    """

    network: TouchModel
    chosen_epoch: int
    validation_accuracy: float | None
    history: tuple[EpochRecord, ...]
    remarks: tuple[str, ...] = ()


def train(
    recordings: Recordings,
    config: TrainingConfig,
    *,
    name: str = "model",
    classes: int | None = None,
    start: Checkpoint | None = None,
    state_path: Path | None = None,
    log_path: Path | None = None,
    save_every: int = 10,
    progress: Progress | None = None,
) -> TrainingResult:
    """Train on the train part ``recordings`` and return the network, in float32.

    - ``classes``: the number of classes, if it is more than the labels show
    - ``start``: a checkpoint. Every phase begins with its weights, and the network has its description, which
      ``config`` must fit.
    - ``state_path``: the state is written there every ``save_every`` epochs, and an existing state is continued. The
      caller has to remove it.
    - ``log_path`` gets one CSV line per epoch; a picture is written next to it, as ``.svg``.

    Raises ``InputError`` for data without labels, or without any event.
    """
    labels = recordings.labels
    if labels is None:
        fix = "Give labelled recordings."
        raise InputError(f"recordings {recordings.source!r}", "they have no labels to train on", fix=fix)
    if config.device == "cuda" and not torch.cuda.is_available():
        fix = "Take cpu, or install torch with CUDA on a machine that has one."
        raise InputError("training option 'device'", "torch sees no CUDA device here", fix=fix)
    classes = max(classes or 0, int(labels.max()) + 1, len(recordings.class_names or ()))
    if start is None:
        description = describe(recordings, config, classes, name)
    else:
        description = replace(start.description, name=name)
        check_recordings(description, recordings, classes)
    check_events(recordings)
    loss = Loss(config, description.classes)
    key = run_key(config, recordings, start)
    weights_at_start = None if start is None else start.float_weights
    chip = None if config.target == "float" else chip_numbers(config, description, weights_at_start)
    usual = build_network(description, chip=chip).state_dict()
    state = (load_state(state_path, key, usual) if state_path is not None else None) or TrainingState()

    def saved() -> None:
        if state_path is not None:
            save_state(state_path, state, key)
        if log_path is not None:
            _write_log(log_path, state.history)
            picture = log_path.with_suffix(".svg")
            replace_file(picture, profile(state.history, name), f"training profile {picture.name!r}")

    run = _Run(config, loss, description, recordings, chip, weights_at_start, saved, save_every, progress)
    with _one_thread():
        training, held = stratified_split(labels, config.validation_fraction, config.seed)
        if state.phase == "select":
            _run_phase(run, state, training, held, config.epochs)
            if config.refit and len(held):
                state.phase, state.epoch, state.weights, state.averages, state.optimizer = "refit", 0, {}, {}, {}
            saved()
        weights = state.chosen_weights
        if state.phase == "refit":
            _run_phase(run, state, np.arange(len(labels)), held[:0], state.chosen_epoch)
            saved()
            weights = state.weights | state.averages
        network = build_network(description, seed=config.seed, chip=chip)
        network.load_state_dict(weights)
        network.snap()
        remarks = (*data_remarks(recordings, classes, config), *result_remarks(network, recordings))
    chosen = [row for row in state.history if row.phase == "select" and row.epoch == state.chosen_epoch]
    return TrainingResult(network, state.chosen_epoch, chosen[0].validation_accuracy, tuple(state.history), remarks)


class _Run(Frozen, eq=False):
    """What both phases of a run have in common."""

    config: TrainingConfig
    loss: Loss
    description: NetworkDescription
    recordings: Recordings
    chip: ChipNumbers | None
    start: Mapping[str, NDArray[np.float32]] | None
    saved: Callable[[], None]
    save_every: int
    progress: Progress | None

    def network(self) -> TouchModel:
        """Return the network with which a phase begins."""
        config = self.config
        network = build_network(self.description, seed=config.seed, initial_scale=config.initial_scale, chip=self.chip)
        network = network.to(config.device)
        if self.start is not None:
            network.load_weights(self.start)
        if config.pruned:
            network.prune(config.pruned)
        network.hold()
        return network


def _run_phase(run: _Run, state: TrainingState, rows: IntArray, held: IntArray, epochs: int) -> None:
    """Take ``state`` from where it is to ``epochs`` on the recordings ``rows``, validating on ``held``."""
    config, recordings = run.config, run.recordings
    assert recordings.labels is not None
    spikes, labels = recordings.spikes[rows], recordings.labels[rows]
    network = run.network()
    network.begin(spikes)
    optimizer = _optimizer(network, config)
    weights = list(network.parameters())
    if state.weights:
        network.load_state_dict(state.weights)
        optimizer.load_state_dict(state.optimizer)
    class_shares = class_weights(config, labels, run.description.classes)
    average = WeightAverage(network, config.weight_average, state.averages)

    def drawn(epoch: int) -> Iterator[tuple[NDArray[np.float32], IntArray]]:
        rng = epoch_generator(config.seed, _PHASES[state.phase], epoch)
        return batches(spikes, labels, config, rng, run.description.input.sensor.polarities)

    for epoch in range(state.epoch + 1, epochs + 1):
        rate = learning_rate(config, epoch, epochs)
        for group in optimizer.param_groups:
            group["lr"] = rate
        total = 0.0
        if config.optimizer == PROTOTYPES:
            set_prototypes(network, chain.from_iterable(map(drawn, range(1, epoch + 1))), config.weight_decay)
            total = len(rows) * evaluate(network, run.loss, spikes, labels)[0]
        for x, y in () if config.optimizer == PROTOTYPES else drawn(epoch):
            placed, of_them = (torch.from_numpy(values).to(config.device) for values in (x, y))
            loss = run.loss(network, network(placed), of_them, class_shares)
            for weight in weights:  # like zero_grad, without its overhead
                weight.grad = None
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            network.hold()
            average.update()
            total += float(loss.detach()) * len(y)
        state.weights = _weights(network)
        with average.in_place():
            validation = recordings.spikes[held], recordings.labels[held]
            figures = evaluate(network, run.loss, *validation) if len(held) else (None, None)
            found = _weights(network)
        record = EpochRecord(state.phase, epoch, rate, total / len(rows), *figures)
        state.history.append(record)
        state.epoch, state.averages, state.optimizer = epoch, average.values, optimizer.state_dict()
        chosen = state.phase == "select" and choose_epoch(state.history, config.smoothing_epochs, len(held)) == epoch
        if chosen:
            state.chosen_epoch, state.chosen_weights = epoch, found
        if run.progress is not None:
            others = config.epochs if state.phase == "refit" else 0
            expected = others + epochs + (epochs if state.phase == "select" and config.refit and len(held) else 0)
            run.progress(others + epoch, expected, record)
        if epoch % run.save_every == 0:
            run.saved()


def _weights(network: TouchModel) -> dict[str, Tensor]:
    return {name: value.detach().clone() for name, value in network.state_dict().items()}


def _optimizer(network: TouchModel, config: TrainingConfig) -> torch.optim.Optimizer:
    weights, rate, decay = network.parameters(), config.learning_rate, config.weight_decay
    if config.optimizer == "adamw":
        return torch.optim.AdamW(weights, lr=rate, weight_decay=decay, fused=True)
    if config.optimizer == "sgd":
        return torch.optim.SGD(weights, lr=rate, momentum=MOMENTUM, weight_decay=decay)
    return torch.optim.RMSprop(weights, lr=rate, weight_decay=decay, foreach=True)


@contextmanager
def _one_thread() -> Iterator[None]:
    # The layers are small: one thread is fastest, and a fixed number keeps sums in a fixed order.
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _write_log(path: Path, history: list[EpochRecord]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["phase", "epoch", "learning_rate", "loss", "validation_loss", "validation_accuracy"])
    for phase, epoch, *figures in map(astuple, history):
        writer.writerow([phase, epoch, *("" if value is None else f"{value:.6g}" for value in figures)])
    replace_file(path, text.getvalue().encode(), f"training log {path.name!r}")
