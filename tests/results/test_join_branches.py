"""A hybrid and windows, trained apart: the joined network adds their log-probabilities, and its file says how it came about."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from locsnn_compile.training.config import config_from_mapping
from locsnn_compile.training.export import training_entry
from locsnn_compile.training.measure import class_scores
from locsnn_compile.training.train import train


@pytest.mark.parametrize("scales", [(1.0,), (1.0, 5.0)], ids=["one network of windows", "two"])
def test_the_sum_is_that_of_log_probabilities(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scales: tuple[float, ...]
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    from join_branches import main

    made = synthetic_touches(12, steps=40, classes=3, seed=2)
    logits, files = [], []
    options = {"epochs": 3, "validation_fraction": 0.0, "refit": False, "initial_scale": 20.0}
    for model, scale in [("hybrid", 0.1), *(("window-snn", scale) for scale in scales)]:
        config = config_from_mapping({"model": model, "count_scale": scale} | options)
        result = train(made, config, name=model)
        entry = training_entry(result, config, made, None)
        files.append(str(tmp_path / f"{model}-{scale}.pt"))
        Checkpoint(result.network.description, result.network.weights(), training=entry).save(Path(files[-1]))
        logits.append(scale * class_scores(result.network, made.spikes))
    main([*files, "-o", str(tmp_path / "both.pt")])
    found = read_checkpoint(tmp_path / "both.pt")
    assert (found.description.name, found.description.architecture) == ("both", "hybrid-window")
    assert (found.training["hybrid_epochs"], found.training["windows_optimizer"]) == (3, "sgd")
    assert found.training.get("windows_2_count_scale") == (5.0 if len(scales) > 1 else None)
    network = build_network(found.description)
    network.load_weights(found.weights)
    hybrid, *windows = logits
    assert np.allclose(0.1 * class_scores(network, made.spikes), hybrid + np.mean(windows, axis=0), atol=1e-4)
    assert all(float(np.abs(part).max()) > 0 for part in logits)
