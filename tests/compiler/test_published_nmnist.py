"""A network that was published for N-MNIST on Loihi, on event files and frames of N-MNIST.

The network is flat, and numbers its inputs by polarity, row and column; the frames are numbered by row, column and
polarity. A real Loihi had all of these recordings right.
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
    """Return the checkpoint of slayerPytorch that the published weights make."""
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
    assert (report["match"]["samples"], report["match"]["spike_agreement"]) == (recordings, 1.0)
    assert report["chance"]["told_apart"]
    assert not [said for said in report["assumptions"] if "number" in said]


@pytest.mark.slow
def test_another_numbering_is_said_to_be_at_chance(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Without --channel-order, the numbering of this project's files is taken for that of the network."""
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
