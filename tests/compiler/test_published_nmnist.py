"""A published network for N-MNIST on Loihi, compiled and run on event files and frames of N-MNIST.

N-MNIST are digits seen by an event camera of 34 by 34 pixels. The network is fully connected and numbers its inputs by
polarity, row and column; the frames are numbered by row, column and polarity. A real Loihi classified all of these
recordings correctly.
"""

from pathlib import Path

import numpy as np
import pytest
import torch

import locsnn_compile as lc
from locsnn_compile.cli.compile import main
from tests.support.real_recordings import REAL

N_MNIST = REAL.parent / "nmnist"

pytestmark = pytest.mark.skipif(
    not N_MNIST.is_dir(), reason="recordings of N-MNIST are not next to the repository"
)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of a slayerPytorch checkpoint with the published weights."""
    path = tmp_path_factory.mktemp("model") / "nmnist.pt"
    with np.load(N_MNIST / "slayer-loihi/weights.npz") as weights:
        tensors = {
            f"{name}.weight": torch.from_numpy(array.astype(np.float32))[:, :, None, None, None]
            for name, array in weights.items()
        }
    torch.save(tensors, path)
    return path


@pytest.mark.parametrize(
    ("events", "recordings"),
    [
        pytest.param("bs2", 30, id="event files"),
        pytest.param("test-1ms.npz", 100, id="frames", marks=pytest.mark.minutes),
    ],
)
def test_every_recording_is_right_and_every_spike_as_trained(
    checkpoint: Path, events: str, recordings: int
) -> None:
    config = N_MNIST / "slayer-loihi/network.yaml"
    network = lc.load(checkpoint, config=config, channel_order="pyx")
    read = lc.read_recordings(N_MNIST / events, grid="34x34", model=network.expected)
    report = lc.compile(network, events=read, diagnosis=False).report
    assert report["accuracy"] == {"reference": 1.0, "chip": 1.0}
    assert report["match"]["samples"] == recordings
    assert report["match"]["spike_agreement"] == 1.0
    assert report["chance"]["told_apart"]
    # The numbering of the inputs was given, so it is no assumption.
    assert not any("number" in assumption for assumption in report["assumptions"])


@pytest.mark.slow
def test_the_report_says_that_a_wrong_numbering_predicts_at_chance(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without --channel-order, the network is assumed to number its inputs as this project's files do."""
    command = [
        str(checkpoint),
        "--config",
        str(N_MNIST / "slayer-loihi/network.yaml"),
        "--events",
        str(N_MNIST / "bs2"),
        "-o",
        str(tmp_path / "built"),
    ]
    assert main(command) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "Yes, spike for spike, but it predicts no better than chance." in printed
    assert (
        "The model does not say how its inputs are numbered: 2 * (34 * y + x) + polarity" in printed
    )
