"""A network of spikingjelly spikes as in spikingjelly, on a file of events as an event camera writes it."""

from pathlib import Path

import numpy as np

import locsnn_compile as lc
from locsnn_compile.cli.main import main
from locsnn_compile.reference.evaluate import evaluate

RECORDED = Path(__file__).with_name("scene-by-spikingjelly.npz")
"""``tests/peers/record_spikingjelly_camera.py`` says what it holds and writes it."""
SCENE = Path(__file__).parents[1] / "data" / "scene-evt3.raw"
"""``tests/support/raw_cameras.py`` writes it."""


def network_file(folder: Path) -> Path:
    """Write the recorded network as a NIR file, and return its path."""
    path = folder / "scene.nir"
    with np.load(RECORDED) as recorded:
        path.write_bytes(recorded["nir"].tobytes())
    return path


def test_every_spike_is_that_of_the_framework(tmp_path):
    network = lc.load(network_file(tmp_path))
    recordings = lc.read_recordings(SCENE, step_seconds=0.001)
    assert recordings.channels is not None
    # The camera has 20 rows, 34 columns and 2 polarities. Channels of recordings are 2 (34 y + x) + p, those of the
    # network's images 34 * 20 p + 34 y + x.
    images = recordings.spikes.reshape(1, -1, 20, 34, 2).transpose(0, 1, 4, 2, 3)
    ours = evaluate(network, images.reshape(1, len(recordings.spikes[0]), -1)).spikes
    with np.load(RECORDED) as recorded:
        for depth, name in enumerate(("1", "5"), start=1):
            expected = recorded[name]
            spikes = ours[f"_{name}"][0]
            assert expected.sum() > 20
            np.testing.assert_array_equal(spikes[depth:], expected[:-depth])


def test_the_command_takes_the_file_of_the_camera(tmp_path, capsys):
    model = network_file(tmp_path)
    options = ["--events", str(SCENE), "--step-seconds", "0.001", "-o", str(tmp_path / "out")]
    assert main(["compile", str(model), *options]) == 0
    assert "1 recording of scene-evt3.raw" in capsys.readouterr().out
