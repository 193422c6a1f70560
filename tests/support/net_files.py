"""Write ``.net`` files as lava-dl 0.6 does, dataset by dataset, and simulate them in plain integers.

The simulation is independent of the project: it takes the steps of netx, which runs such files in Lava, layer by layer.
"""

import h5py
import numpy as np


def write_net(path, layers, simulation=None):
    """Write layers, dicts of a type, datasets and a ``neuron`` dict, as ``export_hdf5`` of lava-dl does."""
    with h5py.File(path, "w") as file:
        for i, layer in enumerate(layers):
            group = file.create_group(f"layer/{i}")
            for key, value in layer.items():
                if key == "type":
                    group.create_dataset("type", (1,), "S10", [value.encode("ascii")])
                elif key == "neuron":
                    for name, number in value.items():
                        group.create_dataset(f"neuron/{name}", data=number)
                else:
                    group.create_dataset(key, data=value)
        for key, value in (simulation or {}).items():
            file.create_dataset(f"simulation/{key}", data=value)


def neuron(i_decay=1024, v_decay=128, threshold=400, kind="CUBA", **more):
    """Return the entries of CUBA neurons; ``more`` adds or replaces entries.

    Decays are in 4096ths, the threshold is in units of 64.
    """
    return {
        "type": kind,
        "iDecay": i_decay,
        "vDecay": v_decay,
        "vThMant": threshold,
        "refDelay": 1,
        "gradedSpike": False,
        **more,
    }


def even(rng, *shape, low=-128, high=127):
    """Return random even weights from ``2 * low`` to ``2 * high``: 8 bits with a sign hold multiples of 2."""
    return (2 * rng.integers(low, high + 1, shape)).astype(np.float32)


def dense(rng, outs, ins, **more):
    """Return a dense layer of even weights with CUBA neurons, as a ``.net`` file holds it; ``more`` replaces entries."""
    return {
        "type": "dense",
        "shape": np.array([outs]),
        "inFeatures": ins,
        "outFeatures": outs,
        "weight": even(rng, outs, ins),
        "neuron": neuron(),
        **more,
    }


def kept(x, decay):
    """Return x * (4096 - decay) / 4096, truncated toward zero."""
    return np.sign(x) * ((np.abs(x) * (4096 - decay)) >> 12)


def play(layers, spikes, longest_delay=62):
    """Return the spikes (steps, n) of each layer of neurons, by number, for input spikes (steps, n).

    Delays above ``longest_delay`` are cut to it, as a chip's are.
    """
    outputs = {}
    rows = np.asarray(spikes, dtype=np.int64)
    shape = None  # of the image that the previous layer puts out
    for number, layer in enumerate(layers):
        if layer["type"] in ("input", "flatten"):
            if layer["type"] == "input":
                shape = tuple(layer["shape"])
            if "neuron" not in layer:
                continue
            # An input layer with neurons: each hears its own channel. An event is the value 1, which is 64 on the scale
            # of the weights, or the weight of the layer.
            weight = int(np.max(layer.get("weight", 64)))
            one_to_one = weight * np.eye(int(np.prod(layer["shape"])))
            layer = {**layer, "type": "dense", "weight": one_to_one}
        rows = play_layer(layer, rows, shape, longest_delay)
        outputs[number] = rows
        shape = tuple(int(n) for n in layer["shape"])
    return outputs


