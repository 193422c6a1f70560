"""``--emit nir`` of networks over images: the file states which input is which pixel.

lava-dl files, which state the shape of their input, are written as NIR and read again.
"""

from pathlib import Path

import nir
import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.data.channels import Channels
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from tests.support.net_files import dense, even, neuron, write_net

IMAGE = (2, 3, 4)
"""Polarities, rows and columns of the images."""
RNG = np.random.default_rng(8)


def net_over_images(folder: Path, shape: tuple[int, ...] = IMAGE) -> Path:
    """Write a lava-dl network whose input has this shape: a convolution over images, or else a dense layer."""
    convolution = {
        "type": "conv",
        "shape": np.array([3, 3, 4]),
        "inChannels": 2,
        "outChannels": 3,
        "kernelSize": np.array([3, 3]),
        "stride": np.array([1, 1]),
        "padding": np.array([1, 1]),
        "dilation": np.array([1, 1]),
        "groups": 1,
        "weight": even(RNG, 3, 2, 3, 3, low=-20, high=40),
        "neuron": neuron(threshold=60),
    }
    layers_behind = [{"type": "flatten", "shape": np.array([36])}, dense(RNG, outs=4, ins=36)]
    layers = [convolution, *layers_behind] if shape == IMAGE else [dense(RNG, outs=4, ins=24)]
    write_net(folder / "model.net", [{"type": "input", "shape": np.array(shape)}, *layers])
    return folder / "model.net"


def exchanged(path: Path, folder: Path, **options) -> tuple[lc.Network, Path]:
    """Load a network, write it as NIR, and return both the network and the path of the NIR file."""
    network = lc.load(path, **options)
    written = folder / "sent.nir"
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8)
    written.write_bytes(exchange_file("nir", levels.quantized))
    return network, written


def test_the_input_has_the_shape_of_the_image(tmp_path):
    _, written = exchanged(net_over_images(tmp_path), tmp_path)
    graph = nir.read(written)
    assert graph.nodes["input"].input_type["input"].tolist() == [2, 3, 4]
    ((_, flat),) = [edge for edge in graph.edges if edge[0] == "input"]
    assert isinstance(graph.nodes[flat], nir.Flatten)
    assert graph.nodes[flat].output_type["output"].tolist() == [24]


def test_pixels_reach_the_same_neurons_of_the_file(tmp_path):
    network, written = exchanged(net_over_images(tmp_path), tmp_path)
    read_back = lc.load(written, dt=1e-4)
    assert network.expected.inputs == Channels(columns=4, rows=3, polarities=2, numbering="pyx")
    assert read_back.expected.inputs == Channels(columns=4, rows=3, polarities=2, numbering="pyx")
    # For every pixel and polarity: 4 steps of an image with this pixel alone, then 2 steps of silence.
    reached = 0
    for pixel in np.ndindex(*IMAGE):
        frames = np.zeros((1, 6, *IMAGE), np.uint8)
        frames[(0, slice(0, 4), *pixel)] = 1
        played = frames.reshape(1, 6, -1)
        expected = evaluate(network, played).spikes["layer1"]
        np.testing.assert_array_equal(evaluate(read_back, played).spikes["layer1"], expected)
        reached += int(expected.sum())
    assert reached > 20


@pytest.mark.parametrize("options", [{}, {"channel_order": "yxp"}])
def test_inputs_that_are_not_numbered_as_images_stay_flat(options, tmp_path):
    _, written = exchanged(net_over_images(tmp_path, (24,)), tmp_path, **options)
    assert nir.read(written).nodes["input"].input_type["input"].tolist() == [24]
