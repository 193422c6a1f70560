"""The training loop: choose the epoch on a validation part of the train part, then train on all of it.

The test part is never used here. Equal configuration, data, torch and machine give equal bits, also after a resume.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import asdict, replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from hw_model.io.files import replace_file
from hw_model.values import ByteArray, Float32Array, Frozen, IntArray
from locsnn_compile.data.read import stratified_split
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.chip_entry import ChipNumbers
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.networks import build_network
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.models.xylo_entry import XyloNumbers
from locsnn_compile.report.figures.flat import csv_bytes
from locsnn_compile.training.batches import batches, epoch_generator
from locsnn_compile.training.config import (
    EpochRecord,
    Progress,
    TrainingConfig,
    check_network_of_target,
)
from locsnn_compile.training.describe import check_recordings, class_for_ties, describe
from locsnn_compile.training.learning_signs import (
    Notice,
    advice,
    early_remark,
    epoch_to_look_at,
    reach_of,
)
from locsnn_compile.training.measure import (
    Loss,
    check_events,
    class_weights,
    data_remarks,
    evaluate,
    result_remarks,
)
from locsnn_compile.training.profile import profile
from locsnn_compile.training.prototypes import (
    PROTOTYPES,
    STATED_FROM,
    repeats,
    set_prototypes,
    size_of,
)
from locsnn_compile.training.schedule import choose_epoch, follow_weights, learning_rate
from locsnn_compile.training.state import TrainingState, load_state, run_key, save_state
from locsnn_compile.training.target import Start, chip_numbers
from locsnn_compile.training.xylo_target import xylo_numbers

MOMENTUM = 0.9
"""Momentum of the optimizer sgd."""
RATE_SHARE = "rate_share"
"""Where a group of the optimizer keeps its share of the learning rate."""
_PHASES = {"select": 1, "refit": 2}


class TrainingResult(Frozen, eq=False):
    """A trained network.

    ``validation_accuracy`` is that of the chosen epoch, None if nothing was held out. ``remarks`` are sentences about
    what was not learned. ``learned``: whether the outputs tell the recordings of the train part apart at all.
    """

    network: TouchModel
    chosen_epoch: int
    validation_accuracy: float | None
    history: tuple[EpochRecord, ...]
    remarks: tuple[str, ...] = ()
    learned: bool = True


def train(  # noqa: PLR0913 - public: each is an option of its own
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
    notice: Notice | None = None,
) -> TrainingResult:
    """Train on the train part ``recordings`` and return the network, in float32.

    - ``classes``: the number of classes, if it is more than the labels show
    - ``start``: a checkpoint. Every phase begins with its weights, and the network has its description, which
      ``config`` must fit.
    - ``state_path``: the state is written there every ``save_every`` epochs, and an existing state is continued. The
      caller has to remove it.
    - ``notice`` is called with a sentence after a few epochs, if nothing was learned in them
    - ``log_path`` gets one CSV line per epoch; a picture is written next to it, as ``.svg``.

    Raises ``InputError`` for data without labels, or without any event.
    """
    labels = recordings.needed_labels("train on")
    if config.device == "cuda" and not torch.cuda.is_available():
        fix = "Use cpu, or install torch with CUDA on a machine that has one."
        raise InputError("training option 'device'", "torch sees no CUDA device here", fix=fix)
    classes = max(classes or 0, int(labels.max()) + 1, len(recordings.class_names or ()))
    if start is None:
        description = describe(recordings, config, classes, name)
    else:
        description = replace(start.description, name=name)
        check_recordings(description, recordings, classes)
    check_events(recordings)
    tie_class = class_for_ties(config, description, start)
    loss = Loss(config, description.classes)
    key = run_key(config, recordings, start)
    weights_at_start = None if start is None else start.float_weights
    chip = _numbers(config, description, weights_at_start)
    usual = build_network(description, chip=chip).state_dict()
    state = (
        load_state(state_path, key, usual) if state_path is not None else None
    ) or TrainingState()

    def saved() -> None:
        if state_path is not None:
            save_state(state_path, state, key)
        if log_path is not None:
            _write_log(log_path, state.history)
            picture = log_path.with_suffix(".svg")
            replace_file(
                picture, profile(state.history, name), f"training profile {picture.name!r}"
            )

    spikes = recordings.spikes
    run = _Run(
        config,
        loss,
        description,
        spikes,
        labels,
        chip,
        weights_at_start,
        saved,
        save_every,
        progress,
        tie_class,
        notice,
    )
    with _torch_for_small_layers():
        training, held = stratified_split(labels, config.validation_fraction, config.seed)
        if state.phase == "select":
            _run_phase(run, state, training, held, epochs_of(config))
            if config.refit and len(held):
                state.phase, state.epoch, state.weights, state.averages, state.optimizer = (
                    "refit",
                    0,
                    {},
                    {},
                    {},
                )
            saved()
        weights = state.chosen_weights
        if state.phase == "refit":
            _run_phase(run, state, np.arange(len(labels)), held[:0], state.chosen_epoch)
            saved()
            weights = state.weights | state.averages
        network = build_network(description, seed=config.seed, chip=chip)
        network.load_state_dict(weights)
        network.tie_class = tie_class
        network.snap()
        reach = reach_of(config, len(training), config.epochs)
        unlearned = result_remarks(network, recordings, advice(config, reach))
        remarks = (*data_remarks(recordings, classes, config), *unlearned)
    chosen = [
        row for row in state.history if row.phase == "select" and row.epoch == state.chosen_epoch
    ]
    return TrainingResult(
        network,
        state.chosen_epoch,
        chosen[0].validation_accuracy,
        tuple(state.history),
        remarks,
        learned=not unlearned,
    )


def _numbers(
    config: TrainingConfig, description: NetworkDescription, start: Start
) -> ChipNumbers | XyloNumbers | None:
    """Return the integers of the target; None for a network in float."""
    check_network_of_target(config)
    if config.target == "float":
        return None
    if description.structure.neurons == "xylo":
        return xylo_numbers(config, description)
    return chip_numbers(config, description, start)


class _Run(Frozen, eq=False):
    """What both phases of a run have in common."""

    config: TrainingConfig
    loss: Loss
    description: NetworkDescription
    spikes: ByteArray
    """Of the train part, (samples, steps, channels)."""
    labels: IntArray
    """Of the train part, (samples,)."""
    chip: ChipNumbers | XyloNumbers | None
    start: Mapping[str, Float32Array] | None
    """Weights [out, in] by name that every phase begins with; None: those of the seed."""
    saved: Callable[[], None]
    save_every: int
    progress: Progress | None
    tie_class: int | None
    """What is predicted where all classes tie; None: no class."""
    notice: Notice | None


class _Phase:
    """One phase of a run: a network that learns from the recordings ``rows``, from where ``state`` is.

    ``kept`` is the network itself, or the one whose weights are a running average of its weights.
    """

    def __init__(self, run: _Run, state: TrainingState, rows: IntArray) -> None:
        config = run.config
        self.run, self.number = run, _PHASES[state.phase]
        self.spikes, self.labels = run.spikes[rows], run.labels[rows]
        network = build_network(
            run.description, seed=config.seed, initial_scale=config.initial_scale, chip=run.chip
        )
        self.network = network.to(config.device)
        self.network.tie_class = run.tie_class
        if run.start is not None:
            self.network.load_weights(run.start)
        if config.pruned:
            self.network.prune(config.pruned)
        self.network.hold()
        self.network.begin(self.spikes)
        self.optimizer = _optimizer(self.network, config)
        if state.weights:
            self.network.load_state_dict(state.weights)
            self.optimizer.load_state_dict(state.optimizer)
        self.kept = deepcopy(self.network) if config.weight_average else self.network
        self.kept.load_state_dict(state.averages, strict=False)
        self.class_shares = class_weights(config, self.labels, run.description.classes)

    def drawn(self, epoch: int) -> Iterator[tuple[Float32Array, IntArray]]:
        """Yield the batches of an epoch."""
        config, sensor = self.run.config, self.run.description.input.sensor
        rng = epoch_generator(config.seed, self.number, epoch)
        return batches(self.spikes, self.labels, config, rng, sensor.polarities)

    def learn(self, epoch: int, rate: float) -> float:
        """Learn for an epoch at a learning rate, and return the mean loss."""
        run, network = self.run, self.network
        if run.config.optimizer == PROTOTYPES:
            return self.compute(epoch)
        for group in self.optimizer.param_groups:
            group["lr"] = rate * group.get(RATE_SHARE, 1.0)
        total = 0.0
        for x, y in self.drawn(epoch):
            placed, of_them = (torch.from_numpy(values).to(run.config.device) for values in (x, y))
            loss = run.loss(network, network(placed), of_them, self.class_shares)
            self.optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            network.hold()
            if self.kept is not network:
                follow_weights(self.kept, network, run.config.weight_average)
            total += float(loss.detach()) * len(y)
        return total / len(self.labels)

    def compute(self, epoch: int) -> float:
        """Compute prototypes of the copies of all epochs so far, and return the mean loss."""
        run = self.run
        size = size_of(self.network, len(self.labels), run.config)
        if run.notice is not None and epoch == 1 and size.gibibytes >= STATED_FROM:
            run.notice(size.words)
        drawn = chain.from_iterable(map(self.drawn, range(1, epoch + 1)))
        set_prototypes(self.network, drawn, run.config.weight_decay)
        return evaluate(self.network, run.loss, self.spikes, self.labels)[0]


def _run_phase(
    run: _Run, state: TrainingState, rows: IntArray, held: IntArray, epochs: int
) -> None:
    """Take ``state`` from where it is to ``epochs`` on the recordings ``rows``, validating on ``held``."""
    config, phase, validation = (
        run.config,
        _Phase(run, state, rows),
        (run.spikes[held], run.labels[held]),
    )
    for epoch in range(state.epoch + 1, epochs + 1):
        rate = learning_rate(config, epoch, epochs)
        loss = phase.learn(epoch, rate)
        state.weights = _weights(phase.network)
        figures = evaluate(phase.kept, run.loss, *validation) if len(held) else (None, None)
        found = _weights(phase.kept)
        record = EpochRecord(state.phase, epoch, rate, loss, *figures)
        state.history.append(record)
        state.averages = found if config.weight_average else {}
        state.epoch, state.optimizer = epoch, phase.optimizer.state_dict()
        if (
            state.phase == "select"
            and choose_epoch(state.history, config.smoothing_epochs, len(held)) == epoch
        ):
            state.chosen_epoch, state.chosen_weights = epoch, found
        if run.progress is not None:
            others = epochs_of(config) if state.phase == "refit" else 0
            expected = (
                others
                + epochs
                + (epochs if state.phase == "select" and config.refit and len(held) else 0)
            )
            run.progress(others + epoch, expected, record)
        if epoch % run.save_every == 0:
            run.saved()
        if (
            run.notice is not None
            and state.phase == "select"
            and epoch == epoch_to_look_at(epochs) < epochs
        ):
            remark = early_remark(config, phase.kept, phase.spikes, phase.labels, epoch)
            if remark is not None:
                run.notice(remark)


def epochs_of(config: TrainingConfig) -> int:
    """Return the epochs of the first phase: prototypes are computed once per copy, and equal copies once in all."""
    return repeats(config) if config.optimizer == PROTOTYPES else config.epochs


def _weights(network: TouchModel) -> dict[str, Tensor]:
    return {name: value.detach().clone() for name, value in network.state_dict().items()}


def _optimizer(network: TouchModel, config: TrainingConfig) -> torch.optim.Optimizer:
    weights = _learning_together(network)
    rate = config.learning_rate
    decay = config.weight_decay
    if config.optimizer == "adamw":
        return torch.optim.AdamW(weights, lr=rate, weight_decay=decay, fused=True)
    if config.optimizer == "sgd":
        return torch.optim.SGD(weights, lr=rate, momentum=MOMENTUM, weight_decay=decay)
    return torch.optim.RMSprop(weights, lr=rate, weight_decay=decay, foreach=True)


def _learning_together(network: TouchModel) -> list[dict[str, Any]]:
    """Return the weights that learn at the same share of the rate, share by share."""
    shares = network.rate_shares()
    weights_of_share: dict[float, list[nn.Parameter]] = {}
    for name, weight in network.named_parameters():
        weights_of_share.setdefault(shares.get(name, 1.0), []).append(weight)
    return [{"params": own, RATE_SHARE: share} for share, own in weights_of_share.items()]


@contextmanager
def _torch_for_small_layers() -> Iterator[None]:
    # One thread is fastest for them, and a fixed number keeps sums in a fixed order. Floats below 1e-38 are taken as 0:
    # gradients that fade over hundreds of steps get there, and processors take many times longer for such numbers.
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_num_threads(before)
        torch.set_flush_denormal(False)


def _write_log(path: Path, history: list[EpochRecord]) -> None:
    rows = [
        {k: f"{v:.6g}" if isinstance(v, float) else v for k, v in asdict(record).items()}
        for record in history
    ]
    replace_file(path, csv_bytes(rows), f"training log {path.name!r}")
