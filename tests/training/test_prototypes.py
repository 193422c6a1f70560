"""Windows by prototypes: the output is that of discriminant analysis, of all epochs' recordings, however a run was cut."""

from pathlib import Path

import numpy as np
import pytest
import torch

from hw_model.values import FloatArray
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.errors import InputError
from locsnn_compile.models.networks import WindowNetwork
from locsnn_compile.training.config import EpochRecord, TrainingConfig, config_from_mapping
from locsnn_compile.training.measure import class_scores
from locsnn_compile.training.train import train

SMOOTHING = 0.2


def config(**own: object) -> TrainingConfig:
    quiet = {
        "event_dropout": 0.0,
        "channel_dropout": 0.0,
        "validation_fraction": 0.0,
        "refit": False,
    }
    given = {
        "model": "window-snn",
        "optimizer": "prototypes",
        "weight_decay": SMOOTHING,
        "epochs": 1,
    }
    return config_from_mapping(given | quiet | own)


def touches(samples: int = 18, seed: int = 3) -> Recordings:
    return synthetic_touches(samples, steps=36, classes=3, seed=seed)


def analysis(h: FloatArray, labels: FloatArray, seen: FloatArray) -> FloatArray:
    """Scores of linear discriminant analysis as textbooks have it, with the whole matrix inverted."""
    means = np.stack([h[labels == label].mean(axis=0) for label in np.unique(labels)])
    apart = h - means[labels]
    ridge = SMOOTHING * (apart**2).sum() / len(h)
    s = np.linalg.inv(apart.T @ apart + ridge * np.eye(h.shape[1]))
    return seen @ s @ means.T - 0.5 * np.einsum("kh,hg,kg->k", means, s, means)


def test_scores_are_those_of_discriminant_analysis() -> None:
    made, others = touches(), touches(seed=4)
    assert made.labels is not None
    network = train(made, config(window_steps=18, window_stride=9, window_levels="1")).network
    assert isinstance(network, WindowNetwork)
    played = [
        torch.from_numpy(recordings.spikes.astype(np.float32)) for recordings in (made, others)
    ]
    hidden = [network.hidden(spikes).double().numpy() for spikes in played]
    scale = 1.0 / analysis(hidden[0], made.labels, hidden[0]).std(axis=1, ddof=1).mean()
    wanted = scale * analysis(hidden[0], made.labels, hidden[1])
    assert np.allclose(class_scores(network, others.spikes), wanted, atol=1e-3)


def test_recordings_that_were_not_learned_from_are_told_apart() -> None:
    others = touches(seed=5)
    network = train(touches(60), config(epochs=2, time_shift=1)).network
    assert (class_scores(network, others.spikes).argmax(axis=1) == others.labels).mean() >= 0.9


def test_every_epoch_adds_recordings() -> None:
    one, two, again = (
        train(touches(), config(epochs=n, time_shift=3)).network.weights() for n in (1, 2, 2)
    )
    assert not any(np.array_equal(one[name], two[name]) for name in one)
    assert all(np.array_equal(two[name], again[name]) for name in two)


def test_a_run_that_was_stopped_goes_on_with_the_recordings_of_epochs_before(
    tmp_path: Path,
) -> None:
    asked, state = config(epochs=3, time_shift=3), tmp_path / "state"

    def stop(done: int, expected: int, record: EpochRecord) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(touches(), asked, state_path=state, save_every=1, progress=stop)
    resumed = train(touches(), asked, state_path=state).network.weights()
    whole = train(touches(), asked).network.weights()
    assert all(np.array_equal(resumed[name], whole[name]) for name in whole)


def test_only_windows_have_prototypes() -> None:
    with pytest.raises(InputError) as refused:
        train(touches(), config(model="hybrid"))
    assert str(refused.value) == (
        "training option 'optimizer': only window networks have prototypes. Use another optimizer, or model window-snn."
    )


def test_a_label_without_recordings_has_no_prototype() -> None:
    made = touches()
    assert made.labels is not None
    with pytest.raises(InputError) as refused:
        train(made.subset(np.flatnonzero(made.labels != 1)), config())
    assert str(refused.value) == (
        "label 1: it has no recording to learn from, so it has no prototype. Use another optimizer, or number the labels "
        "without a gap."
    )


def test_a_single_class_has_no_prototype() -> None:
    made = touches()
    assert made.labels is not None
    with pytest.raises(InputError) as refused:
        train(made.subset(np.flatnonzero(made.labels == 0)), config())
    assert str(refused.value) == (
        "training option 'optimizer': prototypes tell classes apart, and there is one. Use another optimizer, or "
        "recordings of several classes."
    )
