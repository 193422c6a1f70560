"""The training loop.

A run has two phases. The first, ``select``, trains on a part of the training recordings, measures every epoch on the
rest (validation), and chooses an epoch. The second, ``refit``, trains afresh on all training recordings for as many
epochs. The test part is never used here. After every few epochs the state is written to a file, from which a killed run
can continue. Equal configuration, data, torch and machine give equal bits, also after such a continuation.
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
"""The key under which a parameter group of the optimizer has its factor of the learning rate."""
_PHASES = {"select": 1, "refit": 2}
"""The number of a phase, which goes into the seeds of its random draws."""


class TrainingResult(Frozen, eq=False):
    """A trained network, and how the run went.

    - ``chosen_epoch``: the epoch that validation chose; ``validation_accuracy``: in that epoch, None if no recordings
      were held out for validation
    - ``history``: the figures of all epochs of both phases
    - ``remarks``: sentences for the user about data and about what was not learned
    - ``learned``: whether predictions on the training recordings are better than chance
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
    - ``start``: a checkpoint to start from. Every phase begins with its weights, and the network has its description,
      which ``config`` must fit.
    - ``state_path``: the state is written there every ``save_every`` epochs, and an existing state is continued. The
      caller has to remove it.
    - ``log_path``: gets one CSV line per epoch; a picture is written next to it, as ``.svg``
    - ``progress``: called after every epoch; see :data:`.config.Progress`
    - ``notice``: called with a sentence after a few epochs, if nothing was learned in them

    Raises ``InputError`` for data without labels, or without any event.
    """
    labels = recordings.needed_labels(purpose="train on")
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
    state = _state_to_continue(state_path, key, build_network(description, chip=chip))

    def save_progress() -> None:
        """Write the state, the log and its picture, if there are files for them."""
        if state_path is not None:
            save_state(state_path, state, key)
        if log_path is not None:
            _write_log(log_path, state.history)
            picture = log_path.with_suffix(".svg")
            replace_file(
                picture, profile(state.history, name), f"training profile {picture.name!r}"
            )

    run = _Run(
        config=config,
        loss=loss,
        description=description,
        spikes=recordings.spikes,
        labels=labels,
        chip=chip,
        start=weights_at_start,
        save_progress=save_progress,
        save_every=save_every,
        progress=progress,
        tie_class=tie_class,
        notice=notice,
    )
    with _torch_for_small_layers():
        training, validation = stratified_split(labels, config.validation_fraction, config.seed)
        if state.phase == "select":
            _run_phase(run, state, training, validation, epochs_of(config))
            if config.refit and len(validation):
                # The second phase starts from the beginning, and keeps the history and the choice.
                state.phase = "refit"
                state.epoch = 0
                state.weights = {}
                state.averages = {}
                state.optimizer = {}
            save_progress()
        weights = state.chosen_weights
        if state.phase == "refit":
            all_rows = np.arange(len(labels))
            no_rows = validation[:0]
            _run_phase(run, state, all_rows, no_rows, state.chosen_epoch)
            save_progress()
            # Averages, if there are any, in place of the weights of the last step.
            weights = state.weights | state.averages
        network = build_network(description, seed=config.seed, chip=chip)
        network.load_state_dict(weights)
        network.tie_class = tie_class
        # The network that is measured from here on is exactly the one that the checkpoint stores.
        network.snap()
        reach = reach_of(config, len(training), config.epochs)
        remarks_on_result = result_remarks(network, recordings, advice(config, reach))
        remarks = (*data_remarks(recordings, classes, config), *remarks_on_result)
    (chosen_record,) = (
        record
        for record in state.history
        if record.phase == "select" and record.epoch == state.chosen_epoch
    )
    return TrainingResult(
        network=network,
        chosen_epoch=state.chosen_epoch,
        validation_accuracy=chosen_record.validation_accuracy,
        history=tuple(state.history),
        remarks=remarks,
        learned=not remarks_on_result,
    )


def _state_to_continue(path: Path | None, key: str, network: TouchModel) -> TrainingState:
    """Return the state in a file, or a new one if there is none.

    ``key`` identifies the run, and the file must have weights of the names and shapes that ``network`` has.
    """
    state = None
    if path is not None:
        state = load_state(path, key, network.state_dict())
    return TrainingState() if state is None else state


def _numbers(
    config: TrainingConfig, description: NetworkDescription, start: Start
) -> ChipNumbers | XyloNumbers | None:
    """Return the integers of a network that is trained for a chip; None for a network in floats."""
    check_network_of_target(config)
    if config.target == "float":
        return None
    if description.structure.neurons == "xylo":
        return xylo_numbers(config, description)
    return chip_numbers(config, description, start)


class _Run(Frozen, eq=False):
    """What both phases of a run have in common; parameters of :func:`train` have the same names."""

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
    save_progress: Callable[[], None]
    """Writes the state and the log, if there are files for them."""
    save_every: int
    progress: Progress | None
    tie_class: int | None
    """The class that is predicted if the scores of all classes are equal; None: no class."""
    notice: Notice | None


class _Phase:
    """One phase of a run: a network that learns from the recordings ``rows``, continuing from ``state``.

    ``kept`` is the network that is measured and saved: the network itself, or with ``weight_average`` a copy whose
    weights are the running average of its weights.
    """

    def __init__(self, run: _Run, state: TrainingState, rows: IntArray) -> None:
        config = run.config
        self.run = run
        self.number = _PHASES[state.phase]
        self.spikes = run.spikes[rows]
        self.labels = run.labels[rows]
        network = build_network(
            run.description, seed=config.seed, initial_scale=config.initial_scale, chip=run.chip
        )
        self.network = network.to(config.device)
        self.network.tie_class = run.tie_class
        if run.start is not None:
            self.network.load_weights(run.start)
        # After the weights of the start: pruning removes the smallest of these.
        if config.pruned:
            self.network.prune(config.pruned)
        self.network.hold()
        self.network.begin(self.spikes)
        self.optimizer = _optimizer(self.network, config)
        if state.weights:
            # The run was interrupted in this phase.
            self.network.load_state_dict(state.weights)
            self.optimizer.load_state_dict(state.optimizer)
        self.kept = deepcopy(self.network) if config.weight_average else self.network
        # Not strict, because there are no averages at the start of a phase, or without weight_average.
        self.kept.load_state_dict(state.averages, strict=False)
        self.class_shares = class_weights(config, self.labels, run.description.classes)

    def drawn(self, epoch: int) -> Iterator[tuple[Float32Array, IntArray]]:
        """Yield the batches of an epoch: (spikes, labels), as augmentation has drawn them."""
        config = self.run.config
        rng = epoch_generator(config.seed, self.number, epoch)
        polarities = self.run.description.input.sensor.polarities
        return batches(self.spikes, self.labels, config, rng, polarities)

    def learn(self, epoch: int, rate: float) -> float:
        """Learn for an epoch at a learning rate, and return the mean loss."""
        run = self.run
        network = self.network
        if run.config.optimizer == PROTOTYPES:
            return self.compute(epoch)
        for group in self.optimizer.param_groups:
            group["lr"] = rate * group.get(RATE_SHARE, 1.0)
        total = 0.0
        for batch_spikes, batch_labels in self.drawn(epoch):
            x = torch.from_numpy(batch_spikes).to(run.config.device)
            y = torch.from_numpy(batch_labels).to(run.config.device)
            loss = run.loss(network, network(x), y, self.class_shares)
            self.optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            self.optimizer.step()
            # Into the range of the chip's formats, and pruned weights back to 0.
            network.hold()
            if self.kept is not network:
                follow_weights(self.kept, network, run.config.weight_average)
            total += float(loss.detach()) * len(y)
        return total / len(self.labels)

    def compute(self, epoch: int) -> float:
        """Compute the output from prototypes of the copies of all epochs so far, and return the mean loss.

        A copy is a recording as augmentation has drawn it in one epoch.
        """
        run = self.run
        size = size_of(self.network, len(self.labels), run.config)
        if run.notice is not None and epoch == 1 and size.gibibytes >= STATED_FROM:
            run.notice(size.words)
        drawn = chain.from_iterable(map(self.drawn, range(1, epoch + 1)))
        set_prototypes(self.network, drawn, run.config.weight_decay)
        return evaluate(self.network, run.loss, self.spikes, self.labels)[0]


def _run_phase(
    run: _Run, state: TrainingState, rows: IntArray, validation_rows: IntArray, epochs: int
) -> None:
    """Train from the epoch of ``state`` up to ``epochs`` on the recordings ``rows``, and update ``state``.

    ``validation_rows`` are measured after every epoch; without any, there is no validation.
    """
    config = run.config
    phase = _Phase(run, state, rows)
    validates = len(validation_rows) > 0
    validation_spikes = run.spikes[validation_rows]
    validation_labels = run.labels[validation_rows]
    for epoch in range(state.epoch + 1, epochs + 1):
        rate = learning_rate(config, epoch, epochs)
        loss = phase.learn(epoch, rate)
        validation_loss = None
        validation_accuracy = None
        if validates:
            validation_loss, validation_accuracy = evaluate(
                phase.kept, run.loss, validation_spikes, validation_labels
            )
        record = EpochRecord(
            phase=state.phase,
            epoch=epoch,
            learning_rate=rate,
            loss=loss,
            validation_loss=validation_loss,
            validation_accuracy=validation_accuracy,
        )
        _update(state, phase, record, config, len(validation_rows))
        if run.progress is not None:
            done, expected = _progress_of(state.phase, epoch, epochs, config, validates=validates)
            run.progress(done, expected, record)
        if epoch % run.save_every == 0:
            run.save_progress()
        # Only if there are epochs left, in which the user could stop the run.
        is_time_to_look = state.phase == "select" and epoch == epoch_to_look_at(epochs) < epochs
        if run.notice is not None and is_time_to_look:
            remark = early_remark(config, phase.kept, phase.spikes, phase.labels, epoch)
            if remark is not None:
                run.notice(remark)


def _update(
    state: TrainingState,
    phase: _Phase,
    record: EpochRecord,
    config: TrainingConfig,
    validated: int,
) -> None:
    """Update ``state`` after the epoch of a ``record``; ``validated`` is the number of validation recordings."""
    weights_to_keep = _weights(phase.kept)
    state.weights = _weights(phase.network)
    state.averages = weights_to_keep if config.weight_average else {}
    state.optimizer = phase.optimizer.state_dict()
    state.epoch = record.epoch
    state.history.append(record)
    if state.phase == "select":
        # If the run ended now, would validation choose this epoch? Its weights are only here now.
        chosen_epoch = choose_epoch(state.history, config.smoothing_epochs, validated)
        if chosen_epoch == record.epoch:
            state.chosen_epoch = record.epoch
            state.chosen_weights = weights_to_keep


def _progress_of(
    phase: str, epoch: int, epochs: int, config: TrainingConfig, *, validates: bool
) -> tuple[int, int]:
    """Return (epochs done in all phases, epochs of all phases as far as known), after an epoch of a phase.

    During the first phase, the second is expected to take as many epochs; its number is only chosen at the end.
    """
    if phase == "refit":
        epochs_before = epochs_of(config)
        return epochs_before + epoch, epochs_before + epochs
    expects_refit = config.refit and validates
    return epoch, 2 * epochs if expects_refit else epochs


def epochs_of(config: TrainingConfig) -> int:
    """Return the number of epochs of the first phase.

    Prototypes take one epoch for each copy of the recordings that augmentation draws, and one in all without it.
    """
    return repeats(config) if config.optimizer == PROTOTYPES else config.epochs


def _weights(network: TouchModel) -> dict[str, Tensor]:
    """Return copies of the parameters and buffers of a network, by name."""
    return {name: value.detach().clone() for name, value in network.state_dict().items()}


def _optimizer(network: TouchModel, config: TrainingConfig) -> torch.optim.Optimizer:
    """Return the optimizer of a configuration; prototypes need none, and get one that is never called."""
    weights = _learning_together(network)
    rate = config.learning_rate
    decay = config.weight_decay
    if config.optimizer == "adamw":
        return torch.optim.AdamW(weights, lr=rate, weight_decay=decay, fused=True)
    if config.optimizer == "sgd":
        return torch.optim.SGD(weights, lr=rate, momentum=MOMENTUM, weight_decay=decay)
    return torch.optim.RMSprop(weights, lr=rate, weight_decay=decay, foreach=True)


def _learning_together(network: TouchModel) -> list[dict[str, Any]]:
    """Return the weights as parameter groups of an optimizer, one for each factor of the learning rate."""
    shares = network.rate_shares()
    weights_of_share: dict[float, list[nn.Parameter]] = {}
    for name, weight in network.named_parameters():
        weights_of_share.setdefault(shares.get(name, 1.0), []).append(weight)
    return [{"params": weights, RATE_SHARE: share} for share, weights in weights_of_share.items()]


@contextmanager
def _torch_for_small_layers() -> Iterator[None]:
    """Set up torch for training small layers, and restore its threads afterwards.

    One thread is fastest for them, and a fixed number of threads keeps sums in a fixed order. Floats below 1e-38 are
    taken as 0: gradients that fade over hundreds of steps become as small, and processors take many times longer for
    such numbers.
    """
    threads_before = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_num_threads(threads_before)
        torch.set_flush_denormal(False)


def _write_log(path: Path, history: list[EpochRecord]) -> None:
    """Write the figures of all epochs as CSV, a line for each."""
    rows = []
    for record in history:
        row = asdict(record)
        for name, value in row.items():
            if isinstance(value, float):
                row[name] = f"{value:.6g}"
        rows.append(row)
    replace_file(path, csv_bytes(rows), f"training log {path.name!r}")
