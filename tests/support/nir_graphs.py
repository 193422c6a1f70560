"""NIR graphs that together have every primitive that the project reads, with random weights from one seed."""

import itertools

import nir
import numpy as np

import locsnn_compile as lc

DT = 1e-3
"""Seconds per step."""


def lif(rng, *shape, v_leak=0.0, v_reset=0.0, v_threshold=1.0, kind=nir.LIF):
    """Return a LIF node with random time constants from 4 to 20 ms.

    Its resistances are near ``tau / DT``, with which a spike of one step adds about its weight to the potential.
    """
    tau = rng.uniform(4e-3, 2e-2, shape)
    potentials = {
        "v_leak": np.full(shape, v_leak),
        "v_threshold": np.full(shape, v_threshold),
        "v_reset": np.full(shape, v_reset),
    }
    return kind(tau=tau, r=tau / DT * rng.uniform(0.8, 1.2, shape), **potentials)


def cuba(rng, *shape, v_leak=0.0, v_reset=0.0, v_threshold=1.0):
    """Return a CubaLIF node with random time constants; a spike adds half its weight to the current."""
    tau_syn = rng.uniform(3e-3, 9e-3, shape)
    tau_mem = rng.uniform(4e-3, 2e-2, shape)
    return nir.CubaLIF(
        tau_syn=tau_syn,
        tau_mem=tau_mem,
        r=tau_mem / DT,
        w_in=tau_syn / DT * 0.5,
        v_leak=np.full(shape, v_leak),
        v_threshold=np.full(shape, v_threshold),
        v_reset=np.full(shape, v_reset),
    )


def integrate(rng, *shape):
    """Return an IF node to whose potential a spike adds its weight."""
    return nir.IF(
        r=np.full(shape, 1 / DT), v_threshold=rng.uniform(0.8, 1.5, shape), v_reset=np.zeros(shape)
    )


def linear(rng, outs, ins, scale=0.5):
    """A Linear node of random weights around 0.1, so that neurons behind it spike."""
    return nir.Linear(rng.normal(0.1, scale, (outs, ins)))


def chain(shape, *named):
    """Return a graph of an input of ``shape``, the named nodes in a row, and an output."""
    nodes = {
        "input": nir.Input(np.array(shape)),
        **dict(named),
        "output": nir.Output(np.array([1])),
    }
    names = list(nodes)
    return nir.NIRGraph(nodes, list(itertools.pairwise(names)), type_check=False)


