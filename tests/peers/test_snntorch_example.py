"""A network trained with snnTorch, to NIR, to the chip: spike agreement with snnTorch's own forward pass."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
from make_environments import python_of, why_missing

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.reference.evaluate import evaluate
from tests.support.spike_agreement import spike_agreement

pytestmark = pytest.mark.peers

STEPS = 50


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    reason = why_missing("snntorch")
    if reason:
        pytest.skip(f"snntorch: {reason}")
    folder = tmp_path_factory.mktemp("trained")
    script = Path(__file__).with_name("train_snntorch.py")
    made = subprocess.run(
        [str(python_of("snntorch")), str(script), str(folder)], capture_output=True, text=True
    )
    assert made.returncode == 0, made.stderr
    return folder


def figures(
    folder: Path, kind: str
) -> tuple[dict[str, float], dict[str, float], tuple[float, float, float]]:
    """Return the agreement of reference and chip by layer, and the accuracy of snnTorch, reference and chip."""
    with np.load(folder / f"{kind}.npz") as held:
        given, labels, theirs = (
            held[key].reshape(-1, STEPS, held[key].shape[1])
            for key in ("given", "out/labels", "out/3")
        )
        layers = {name: held[f"out/{name}"].reshape(len(given), STEPS, -1) for name in ("1", "3")}
    spikes = given.astype(np.uint8)
    network = lc.load(folder / f"{kind}.nir")
    compiled = lc.compile(
        network, events=spikes, labels=labels[:, 0, 0].astype(int), diagnosis=False
    )
    ours = evaluate(network, spikes).spikes, hw.simulate(compiled.program, spikes).spikes
    reference, chip = (
        {
            name: float(spike_agreement(found[name][:, late:], layers[name][:, :-late]))
            for late, name in enumerate(layers, 1)
        }
        for found in ours
    )
    snntorch = float((theirs.sum(axis=1).argmax(axis=1) == labels[:, 0, 0]).mean())
    accuracy = compiled.report["accuracy"]
    return reference, chip, (snntorch, accuracy["reference"], accuracy["chip"])


@pytest.mark.parametrize("kind", ["leaky", "synaptic"])
def test_the_reference_is_snntorch_and_the_chip_is_near(kind, written):
    reference, chip, accuracy = figures(written, kind)
    assert reference == {"1": 1.0, "3": 1.0}
    assert min(chip.values()) > 0.9
    assert accuracy[0] > 0.7
    assert abs(accuracy[2] - accuracy[0]) <= 0.05
