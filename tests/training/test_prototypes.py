"""The optimizer ``prototypes``, which computes the output of a window network, against linear discriminant analysis.

The recordings of all epochs must count, also after an interruption; too much memory, other networks, and labels without
recordings are refused.
"""

from pathlib import Path

import numpy as np
import pytest
import torch

from hw_model.values import FloatArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.models.networks import WindowNetwork, build_network
from locsnn_compile.training.config import EpochRecord, TrainingConfig, config_from_mapping
from locsnn_compile.training.describe import describe
from locsnn_compile.training.measure import class_scores
from locsnn_compile.training.prototypes import Size, size_of
from locsnn_compile.training.train import train

SMOOTHING = 0.2
"""The share of the mean squared distance to prototypes that is added to the diagonal. The option for it is
``weight_decay``, as other optimizers shrink weights by that option. Chosen by hand."""
OUTPUT = "location_output"
"""The name of the output weights of a window network, (classes, hidden)."""


def config(**changed_options: object) -> TrainingConfig:
    """One epoch without augmentation or validation, with some options changed."""
    options = {
        "model": "window-snn",
        "optimizer": "prototypes",
        "weight_decay": SMOOTHING,
        "epochs": 1,
        "event_dropout": 0.0,
        "channel_dropout": 0.0,
        "validation_fraction": 0.0,
        "refit": False,
    }
    return config_from_mapping(options | changed_options)


def touches(samples: int = 18, seed: int = 3) -> Recordings:
    """Synthetic recordings of three classes."""
    return synthetic_touches(samples, steps=36, classes=3, seed=seed)


def analysis(training: FloatArray, labels: FloatArray, test: FloatArray) -> FloatArray:
    """Return the scores of test recordings by textbook linear discriminant analysis, with the whole matrix inverted."""
    means = np.stack([training[labels == label].mean(axis=0) for label in np.unique(labels)])
    distances = training - means[labels]
    ridge = SMOOTHING * (distances**2).sum() / len(training)
    s = np.linalg.inv(distances.T @ distances + ridge * np.eye(training.shape[1]))
    # The score of class k is m_k S h - m_k S m_k / 2, for its mean m_k and hidden spikes h.
    return test @ s @ means.T - 0.5 * np.einsum("kh,hg,kg->k", means, s, means)


@pytest.mark.parametrize(
    ("samples", "window_steps"),
    [
        pytest.param(18, 18, id="solved by recordings"),
        pytest.param(90, 36, id="solved by hidden neurons"),
    ],
)
def test_scores_are_those_of_discriminant_analysis(samples: int, window_steps: int) -> None:
    training, test = touches(samples), touches(seed=4)
    assert training.labels is not None
    windows = {"window_steps": window_steps, "window_stride": 9, "window_levels": "1"}
    network = train(training, config(**windows)).network
    # The system has a row per hidden neuron or per recording, whichever are fewer: each case is solved in its own way.
    hidden_neurons = network.weights()[OUTPUT].shape[1]
    has_more_recordings = samples == 90
    assert (hidden_neurons < samples) == has_more_recordings
    assert isinstance(network, WindowNetwork)

    def hidden(recordings: Recordings) -> FloatArray:
        return (
            network.hidden(torch.from_numpy(recordings.spikes.astype(np.float32))).double().numpy()
        )

    # Scores are scaled so that their standard deviation over the classes of a training recording is 1 on average.
    training_scores = analysis(hidden(training), training.labels, hidden(training))
    scale = 1.0 / training_scores.std(axis=1, ddof=1).mean()
    expected = scale * analysis(hidden(training), training.labels, hidden(test))
    assert np.allclose(class_scores(network, test.spikes), expected, atol=1e-3)


def test_recordings_that_were_not_learned_from_are_told_apart() -> None:
    test = touches(seed=5)
    network = train(touches(60), config(epochs=2, time_shift=1)).network
    # Synthetic classes are easy to tell apart. Chance is 1/3.
    assert (class_scores(network, test.spikes).argmax(axis=1) == test.labels).mean() >= 0.9


def test_without_augmentation_one_epoch_is_enough() -> None:
    result = train(touches(), config(epochs=5))
    assert [row.epoch for row in result.history] == [1]


