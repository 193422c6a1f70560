"""A pixel reaches the same neuron with every reader of recordings and every kind of model for images.

The network is a 1 x 1 depthwise convolution of ones over (2 polarities, 4 rows, 4 columns) with a threshold of 0.5, so
that neuron p * 16 + 4 * y + x spikes for an event at (x, y, p) and for no other. Readers are functions that write one
event to a file and read it for a network; models are functions that write a network file and load it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import nir
import numpy as np
import pytest
import torch
import yaml

import hw_model as hw
import locsnn_compile as lc
from hw_model.values import ByteArray
from locsnn_compile.data import Recordings, from_tonic, read_recordings
from locsnn_compile.request.recordings import recordings_for
from tests.support.net_files import neuron, write_net
from tests.support.slayer_files import LOIHI

ROWS = COLUMNS = 4
POLARITIES = 2
STEPS = 4
"""Enough for the spike, which comes a step after its event."""
EVENTS = {(1, 2, 1): 25, (3, 0, 0): 3, (0, 3, 1): 28}
"""Events (x, y, p), and the neuron that spikes for each."""
TXYP = np.dtype([("t", "<i8"), ("x", "<i2"), ("y", "<i2"), ("p", "<i1")])
Place = tuple[int, int, int]


def nir_graph(folder: Path) -> lc.Network:
    """A NIR graph with an Input of shape (C, H, W)."""
    image = (POLARITIES, ROWS, COLUMNS)
    convolution = nir.Conv2d(
        input_shape=(ROWS, COLUMNS),
        weight=np.ones((POLARITIES, 1, 1, 1)),
        stride=1,
        padding=0,
        dilation=1,
        groups=POLARITIES,
        bias=np.zeros(POLARITIES),
    )
    nodes = {
        "input": nir.Input(np.array(image)),
        "conv": convolution,
        "neurons": nir.Threshold(np.full(image, 0.5)),
        "output": nir.Output(np.array(image)),
    }
    edges = [("input", "conv"), ("conv", "neurons"), ("neurons", "output")]
    nir.write(folder / "model.nir", nir.NIRGraph(nodes, edges, type_check=False))
    return lc.load(folder / "model.nir")


def net_layers(stated: bool) -> list[dict[str, Any]]:
    """Return the layers of a ``.net`` file: a convolution, after an input layer if the input is ``stated``."""
    shape = np.array([POLARITIES, ROWS, COLUMNS])
    convolution = {
        "type": "conv",
        "shape": shape,
        "inChannels": POLARITIES,
        "outChannels": POLARITIES,
        "kernelSize": np.array([1, 1]),
        "stride": np.array([1, 1]),
        "padding": np.array([0, 0]),
        "dilation": np.array([1, 1]),
        "groups": POLARITIES,
        "weight": np.full((POLARITIES, 1, 1, 1, 1), 2.0),
        "neuron": neuron(i_decay=4096, v_decay=4096, threshold=1),
    }
    return [{"type": "input", "shape": shape}, convolution] if stated else [convolution]


def net_file(folder: Path) -> lc.Network:
    """An input layer of shape (C, H, W), then a convolution."""
    write_net(folder / "model.net", net_layers(stated=True))
    return lc.load(folder / "model.net")


def net_without_input(folder: Path) -> lc.Network:
    """A convolution of stride 1, whose input has the shape of its output."""
    write_net(folder / "model.net", net_layers(stated=False))
    return lc.load(folder / "model.net")


def slayer_checkpoint(folder: Path) -> lc.Network:
    """A checkpoint of a convolution, whose YAML describes the layers from an input ``4x4x2`` on."""
    weights = {"conv1.weight": torch.full((POLARITIES, 1, 1, 1, 1), 2.0)}
    torch.save(weights, folder / "model.pt")
    layers = [{"dim": "4x4x2"}, {"dim": "2c1", "padding": 0, "groups": POLARITIES}]
    loihi = LOIHI | {"vThMant": 1, "vDecay": 4096, "iDecay": 4096}
    document = {"simulation": {"Ts": 1.0, "tSample": 5}, "neuron": loihi, "layer": layers}
    (folder / "net.yaml").write_text(yaml.safe_dump(document), "utf-8")
    return lc.load(folder / "model.pt", config=folder / "net.yaml")


def slayer_dense(folder: Path) -> lc.Network:
    """A dense layer whose weights keep the axes (C, H, W) of the image that they see."""
    image = (POLARITIES, ROWS, COLUMNS)
    weights = 2 * torch.eye(int(np.prod(image))).reshape(-1, *image, 1)
    torch.save({"fc1.weight": weights}, folder / "model.pt")
    loihi = LOIHI | {"vThMant": 1, "vDecay": 4096, "iDecay": 4096}
    document = {"simulation": {"Ts": 1.0, "tSample": 5}, "neuron": loihi}
    (folder / "net.yaml").write_text(yaml.safe_dump(document), "utf-8")
    return lc.load(folder / "model.pt", config=folder / "net.yaml")


def flat_graph(folder: Path) -> lc.Network:
    """A NIR graph with a flat Input, whose order the user states."""
    size = POLARITIES * ROWS * COLUMNS
    nodes = {
        "input": nir.Input(np.array([size])),
        "weights": nir.Linear(np.eye(size)),
        "neurons": nir.Threshold(np.full(size, 0.5)),
        "output": nir.Output(np.array([size])),
    }
    edges = [("input", "weights"), ("weights", "neurons"), ("neurons", "output")]
    nir.write(folder / "model.nir", nir.NIRGraph(nodes, edges, type_check=False))
    return lc.load(folder / "model.nir", channel_order="pyx")


MODELS = (nir_graph, net_file, net_without_input, slayer_checkpoint, slayer_dense)
Model = Callable[[Path], lc.Network]


def structured(place: Place) -> np.ndarray:
    """A structured array of one event at a pixel (x, y, polarity)."""
    x, y, p = place
    return np.array([(1_000, x, y, p)], dtype=TXYP)


def frames(place: Place) -> np.ndarray:
    """One recording of frames (samples, steps, polarities, rows, columns)."""
    x, y, p = place
    held = np.zeros((1, 3, POLARITIES, ROWS, COLUMNS), dtype=np.uint8)
    held[0, 1, p, y, x] = 1
    return held


def npy(folder: Path, place: Place, network: lc.Network) -> Recordings:
    np.save(folder / "e.npy", structured(place))
    return read_recordings(folder / "e.npy", steps=STEPS, model=network.expected)


def npz(folder: Path, place: Place, network: lc.Network) -> Recordings:
    np.savez(folder / "e.npz", events=structured(place))
    return read_recordings(folder / "e.npz", steps=STEPS, model=network.expected)


def bs1(folder: Path, place: Place, network: lc.Network) -> Recordings:
    """SLAYER's files of one dimension number the pixels."""
    x, y, p = place
    pixel = COLUMNS * y + x
    (folder / "e.bs1").write_bytes((pixel << 24 | p << 23 | 1_000).to_bytes(5, "big"))
    return read_recordings(folder / "e.bs1", steps=STEPS, model=network.expected)