def graphs():
    """Return pairs of (graph, input shape) by name."""
    rng = np.random.default_rng(7)
    image = (2, 6, 6)
    conv = nir.Conv2d(
        input_shape=(6, 6),
        weight=rng.normal(0.1, 0.3, (4, 1, 3, 3)),
        stride=2,
        padding=1,
        dilation=1,
        groups=2,
        bias=np.zeros(4),
    )
    same = nir.Conv2d(
        input_shape=(6, 6),
        weight=rng.normal(0.1, 0.3, (3, 2, 2, 4)),
        stride=1,
        padding="same",
        dilation=1,
        groups=1,
        bias=np.zeros(3),
    )
    dilated = nir.Conv2d(
        input_shape=(6, 6),
        weight=rng.normal(0.1, 0.3, (3, 2, 2, 2)),
        stride=(1, 2),
        padding=(2, 0),
        dilation=(2, 3),
        groups=1,
        bias=np.zeros(3),
    )
    conv1d = nir.Conv1d(
        input_shape=12,
        weight=rng.normal(0.1, 0.4, (5, 3, 4)),
        stride=2,
        padding=1,
        dilation=1,
        groups=1,
        bias=np.zeros(5),
    )
    pooled = {
        "kernel_size": np.array([2, 2]),
        "stride": np.array([2, 2]),
        "padding": np.array([0, 0]),
    }
    flat = nir.Flatten(input_type={"input": np.array([4, 3, 3])}, start_dim=0, end_dim=-1)
    recurrent = nir.NIRGraph(
        {
            "input": nir.Input(np.array([6])),
            "w": linear(rng, outs=8, ins=6),
            "lif": lif(rng, 8),
            "back": linear(rng, outs=8, ins=8, scale=0.2),
            "o": nir.Output(np.array([8])),
        },
        [("lif", "back"), ("back", "lif"), ("input", "w"), ("lif", "o"), ("w", "lif")],
        type_check=False,
    )
    inner = nir.NIRGraph(
        {
            "in": nir.Input(np.array([6])),
            "w": linear(rng, outs=7, ins=6),
            "lif": lif(rng, 7),
            "out": nir.Output(np.array([7])),
        },
        [("in", "w"), ("w", "lif"), ("lif", "out")],
    )
    return {
        "lif": (chain((10,), ("fc", linear(rng, outs=12, ins=10)), ("lif", lif(rng, 12))), (10,)),
        "two layers": (
            chain(
                (10,),
                ("fc1", linear(rng, outs=12, ins=10)),
                ("l1", lif(rng, 12)),
                ("fc2", linear(rng, outs=5, ins=12)),
                ("l2", cuba(rng, 5)),
            ),
            (10,),
        ),
        "biases": (
            chain(
                (10,),
                ("fc1", nir.Affine(rng.normal(0.1, 0.5, (12, 10)), rng.normal(0, 0.1, 12))),
                ("l1", cuba(rng, 12)),
                ("fc2", nir.Affine(rng.normal(0.1, 0.5, (5, 12)), rng.normal(0, 0.1, 5))),
                ("l2", lif(rng, 5)),
            ),
            (10,),
        ),
        "cuba": (
            chain((10,), ("fc", linear(rng, outs=12, ins=10)), ("cuba", cuba(rng, 12))),
            (10,),
        ),
        "if": (
            chain((10,), ("fc", linear(rng, outs=12, ins=10)), ("if", integrate(rng, 12))),
            (10,),
        ),
        "threshold": (
            chain(
                (10,),
                ("fc", linear(rng, outs=12, ins=10)),
                ("t", nir.Threshold(rng.uniform(0.2, 1, 12))),
            ),
            (10,),
        ),
        "v_leak": (
            chain(
                (10,),
                ("fc", linear(rng, outs=12, ins=10)),
                ("lif", lif(rng, 12, v_leak=0.0, v_threshold=0.7)),
            ),
            (10,),
        ),
        "conv2d": (
            chain(
                image,
                ("conv", conv),
                ("lif", lif(rng, 4, 3, 3)),
                ("flat", flat),
                ("fc", linear(rng, outs=5, ins=36)),
                ("out", lif(rng, 5)),
            ),
            image,
        ),
        "conv2d same": (chain(image, ("conv", same), ("lif", lif(rng, 3, 6, 6))), image),
        "conv2d dilated": (chain(image, ("conv", dilated), ("lif", lif(rng, 3, 8, 2))), image),
        "conv1d": (chain((3, 12), ("conv", conv1d), ("lif", lif(rng, 5, 6))), (3, 12)),
        "sum pool": (
            chain(
                image,
                ("pool", nir.SumPool2d(**pooled)),
                ("lif", lif(rng, 2, 3, 3, v_threshold=2.0)),
            ),
            image,
        ),
        "avg pool": (
            chain(
                image,
                ("pool", nir.AvgPool2d(**pooled)),
                ("lif", lif(rng, 2, 3, 3, v_threshold=0.4)),
            ),
            image,
        ),
        "scale": (
            chain(
                (10,),
                ("fc", linear(rng, outs=12, ins=10)),
                ("s", nir.Scale(rng.uniform(0.5, 2, 12))),
                ("lif", lif(rng, 12)),
            ),
            (10,),
        ),
        "delay": (
            chain(
                (10,),
                ("d", nir.Delay(rng.integers(0, 5, 10) * DT)),
                ("fc", linear(rng, outs=12, ins=10)),
                ("d2", nir.Delay(rng.integers(0, 3, 12) * DT)),
                ("lif", lif(rng, 12)),
            ),
            (10,),
        ),
        "scalar parameters": (
            chain((10,), ("fc", linear(rng, outs=12, ins=10)), ("lif", lif(rng, 1))),
            (10,),
        ),
        "recurrent": (recurrent, (6,)),
        "nested": (
            chain(
                (6,),
                ("sub", inner),
                ("fc", nir.Linear(rng.uniform(0, 1.5, (4, 7)))),
                ("lif", lif(rng, 4)),
            ),
            (6,),
        ),
    }


def random_spikes(shape, steps=60, rate=0.25, seed=3):
    """Return random spikes (steps, *shape) of 0 and 1; each channel spikes in a step with probability ``rate``."""
    return (np.random.default_rng(seed).random((steps, *shape)) < rate).astype(np.uint8)


def load_graph(graph, tmp_path, **options):
    """Write a graph to a file, and load it as a network; ``options`` are those of ``lc.load``, by default steps of DT."""
    path = tmp_path / "graph.nir"
    nir.write(path, graph)
    return lc.load(path, **{"dt": DT} | options)