def play_layer(layer, rows, shape, longest_delay=62):
    """Return the spikes (steps, n) of one layer of neurons; ``shape`` is that of its input image, if it has one."""
    n = int(np.prod(layer["shape"]))
    steps = len(rows)
    parameters = layer["neuron"]

    def per_neuron(values):
        """Repeat one value, or one per channel of an image, for all neurons."""
        return np.repeat(np.asarray(values, dtype=np.int64).reshape(-1), n // np.size(values))

    decay_u = per_neuron(parameters["iDecay"])
    decay_v = per_neuron(parameters["vDecay"])
    threshold = per_neuron(parameters["vThMant"]) * 64
    bias = per_neuron(layer.get("bias", 0)) * 64
    weight = np.asarray(layer["weight"]).astype(np.int64)
    # Delays are trained as real numbers of steps, and rounded down.
    delay = np.floor(np.asarray(layer.get("delay", 0), dtype=float)).reshape(-1)
    delay = np.minimum(delay, longest_delay).astype(int)
    u = np.zeros(n, dtype=np.int64)
    v = np.zeros(n, dtype=np.int64)
    out = np.zeros((steps, n), dtype=np.int64)
    for t in range(steps):
        # Spikes of a step act in the next one.
        q = np.zeros(n, dtype=np.int64)
        if layer["type"] == "conv":
            if t > 0:
                q += correlate(layer, weight, rows[t - 1].reshape(shape)).reshape(-1)
        else:
            for i in range(n):
                for j in range(weight.shape[1]):
                    # There is one delay for all, one per neuron, or one per input.
                    if delay.size == 1:
                        d = delay[0]
                    elif delay.size == n:
                        d = delay[i]
                    else:
                        d = delay[j]
                    if t - 1 - d >= 0:
                        q[i] += weight[i, j] * rows[t - 1 - d, j]
        if "weight_rec" in layer and t > 0:
            q += np.asarray(layer["weight_rec"]).astype(np.int64) @ out[t - 1]
        u = kept(u, decay_u) + 64 * q
        v = kept(v, decay_v) + u + bias
        out[t] = v > threshold
        v[out[t] == 1] = 0
    return out


def correlate(layer, weight, image):
    """Return the convolution of an image (channels, rows, columns), tap by tap."""
    stride = np.broadcast_to(layer.get("stride", 1), 2)
    padding = np.broadcast_to(layer.get("padding", 0), 2)
    dilation = np.broadcast_to(layer.get("dilation", 1), 2)
    weight = weight.reshape(weight.shape[:4])  # a fifth axis, of delays, has one entry
    padded = np.pad(image, [(0, 0), *((p, p) for p in padding)])
    result = np.zeros(tuple(layer["shape"]), dtype=np.int64)
    channels_per_group = weight.shape[1]
    outputs_per_group = len(weight) // layer.get("groups", 1)
    for o, r, c in np.ndindex(*result.shape):
        first_channel = o // outputs_per_group * channels_per_group
        for k, y, x in np.ndindex(*weight.shape[1:]):
            row = r * stride[0] + y * dilation[0]
            column = c * stride[1] + x * dilation[1]
            result[o, r, c] += weight[o, k, y, x] * padded[first_channel + k, row, column]
    return result


RNG = np.random.default_rng(11)

IMAGE = {"type": "input", "shape": np.array([2, 6, 6])}
"""Two channels of 6 by 6 pixels."""

CONV = {
    "type": "conv",
    "shape": np.array([4, 3, 3]),
    "inChannels": 2,
    "outChannels": 4,
    "kernelSize": np.array([3, 3]),
    "stride": np.array([2, 2]),
    "padding": np.array([1, 1]),
    "dilation": np.array([1, 1]),
    "groups": 2,
    "weight": even(RNG, 4, 1, 3, 3, 1),
    "neuron": neuron(threshold=300),
}


NETS = {
    "dense": [dense(RNG, outs=12, ins=10), dense(RNG, outs=5, ins=12)],
    "input layer": [{"type": "input", "shape": np.array([10])}, dense(RNG, outs=12, ins=10)],
    "input layer with neurons": [
        {**IMAGE, "neuron": neuron(i_decay=4096, v_decay=4096, threshold=32)},
        CONV,
        {"type": "flatten", "shape": np.array([36])},
        dense(RNG, outs=5, ins=36),
    ],
    "input layer with a weight": [
        {
            "type": "input",
            "shape": np.array([10]),
            "weight": np.array([26.0]),
            "bias": np.array([0.0]),
            "neuron": neuron(i_decay=4096, v_decay=1024, threshold=40),
        },
        dense(RNG, outs=12, ins=10),
    ],
    "loihi neurons of old files": [
        dense(
            RNG,
            outs=12,
            ins=10,
            neuron=neuron(kind="LOIHI", theta=80.0, tauRho=1.0, scaleRho=1.0, wgtExp=0),
        )
    ],
    "a decay each": [
        dense(
            RNG,
            outs=12,
            ins=10,
            neuron=neuron(
                i_decay=RNG.integers(0, 4097, 12),
                v_decay=RNG.integers(0, 4097, 12),
                threshold=RNG.integers(100, 500, 12),
            ),
        )
    ],
    "bias": [dense(RNG, outs=12, ins=10, bias=RNG.integers(-9, 30, 12).astype(np.float32))],
    "delay of a neuron": [
        dense(RNG, outs=12, ins=10, delay=RNG.uniform(0, 70, 12).astype(np.float32)),
        dense(RNG, outs=5, ins=12),
    ],
    "delay of an input": [
        dense(RNG, outs=12, ins=10, delay=RNG.uniform(0, 9, 10).astype(np.float32))
    ],
    "one delay": [dense(RNG, outs=12, ins=10, delay=3.7)],
    "recurrent": [
        dense(RNG, outs=12, ins=10)
        | {"type": "dense_rec", "weight_rec": even(RNG, 12, 12, low=-60, high=40)}
    ],
    "conv": [IMAGE, CONV, {"type": "flatten", "shape": np.array([36])}, dense(RNG, outs=5, ins=36)],
    "full range": [
        dense(
            RNG,
            outs=3,
            ins=10,
            weight=np.tile(np.array([-256, 254, 254, 254, 2], dtype=np.float32), (3, 2)),
        )
    ],
    "odd weights": [
        dense(RNG, outs=3, ins=10, weight=RNG.integers(-255, 256, (3, 10)).astype(np.float32))
    ],
}
