"""The shipped networks on all real test recordings: torch, the float reference and the chip side by side."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.frontends import load
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.models.networks import build_network
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from tests.support.real_recordings import REAL, on_real_recordings

ROOT = Path(__file__).parents[2]
SETS = {"objects": 144, "containers": 60}
"""Test recordings of each published set."""

pytestmark = on_real_recordings


@pytest.fixture(scope="module", params=SETS)
def example(request):
    """The path of a shipped network, the network, and its test recordings."""
    name = request.param
    recordings = lc.read_recordings(REAL / f"Ev-{name.title()}.zip")
    assert len(recordings) == SETS[name]
    path = ROOT / f"examples/models/{name}-hybrid.pt"
    return path, load(path), recordings


@pytest.fixture(scope="module")
def compiled(example):
    """The network compiled and checked on all its test recordings."""
    _, network, recordings = example
    return lc.compile(network, events=recordings)


def test_torch_and_the_float_reference_have_the_same_spikes(example):
    """Both compute in float64; no potential is so near to the threshold of 10 that rounding could decide."""
    path, network, recordings = example
    checkpoint = read_checkpoint(path)
    model = build_network(checkpoint.description).double()
    model.load_weights(checkpoint.weights)
    with torch.no_grad():
        in_torch = model(torch.from_numpy(recordings.spikes.astype(np.float64)))
    reference = evaluate(network, recordings.spikes, potentials=True)
    for name, spikes in in_torch.items():
        assert np.array_equal(spikes.numpy().astype(np.uint8), reference.spikes[name]), name
        assert np.abs(reference.potential[name] - 10.0).min() > 1e-12, f"a tie in {name}"


@pytest.mark.slow
def test_the_chip_predicts_as_trained(compiled):
    match = compiled.match
    assert match.prediction_agreement >= 0.97
    assert abs(match.accuracy["chip"] - match.accuracy["reference"]) <= 0.02
    assert compiled.report["match"]["clips"] == sum(counts.clips for counts in match.counts)
    assert compiled.report["match"]["wraps"] == 0


@pytest.mark.slow
def test_operations_are_of_the_published_order(compiled):
    """Hybrids of one fingertip take some 0.23 million additions per recording, conventional networks ten times as many."""
    report = compiled.report
    assert 1e5 < report["operations"]["published_method"]["operations"] < 5e5
    assert report["ann_comparison"]["cnn-3d"]["ratio"] > 9.8
    assert report["ann_comparison"]["gru-mlp"]["ratio"] > 9.8


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line", "reset"])
def test_the_program_is_the_rounded_network(example, strategy):
    """The reference on the integers of ``quantize``, which knows no compartments, has the spikes of the program."""
    _, network, recordings = example
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8, strategy=strategy)
    played = recordings.spikes[::12]
    expected = evaluate(levels.quantized.on_grid(), played)
    result = hw.simulate(levels.program, played)
    for population in network.populations:
        assert np.array_equal(result.spikes[population.name], expected.spikes[population.name])
    assert np.array_equal(result.prediction, expected.prediction)


@pytest.mark.minutes
def test_paired_dendrites_keep_the_predictions_and_nearly_all_spikes(example):
    """Weights are rounded for the train recordings of the same set."""
    path, network, recordings = example
    archive = REAL / f"Ev-{path.stem.removesuffix('-hybrid').title()}.zip"
    match = lc.compile(
        network, strategy="paired-dendrite", events=recordings, calibration=archive, diagnosis=False
    ).match
    assert match.prediction_agreement >= 0.99
    assert abs(match.accuracy["chip"] - match.accuracy["reference"]) <= 0.01
    assert match.spikes.agreement >= 0.98


@pytest.mark.minutes
def test_both_engines_give_the_same_integers(example, compiled):
    _, _, recordings = example
    probe = ("spikes", "u", "v", "potential")
    for recording in recordings.spikes:
        fast = hw.simulate(compiled.program, recording, engine="fast", probe=probe)
        reference = hw.simulate(compiled.program, recording, engine="reference", probe=probe)
        # Only the fast engine skips steps in which nothing happens.
        assert replace(fast.counts, skipped_steps=0) == reference.counts
        for name in compiled.program.populations:
            for kind in ("u", "v", "potential"):
                assert np.array_equal(getattr(fast, kind)[name], getattr(reference, kind)[name])