def bs2(folder: Path, place: Place, network: lc.Network) -> Recordings:
    x, y, p = place
    (folder / "e.bs2").write_bytes((x << 32 | y << 24 | p << 23 | 1_000).to_bytes(5, "big"))
    return read_recordings(folder / "e.bs2", steps=STEPS, model=network.expected)


def n_mnist(folder: Path, place: Place, network: lc.Network) -> Recordings:
    x, y, p = place
    (folder / "e.bin").write_bytes((x << 32 | y << 24 | p << 23 | 1_000).to_bytes(5, "big"))
    return read_recordings(folder / "e.bin", steps=STEPS, model=network.expected)


def folder_of_files(folder: Path, place: Place, network: lc.Network) -> Recordings:
    (folder / "set").mkdir()
    np.save(folder / "set" / "sample_0_label_1.npy", structured(place))
    return read_recordings(folder / "set", steps=STEPS, model=network.expected)


def tonic_set(folder: Path, place: Place, network: lc.Network) -> Recordings:
    """A data set that states the size of its sensor, as those of Tonic do."""

    class Sensor(list[Any]):
        sensor_size = (COLUMNS, ROWS, POLARITIES)

    return from_tonic(Sensor([(structured(place), 0)]), steps=STEPS)


def tonic_events(folder: Path, place: Place, network: lc.Network) -> Recordings:
    """A list of events, without the size of a sensor."""
    return from_tonic([(structured(place), 0)], steps=STEPS)


