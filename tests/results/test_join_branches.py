"""A hybrid and networks of windows, trained apart and joined by ``join_branches.py``.

The joined network must add their log-probabilities, keep a hybrid's integers if it was trained on them, and its file must have
the training entries of all parts.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from locsnn_compile.training.config import config_from_mapping
from locsnn_compile.training.export import export_checkpoint, training_entry
from locsnn_compile.training.measure import class_scores
from locsnn_compile.training.train import train

STUDY = Path(__file__).parents[2] / "docs/research/results"


@pytest.mark.parametrize("scales", [(1.0,), (1.0, 5.0)], ids=["one network of windows", "two"])
def test_scores_of_the_joined_network_are_the_sum_of_log_probabilities(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, scales: tuple[float, ...]
) -> None:
    monkeypatch.syspath_prepend(str(STUDY))
    from join_branches import main

    recordings = synthetic_touches(12, steps=40, classes=3, seed=2)
    logits, files = [], []
    options = {"epochs": 3, "validation_fraction": 0.0, "refit": False, "initial_scale": 20.0}
    for model, scale in [("hybrid", 0.1), *(("window-snn", scale) for scale in scales)]:
        config = config_from_mapping({"model": model, "count_scale": scale} | options)
        result = train(recordings, config, name=model)
        training = training_entry(result, config, recordings, None)
        files.append(str(tmp_path / f"{model}-{scale}.pt"))
        Checkpoint(result.network.description, result.network.weights(), training=training).save(
            Path(files[-1])
        )
        logits.append(scale * class_scores(result.network, recordings.spikes))
    main([*files, "-o", str(tmp_path / "both.pt")])
    joined = read_checkpoint(tmp_path / "both.pt")
    assert (joined.description.name, joined.description.architecture) == ("both", "hybrid-window")
    assert (joined.training["hybrid_epochs"], joined.training["windows_optimizer"]) == (3, "sgd")
    assert joined.training.get("windows_2_count_scale") == (5.0 if len(scales) > 1 else None)
    network = build_network(joined.description)
    network.load_weights(joined.weights)
    hybrid, *windows = logits
    assert np.allclose(
        0.1 * class_scores(network, recordings.spikes), hybrid + np.mean(windows, axis=0), atol=1e-4
    )
    # Silent parts would add up to anything.
    assert all(float(np.abs(part).max()) > 0 for part in logits)


def test_a_hybrid_on_the_chips_integers_keeps_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(STUDY))
    from join_branches import main

    recordings = synthetic_touches(12, steps=40, classes=3, seed=2)
    parts = {}
    for model in ("hybrid", "window-snn"):
        options = {"target": "loihi-sim", "strategy": "reset"} if model == "hybrid" else {}
        config = config_from_mapping(
            {"model": model, "epochs": 3, "validation_fraction": 0.0, "refit": False} | options
        )
        result = train(recordings, config, name=model)
        parts[model] = tmp_path / f"{model}.pt"
        export_checkpoint(parts[model], result, config, recordings, None, carried=0)
    main([*map(str, parts.values()), "-o", str(tmp_path / "both.pt")])
    hybrid, windows, joined = map(read_checkpoint, (*parts.values(), tmp_path / "both.pt"))
    assert hybrid.chip is not None
    assert joined.chip is not None
    assert (joined.chip.target, joined.chip.strategy) == ("loihi-sim", "reset")
    for name, mantissas in hybrid.weights.items():
        assert np.array_equal(joined.weights[name], mantissas)
        assert joined.chip.populations[name].scale == hybrid.chip.populations[name].scale
    # A potential of the windows counts 1.0 (their `count_scale`) and a spike of the hybrid 0.1, so weights are ten times as large.
    expected = 10.0 * windows.weights["location_output"]
    unit = joined.chip.populations["window_output"].unit
    rounding_error = np.abs(joined.float_weights["window_output"] - expected).max()
    # Half a unit, and a little for float32; the unit itself is small against the largest weight.
    assert rounding_error <= 0.501 * unit
    assert 0.501 * unit < np.abs(expected).max() / 50

    # What the compiler plays is what torch computes: nothing is rounded a second time.
    compiled = lc.compile(joined, events=recordings)
    match = compiled.report["match"]
    assert (match["spike_agreement"], match["prediction_agreement"]) == (1.0, 1.0)
    assert match["score_error"] < 1e-9
    network = build_network(joined.description, chip=joined.chip)
    network.load_weights(joined.float_weights)
    assert np.array_equal(
        hw.simulate(compiled.program, recordings.spikes).prediction,
        class_scores(network, recordings.spikes).argmax(axis=1),
    )
