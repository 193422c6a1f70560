"""Delays of lava-dl's layers of images, which have one delay per channel, and of layers with biases.

The expected spikes are worked out by hand.
"""

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from tests.support.net_files import neuron, write_net

DELAYS = (3, 0)
"""The delay of each of two channels, in steps."""
KERNELS = {
    "pool": np.full((1, 1, 2, 2), 20.0),
    "conv": np.repeat(np.eye(2).reshape(2, 2, 1, 1), 4, axis=3).reshape(2, 2, 2, 2) * 20,
}


def layers(kind: str) -> list[dict]:
    """Return an input (2, 4, 4), and neurons without memory (2, 2, 2), each of which sees a window of 2 x 2 pixels."""
    windows = {"stride": [2, 2], "padding": [0, 0], "dilation": [1, 1], "kernelSize": [2, 2]}
    channels = {"inChannels": 2, "outChannels": 2, "groups": 1} if kind == "conv" else {}
    layer_behind = {
        "type": kind,
        "shape": np.array([2, 2, 2]),
        "weight": KERNELS[kind],
        "delay": np.array(DELAYS, dtype=np.float32),
        "neuron": neuron(i_decay=4096, v_decay=4096, threshold=10),
        **windows,
        **channels,
    }
    return [{"type": "input", "shape": np.array([2, 4, 4])}, layer_behind]


@pytest.mark.parametrize("kind", KERNELS)
def test_a_spike_comes_after_the_delay_of_its_channel(kind, tmp_path):
    write_net(tmp_path / "model.net", layers(kind))
    image = np.zeros((12, 2, 4, 4), np.uint8)
    expected = np.zeros((12, 2, 2, 2), np.uint8)
    for step, channel, row, column in ((0, 0, 1, 2), (0, 1, 3, 0), (4, 0, 0, 0), (5, 1, 2, 3)):
        image[step, channel, row, column] = 1
        expected[step + 1 + DELAYS[channel], channel, row // 2, column // 2] = 1
    events = image.reshape(12, -1)
    network = lc.load(tmp_path / "model.net")
    program = lc.compile(network, events=events[None], diagnosis=False).program
    assert np.array_equal(hw.simulate(program, events).spikes["layer1"], expected.reshape(12, -1))


HELD_BACK = "The delays of layer 1 hold back its inputs and not its biases, as in netx; slayer delays what it sends."


def test_a_bias_is_not_delayed_as_in_netx_and_an_assumption_says_so(tmp_path):
    """The current is lost in every step, and half of the voltage; a bias of 6 alone needs three steps to pass 10."""
    layer = {
        "type": "dense",
        "shape": np.array([1]),
        "weight": np.full((1, 1), 6.0),
        "bias": np.array([6.0]),
        "delay": np.array([3.0]),
        "neuron": neuron(i_decay=4096, v_decay=2048, threshold=10),
    }
    write_net(tmp_path / "model.net", [{"type": "input", "shape": np.array([1])}, layer])
    network = lc.load(tmp_path / "model.net")
    events = np.zeros((12, 1), np.uint8)
    events[0] = events[5] = 1
    program = lc.compile(network, events=events[None], diagnosis=False).program
    # A weight of 6 arrives 1 + 3 steps after its event. Until then v is 6, 9, 10.5 by the bias, which spikes in step 2.
    expected = []
    v = 0.0
    for step in range(12):
        arrives = step >= 4 and events[step - 4, 0]
        v = v / 2 + 6 + 6 * arrives
        expected.append(int(v > 10))
        if v > 10:
            v = 0.0
    spikes = hw.simulate(program, events).spikes["layer1"]
    assert spikes[:, 0].tolist() == expected
    assert expected[2] == 1
    assert network.assumptions == (HELD_BACK,)


@pytest.mark.parametrize("left_out", ["bias", "delay"])
def test_delays_without_a_bias_need_no_assumption(left_out, tmp_path):
    layer = {
        "type": "dense",
        "shape": np.array([1]),
        "weight": np.full((1, 1), 6.0),
        "bias": np.array([6.0]),
        "delay": np.array([3.0]),
        "neuron": neuron(),
    }
    del layer[left_out]
    write_net(tmp_path / "model.net", [{"type": "input", "shape": np.array([1])}, layer])
    assert lc.load(tmp_path / "model.net").assumptions == ()