def npy_frames(folder: Path, place: Place, network: lc.Network) -> Recordings:
    np.save(folder / "e.npy", frames(place))
    axes = "samples,steps,polarities,rows,columns"
    return read_recordings(folder / "e.npy", axes=axes, model=network.expected)


def npz_frames(folder: Path, place: Place, network: lc.Network) -> Recordings:
    """The file itself names its axes."""
    held = frames(place).transpose(0, 3, 4, 2, 1)
    axes = "samples,rows,columns,polarities,steps"
    np.savez(folder / "e.npz", spikes=held, axes=axes)
    return read_recordings(folder / "e.npz", steps=STEPS, model=network.expected)


def torch_frames(folder: Path, place: Place, network: lc.Network) -> Recordings:
    torch.save(torch.from_numpy(frames(place)), folder / "e.pt")
    axes = "samples,steps,polarities,rows,columns"
    return read_recordings(folder / "e.pt", axes=axes, model=network.expected)


def hdf5_frames(folder: Path, place: Place, network: lc.Network) -> Recordings:
    with h5py.File(folder / "e.h5", "w") as file:
        file["spikes"] = frames(place)
        file["axes"] = "samples,steps,polarities,rows,columns"
    return read_recordings(folder / "e.h5", model=network.expected)


def array_in_python(folder: Path, place: Place, network: lc.Network) -> ByteArray:
    """Frames as an array, given to ``lc.compile`` as they are."""
    return frames(place)


def flat_array_of_a_grid(folder: Path, place: Place, network: lc.Network) -> Recordings:
    """Channels numbered 2 * (4 * y + x) + p, of a sensor that the user describes."""
    x, y, p = place
    held = np.zeros((1, 3, POLARITIES * ROWS * COLUMNS), dtype=np.uint8)
    held[0, 1, POLARITIES * (COLUMNS * y + x) + p] = 1
    np.save(folder / "e.npy", held.transpose(0, 2, 1))
    return read_recordings(folder / "e.npy", grid="4x4", model=network.expected)


READERS = (
    npy,
    npz,
    bs1,
    bs2,
    n_mnist,
    folder_of_files,
    tonic_set,
    tonic_events,
    npy_frames,
    npz_frames,
    torch_frames,
    hdf5_frames,
    array_in_python,
    flat_array_of_a_grid,
)
Reader = Callable[[Path, Place, lc.Network], Recordings | ByteArray]


def spiking_neurons(network: lc.Network, events: Recordings | ByteArray) -> tuple[list[int], Any]:
    """Return the neurons that spike on the chip, and the compiled model."""
    compiled = lc.compile(network, events=events, diagnosis=False)
    recordings = recordings_for(network, events)
    population = network.populations[-1].name
    spikes = hw.simulate(compiled.program, recordings.spikes).spikes[population]
    return np.flatnonzero(spikes.any(axis=(0, 1))).tolist(), compiled


@pytest.mark.parametrize("place", EVENTS, ids=str)
@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.__name__)
@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_a_pixel_reaches_its_neuron(
    tmp_path: Path, model: Model, reader: Reader, place: Place
) -> None:
    network = model(tmp_path)
    neurons, compiled = spiking_neurons(network, reader(tmp_path, place, network))
    assert neurons == [EVENTS[place]]
    # No numbering of pixels was assumed.
    assert not any("number" in assumption for assumption in compiled.report["assumptions"])
