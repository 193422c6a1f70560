"""Delays of layers of images: lava-dl writes one for each channel, of convolutions and of pooling."""

import numpy as np
import pytest
from net_files import neuron, write_net

import hw_model as hw
import locsnn_compile as lc

DELAYS = (3, 0)
KERNELS = {
    "pool": np.full((1, 1, 2, 2), 20.0),
    "conv": np.repeat(np.eye(2).reshape(2, 2, 1, 1), 4, axis=3).reshape(2, 2, 2, 2) * 20,
}


def layers(kind: str) -> list[dict]:
    """Return neurons without memory, (2, 2, 2), behind windows of 2 x 2 of an image (2, 4, 4)."""
    windows = {"stride": [2, 2], "padding": [0, 0], "dilation": [1, 1], "kernelSize": [2, 2]}
    channels = {"inChannels": 2, "outChannels": 2, "groups": 1} if kind == "conv" else {}
    behind = {
        "type": kind,
        "shape": np.array([2, 2, 2]),
        "weight": KERNELS[kind],
        "delay": np.array(DELAYS, dtype=np.float32),
        "neuron": neuron(i_decay=4096, v_decay=4096, threshold=10),
        **windows,
        **channels,
    }
    return [{"type": "input", "shape": np.array([2, 4, 4])}, behind]


@pytest.mark.parametrize("kind", KERNELS)
def test_a_spike_comes_after_the_delay_of_its_channel(kind, tmp_path):
    write_net(tmp_path / "model.net", layers(kind))
    image = np.zeros((12, 2, 4, 4), np.uint8)
    wanted = np.zeros((12, 2, 2, 2), np.uint8)
    for step, channel, row, column in ((0, 0, 1, 2), (0, 1, 3, 0), (4, 0, 0, 0), (5, 1, 2, 3)):
        image[step, channel, row, column] = 1
        wanted[step + 1 + DELAYS[channel], channel, row // 2, column // 2] = 1
    given = image.reshape(12, -1)
    network = lc.load(tmp_path / "model.net")
    program = lc.compile(network, events=given[None], diagnosis=False).program
    assert np.array_equal(hw.simulate(program, given).spikes["layer1"], wanted.reshape(12, -1))