@pytest.mark.parametrize(
    ("size", "words"),
    # The spikes are in memory twice with 4 bytes per number, the system that is solved twice with 8 bytes. A copy is a
    # recording as augmentation changed it in one epoch.
    [
        # 2 * 4 bytes * 2,700 * 5,000 and 2 * 8 bytes * 2,700^2 are 0.10 + 0.11 GiB.
        pytest.param(
            Size(copies=2_700, hidden=5_000),
            "Prototypes of 2,700 copies of recordings and 5,000 hidden neurons are solved by recordings, and "
            "take about 0.2 GiB.",
            id="by recordings",
        ),
        # Forty copies: 2 * 4 * 108,000 * 5,000 and 2 * 8 * 5,000^2 are 4.02 + 0.37 GiB.
        pytest.param(
            Size(copies=108_000, hidden=5_000),
            "Prototypes of 108,000 copies of recordings and 5,000 hidden neurons are solved by hidden neurons, "
            "and take about 4.4 GiB.",
            id="by hidden neurons",
        ),
    ],
)
def test_a_run_states_the_memory_that_it_takes(size: Size, words: str) -> None:
    assert size.words == words


def test_prototypes_that_take_too_much_memory_are_refused() -> None:
    network = build_network(describe(touches(), config(), 3))
    hidden = network.weights()[OUTPUT].shape[1]
    # Spikes alone take 2 * 4 bytes per recording and hidden neuron. 16 GiB (2^34 bytes) are allowed, of which the spikes
    # of so many recordings take all; twice as many are surely too many.
    recordings_in_16_gib = round(2**34 / (8 * hidden))
    too_many = 2 * recordings_in_16_gib
    with pytest.raises(InputError) as refused:
        size_of(network, too_many, config())
    gibibytes = Size(too_many, hidden).gibibytes
    assert str(refused.value) == (
        f"training option 'optimizer': prototypes take too much memory ({gibibytes:.1f} GiB against 16.0). Give "
        "fewer --epochs, longer windows (window_steps, window_stride), or optimizer sgd."
    )


def test_with_augmentation_every_epoch_adds_copies_of_the_recordings() -> None:
    one_epoch, two_epochs, two_again = (
        train(touches(), config(epochs=n, time_shift=3)).network.weights() for n in (1, 2, 2)
    )
    assert not any(np.array_equal(one_epoch[name], two_epochs[name]) for name in one_epoch)
    assert all(np.array_equal(two_epochs[name], two_again[name]) for name in two_epochs)


def test_a_stopped_run_continues_with_the_copies_of_all_epochs(
    tmp_path: Path,
) -> None:
    options, state = config(epochs=3, time_shift=3), tmp_path / "state"

    def stop(done: int, expected: int, record: EpochRecord) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(touches(), options, state_path=state, save_every=1, progress=stop)
    resumed = train(touches(), options, state_path=state).network.weights()
    uninterrupted = train(touches(), options).network.weights()
    assert all(np.array_equal(resumed[name], uninterrupted[name]) for name in uninterrupted)


def test_networks_without_windows_have_no_prototypes() -> None:
    with pytest.raises(InputError) as refused:
        train(touches(), config(model="hybrid"))
    assert str(refused.value) == (
        "training option 'optimizer': only window networks have prototypes. Use another optimizer, or model window-snn."
    )


def test_a_label_without_recordings_has_no_prototype() -> None:
    recordings = touches()
    assert recordings.labels is not None
    with pytest.raises(InputError) as refused:
        train(recordings.subset(np.flatnonzero(recordings.labels != 1)), config())
    assert str(refused.value) == (
        "label 1: it has no recording to learn from, so it has no prototype. Use another optimizer, or number the labels "
        "without a gap."
    )


def test_a_single_class_has_no_prototype() -> None:
    recordings = touches()
    assert recordings.labels is not None
    with pytest.raises(InputError) as refused:
        train(recordings.subset(np.flatnonzero(recordings.labels == 0)), config())
    assert str(refused.value) == (
        "training option 'optimizer': prototypes tell classes apart, and there is one. Use another optimizer, or "
        "recordings of several classes."
    )
