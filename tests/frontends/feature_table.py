"""The table of features by model format: which are read exactly, which lose something, and which are refused.

Each row is a :class:`Cell` with a small model file that has the feature. :func:`table` is the text of
``docs/reference/formats/features.csv``, which the manual shows; ``test_feature_table.py`` loads the model of every cell.
"""

from __future__ import annotations

import csv
import io
import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import nir
import numpy as np
import torch

import locsnn_compile as lc
from tests.support.net_files import dense, neuron, write_net
from tests.support.nir_graphs import DT, chain, cuba, graphs, integrate, lif, linear
from tests.support.slayer_files import LOIHI, write

RNG = np.random.default_rng(5)
GRAPHS = {name: row[0] for name, row in graphs().items()}
LEAST_AGREEMENT = {"NIR": 0.6, "lava-dl": 1.0, "slayerPytorch": 0.5}
"""Least agreement of the chip's spikes with the reference, by format.

lava-dl's integers must agree exactly. Floats are rounded, without calibration recordings and for small random networks,
so these limits only show that the chip plays the same network. Chosen by hand."""


@dataclass(frozen=True)
class Cell:
    """A row of the table: a feature of a format, and a model file that has it.

    - ``write_model``: writes the file into a folder, and returns the positional arguments of ``lc.load``
    - ``options``: the keyword arguments of ``lc.load``
    - ``message``: the whole error if the feature is refused, without the name of the file at its start
    - ``lost``: what is lost if the feature is read with a loss, in the words of the table
    - ``shows_loss``: whether a loaded network shows this loss
    """

    format: str
    feature: str
    write_model: Callable[[Path], tuple[Path, ...]]
    options: Mapping[str, object] = field(default_factory=dict)
    message: str = ""
    lost: str = ""
    shows_loss: Callable[[lc.Network], bool] = lambda network: True


def graph(nir_graph: nir.NIRGraph) -> Callable[[Path], tuple[Path, ...]]:
    """Return a function that writes a NIR graph into a folder, and returns its path."""

    def write_graph(folder):
        nir.write(folder / "model.nir", nir_graph)
        return (folder / "model.nir",)

    return write_graph


def net(*layers) -> Callable[[Path], tuple[Path, ...]]:
    """Return a function that writes a lava-dl network of these layers into a folder, and returns its path."""

    def write_layers(folder):
        write_net(folder / "model.net", layers)
        return (folder / "model.net",)

    return write_layers


def slayer(weights, *rest, **more) -> Callable[[Path], tuple[Path, ...]]:
    """Return a function that writes a slayerPytorch checkpoint and its YAML into a folder, and returns their paths."""
    return lambda folder: write(folder, weights, *rest, **more)


def neurons(node, *behind):
    """Return a function that writes a graph: 10 inputs, weights onto 12 neurons of this node, and nodes behind them."""
    nodes_behind = [(f"after{i}", other) for i, other in enumerate(behind)]
    weights = linear(np.random.default_rng(1), outs=12, ins=10)
    return graph(chain((10,), ("fc", weights), ("n", node), *nodes_behind))


def works(format, feature, write_model, **options):
    """Return a cell for a feature that is read as it is; options are those of ``lc.load``."""
    return Cell(format, feature, write_model, options)


def loses(format, feature, write_model, lost, shows_loss, **options):
    """Return a cell for a feature that is read with a loss, which ``shows_loss`` finds in the network."""
    return Cell(format, feature, write_model, options, lost=lost, shows_loss=shows_loss)


def refused(format, feature, write_model, message, **options):
    """Return a cell for a feature that is refused with this message, which follows the name of the model."""
    return Cell(format, feature, write_model, options, message=message)


def per_neuron(n, value):
    """Return the same number for each of n neurons, (n,)."""
    return np.full(n, value)


LI = nir.LI(tau=per_neuron(12, 1e-2), r=per_neuron(12, 10.0), v_leak=np.zeros(12))
CUBA_LI = nir.CubaLI(
    tau_syn=per_neuron(12, 5e-3),
    tau_mem=per_neuron(12, 1e-2),
    r=per_neuron(12, 10.0),
    v_leak=np.zeros(12),
    w_in=per_neuron(12, 5.0),
)
ENDLESS = nir.LIF(
    tau=per_neuron(12, np.inf),
    r=per_neuron(12, np.inf),
    v_leak=np.zeros(12),
    v_threshold=per_neuron(12, 1.5),
    v_reset=np.zeros(12),
)
UNIT = nir.IF(r=np.ones(12), v_threshold=per_neuron(12, 1.5), v_reset=np.zeros(12))
TWO_INPUTS = nir.NIRGraph(
    {
        "a": nir.Input(np.array([10])),
        "b": nir.Input(np.array([10])),
        "n": lif(RNG, 10),
        "o": nir.Output(np.array([10])),
    },
    [("a", "n"), ("b", "n"), ("n", "o")],
    type_check=False,
)
TWO_OUTPUTS = nir.NIRGraph(
    {
        "input": nir.Input(np.array([10])),
        "n": lif(RNG, 10),
        "m": lif(RNG, 10),
        "o": nir.Output(np.array([10])),
        "p": nir.Output(np.array([10])),
    },
    [("input", "n"), ("n", "m"), ("n", "o"), ("m", "p")],
    type_check=False,
)
SKIP = nir.NIRGraph(
    {
        "input": nir.Input(np.array([10])),
        "n": lif(RNG, 10),
        "m": lif(RNG, 10),
        "o": nir.Output(np.array([10])),
    },
    [("input", "n"), ("n", "m"), ("input", "m"), ("m", "o")],
    type_check=False,
)


def loop(*between):
    """Return a function that writes a graph of two populations that feed each other.

    On the way back from ``m`` to ``n``, spikes pass the nodes ``between``, pairs of a name and a node.
    """
    nodes = {
        "input": nir.Input(np.array([10])),
        "n": lif(RNG, 10),
        "m": lif(RNG, 10),
        "back": linear(RNG, outs=10, ins=10, scale=0.1),
    }
    nodes |= {"o": nir.Output(np.array([10])), **dict(between)}
    way_back = itertools.pairwise(["m", *dict(between), "back", "n"])
    return graph(
        nir.NIRGraph(nodes, [("input", "n"), ("n", "m"), ("m", "o"), *way_back], type_check=False)
    )


IMAGE = {"type": "input", "shape": np.array([2, 6, 6])}
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
    "weight": 2.0 * RNG.integers(-90, 120, (4, 1, 3, 3, 1)),
    "neuron": neuron(threshold=300),
}
POOL = {
    "type": "pool",
    "shape": np.array([2, 3, 3]),
    "kernelSize": np.array([2, 2]),
    "stride": np.array([2, 2]),
    "weight": np.full((1, 1, 2, 2), 200.0),
    "neuron": neuron(),
}
DENSE = dense(RNG, outs=6, ins=10)
WEIGHTS = {"fc1": RNG.normal(1, 2, (8, 12)), "fc2": RNG.normal(1, 2, (4, 8))}
INTEGERS = {name: 20 * weight for name, weight in WEIGHTS.items()}
HYBRID = {
    "fc1": RNG.normal(0.1, 2, (6, 156)),
    "fc2": RNG.normal(1, 2, (3, 6)),
    "locationFc1": RNG.normal(0.3, 2, (6, 40)),
    "locationFc2": RNG.normal(1, 2, (3, 6)),
}
NORMALISED = {
    "fc1.weight_v": torch.randn(6, 12, 1, 1, 1),
    "fc1.weight_g": torch.full((6, 1, 1, 1, 1), 9.0),
}

NIR_CELLS = [
    *(
        works("NIR", name, graph(GRAPHS[key]), dt=DT)
        for name, key in {
            "Linear, LIF": "lif",
            "Affine (biases)": "biases",
            "IF": "if",
            "CubaLIF": "cuba",
            "Threshold": "threshold",
            "Scale": "scale",
            "Delay of whole steps": "delay",
            "Conv1d": "conv1d",
            "Conv2d, groups, stride, padding, Flatten": "conv2d",
            "Conv2d, padding 'same'": "conv2d same",
            "Conv2d, dilation": "conv2d dilated",
            "SumPool2d": "sum pool",
            "AvgPool2d": "avg pool",
            "recurrent edges": "recurrent",
            "nested graphs": "nested",
            "one number for all neurons": "scalar parameters",
        }.items()
    ),
    works(
        "NIR",
        "LI at the end: class by potential",
        neurons(lif(RNG, 12), linear(RNG, outs=12, ins=12), LI),
        dt=DT,
    ),
    works(
        "NIR",
        "CubaLI at the end: class by potential",
        neurons(lif(RNG, 12), linear(RNG, outs=12, ins=12), CUBA_LI),
        dt=DT,
    ),
    works(
        "NIR",
        "v_leak and v_reset other than 0",
        neurons(lif(RNG, 12, v_leak=0.3, v_reset=-0.1, v_threshold=0.8)),
        dt=DT,
    ),
    works("NIR", "IF of r 1: adds weights whatever the step", neurons(UNIT)),
    works("NIR", "tau and r without end (snnTorch, beta 1)", neurons(ENDLESS), dt=DT),
    works("NIR", "several Inputs: channels one after the other", graph(TWO_INPUTS), dt=DT),
    works("NIR", "several Outputs of one size", graph(TWO_OUTPUTS), dt=DT),
    works("NIR", "connections that skip a population", graph(SKIP), dt=DT),
    works(
        "NIR",
        "a loop over two populations with a Delay",
        loop(("d", nir.Delay(per_neuron(10, DT)))),
        dt=DT,
    ),
    loses(
        "NIR",
        "a loop over two populations without a Delay",
        loop(),
        "it takes a step for each; the report says so",
        lambda n: "A loop over" in n.assumptions[-1],
        dt=DT,
    ),
    works("NIR", "--reset subtract of LIF", neurons(lif(RNG, 12)), dt=DT, reset="subtract"),
    works("NIR", "--reset subtract of CubaLIF", neurons(cuba(RNG, 12)), dt=DT, reset="subtract"),
    works(
        "NIR", "--reset late-subtract", neurons(integrate(RNG, 12)), dt=DT, reset="late-subtract"
    ),
    works("NIR", "--reset late-zero", neurons(cuba(RNG, 12)), dt=DT, reset="late-zero"),
    works("NIR", "--reset none", neurons(cuba(RNG, 12)), dt=DT, reset="none"),
    works("NIR", "--discretisation hold", neurons(lif(RNG, 12)), dt=DT, discretisation="hold"),
    works("NIR", "--discretisation exact", neurons(cuba(RNG, 12)), dt=DT, discretisation="exact"),
    works("NIR", "--floor -0.5", neurons(lif(np.random.default_rng(6), 12)), dt=DT, floor=-0.5),
    loses(
        "NIR",
        "time",
        neurons(lif(RNG, 12)),
        "it becomes steps: a spike is on the grid of `--dt`",
        lambda n: n.origin.metadata["dt"] == DT,
        dt=DT,
    ),
    refused(
        "NIR",
        "I",
        neurons(nir.I(r=np.ones(12))),
        ", node 'n': an integrator without leak or threshold overflows every register. Use "
        "an LI with a long tau, or an IF.",
        dt=DT,
    ),
    refused(
        "NIR",
        "LI before other nodes",
        neurons(LI, linear(RNG, outs=5, ins=12), lif(RNG, 5)),
        ", node 'after0': it takes the potential of 'n', and the chip sends spikes only. End "
        "the graph at that node, or make it a LIF.",
        dt=DT,
    ),
    refused(
        "NIR",
        "an Output of weights",
        neurons(lif(RNG, 12), linear(RNG, outs=5, ins=12)),
        ", node 'after0': it outputs the values of Linear, but the chip outputs spikes. End "
        "the graph in a LIF, or in an LI whose potential is read.",
        dt=DT,
    ),
    refused(
        "NIR",
        "no Input",
        graph(
            nir.NIRGraph(
                {"n": lif(RNG, 10), "o": nir.Output(np.array([10]))}, [("n", "o")], type_check=False
            )
        ),
        ": a graph needs an Input. Add an Input node before the first weights.",
        dt=DT,
    ),
    refused(
        "NIR",
        "an edge into an Input",
        graph(nir.NIRGraph(SKIP.nodes, [*SKIP.edges, ("m", "input")], type_check=False)),
        ", node 'input': an edge leads into an Input (from 'm'). Connect it to the nodes "
        "that the Input feeds.",
        dt=DT,
    ),
    refused(
        "NIR",
        "Delay of a fraction of a step",
        graph(chain((10,), ("d", nir.Delay(per_neuron(10, 1.5 * DT))), ("n", lif(RNG, 10)))),
        ", node 'd': a delay is not a whole number of steps from 0 to 1e+06 (1.5 steps of "
        "0.001 s). Correct it, or give another --dt.",
        dt=DT,
    ),
    refused(
        "NIR",
        "tau shorter than a step, euler",
        neurons(
            nir.LIF(
                tau=per_neuron(12, 1e-4),
                r=np.ones(12),
                v_leak=np.zeros(12),
                v_threshold=np.ones(12),
                v_reset=np.zeros(12),
            )
        ),
        ", node 'n': tau is shorter than a step (0.0001 s against 0.001 s). Give a smaller "
        "--dt, or --discretisation exact or hold.",
        dt=DT,
    ),
    refused(
        "NIR",
        "a threshold below the reset",
        neurons(lif(RNG, 12, v_reset=1.5)),
        ", node 'n': the threshold is not above the reset (by -0.5). Train with a threshold "
        "above v_reset and v_leak, and above 0.",
        dt=DT,
    ),
]
NET_CELLS = [
    works("lava-dl", "dense, CUBA neurons", net(DENSE)),
    works(
        "lava-dl",
        "LOIHI neurons of old files",
        net(dense(RNG, outs=6, ins=10, neuron=neuron(kind="LOIHI", wgtExp=0))),
    ),
    works(
        "lava-dl",
        "dense_rec",
        net(DENSE | {"type": "dense_rec", "weight_rec": 2.0 * RNG.integers(-30, 20, (6, 6))}),
    ),
    works("lava-dl", "input", net({"type": "input", "shape": np.array([10])}, DENSE)),
    works(
        "lava-dl",
        "input with neurons",
        net(
            {
                "type": "input",
                "shape": np.array([10]),
                "neuron": neuron(i_decay=4096, v_decay=4096, threshold=32),
            },
            DENSE,
        ),
    ),
    works(
        "lava-dl",
        "input with neurons, on numbers",
        net(
            {
                "type": "input",
                "shape": np.array([10]),
                "weight": np.array([50.0]),
                "bias": np.array([6.0]),
                "neuron": neuron(i_decay=4096, v_decay=1024, threshold=32),
            },
            DENSE,
        ),
        host_layers=1,
    ),
    works(
        "lava-dl",
        "numbers straight into weights",
        net(dense(RNG, outs=10, ins=10), dense(RNG, outs=4, ins=10)),
        host_layers=1,
    ),
    works(
        "lava-dl",
        "conv, flatten",
        net(IMAGE, CONV, {"type": "flatten", "shape": np.array([36])}, dense(RNG, outs=6, ins=36)),
    ),
    works(
        "lava-dl",
        "conv of stride 1 without an input layer",
        net(CONV | {"stride": np.array([1, 1]), "shape": np.array([4, 6, 6])}),
    ),
    works("lava-dl", "pool", net(IMAGE, POOL)),
    works(
        "lava-dl",
        "slayerPytorch's genModel: no axes of one, ragged pooling",
        net(
            {"type": "input", "shape": np.array([2, 5, 6])},
            POOL | {"weight": np.full((2, 2), 200.0)},
        ),
    ),
    works("lava-dl", "bias", net(dense(RNG, outs=6, ins=10, bias=RNG.integers(-9, 30, 6)))),
    works(
        "lava-dl",
        "delays: one, of neurons, of inputs",
        net(
            dense(RNG, outs=6, ins=10, delay=np.arange(6.0)),
            dense(RNG, outs=4, ins=6, delay=np.arange(6.0)),
            dense(RNG, outs=3, ins=4, delay=2.0),
        ),
    ),
    works(
        "lava-dl",
        "decays and thresholds of each neuron",
        net(
            dense(
                RNG,
                outs=6,
                ins=10,
                neuron=neuron(np.arange(6) * 500, np.arange(6) * 50, np.arange(6) * 50 + 200),
            )
        ),
    ),
    works(
        "lava-dl",
        "odd weights",
        net(dense(RNG, outs=6, ins=10, weight=RNG.integers(-255, 256, (6, 10)))),
    ),
    works(
        "lava-dl",
        "a last layer without neurons: class by potential",
        net(DENSE, {k: v for k, v in dense(RNG, outs=4, ins=6).items() if k != "neuron"}),
    ),
    loses(
        "lava-dl",
        "a last layer that never spikes: class by potential",
        net(DENSE, dense(RNG, outs=4, ins=6, neuron=neuron(threshold=2**18 - 1))),
        "its threshold of 2^18 - 1 becomes 2^17 - 1, which potentials hardly reach",
        lambda n: set(n.populations[-1].neuron.threshold.tolist()) == {2**17 - 1},
    ),
    loses(
        "lava-dl",
        "delays beyond 62, or of fractions",
        net(dense(RNG, outs=6, ins=10, delay=70.5)),
        "they are 62 at most, and whole, as in netx",
        lambda n: n.projections[0].delay == 62,
    ),
    refused(
        "lava-dl",
        "graded spikes",
        net(dense(RNG, outs=6, ins=10, neuron=neuron(gradedSpike=True))),
        ", layer 0: its spikes are graded. Train with graded_spike=False.",
    ),
    refused(
        "lava-dl",
        "a bias of input neurons, on events",
        net(
            {
                "type": "input",
                "shape": np.array([10]),
                "bias": np.array([6.0]),
                "neuron": neuron(i_decay=4096, v_decay=1024, threshold=32),
            },
            DENSE,
        ),
        ", layer 0: it adds a bias to the numbers before its neurons, and events have none "
        "(6). Run the layer on the host, and give numbers: --host-layers 1.",
    ),
    refused(
        "lava-dl",
        "other neurons",
        net(dense(RNG, outs=6, ins=10, neuron=neuron(kind="SDNN"))),
        ", layer 0: 'SDNN' neurons do not fit into one compartment of the chip. Use CUBA neurons.",
    ),
    refused(
        "lava-dl",
        "weights out of 8 bits",
        net(dense(RNG, outs=6, ins=10, weight=np.full((6, 10), 300.0))),
        ", layer 0: a weight does not fit an 8-bit synapse (0..300 against -256..254, even, "
        "or -255..255). Export it again, with quantised weights.",
    ),
    *(
        refused(
            "lava-dl",
            kind,
            net(DENSE, {"type": kind, "shape": np.array([6])}),
            f", layer 1: {kind!r} is a type of layer that the chip cannot run. {fix}",
        )
        for kind, fix in {
            "convT": "Replace it with a convolution.",
            "unpool": "Train without it.",
            "average": "Count the spikes of the layer before it.",
            "concat": "Join the inputs before the network.",
        }.items()
    ),
]
SLAYER_CELLS = [
    works("slayerPytorch", "dense, LOIHI neurons", slayer(INTEGERS, LOIHI)),
    works(
        "slayerPytorch",
        "the authors' hybrid, its location orders",
        slayer(HYBRID, steps=40, location_order="whorl"),
    ),
    works("slayerPytorch", "weight normalisation", slayer({}, extra=NORMALISED)),
    works(
        "slayerPytorch",
        "delays",
        slayer(WEIGHTS, extra={"delay.delay": torch.arange(8.0).reshape(1, 8, 1, 1, 1)}),
    ),
    works(
        "slayerPytorch",
        "location neurons of their own, with delays",
        slayer(
            HYBRID,
            steps=40,
            location_neuron={"theta": 4.0, "tauSr": 3.0},
            extra={"locationDelay.delay": torch.arange(6.0).reshape(1, 6, 1, 1, 1)},
        ),
    ),
    works(
        "slayerPytorch",
        "dense of images",
        slayer({}, extra={"fc1.weight": 2 * torch.rand(3, 2, 4, 5, 1)}),
    ),
    works(
        "slayerPytorch",
        "convolution, pooling, dense: the YAML's `layer` list",
        slayer(
            {},
            LOIHI,
            extra={
                "c.weight": 90 * torch.rand(4, 2, 3, 3, 1),
                "p.weight": torch.full((1, 1, 2, 2, 1), 90.0),
                "d.weight": 90 * torch.rand(3, 36, 1, 1, 1),
            },
            layer=[{"dim": "6x6x2"}, {"dim": "4c3z"}, {"dim": "2a"}, {"dim": 3}],
        ),
    ),
    loses(
        "slayerPytorch",
        "dense, SRMALPHA neurons",
        slayer(WEIGHTS),
        "kernels keep the tails that slayerPytorch cuts",
        lambda n: n.populations[0].neuron.tau_sr == 10,
    ),
    refused(
        "slayerPytorch",
        "convolutions without a list of layers",
        slayer({}, extra={"conv1.weight": torch.randn(3, 2, 4, 5, 2)}),
        "model 'model.pt', layer 'conv1': it is not a dense layer (weight (3, 2, 4, 5, 2)). "
        "Use slayer.dense layers, or list all layers in the YAML, as layer: [{dim: 34x34x2}, "
        "{dim: 16c5z}, ...].",
    ),
    refused(
        "slayerPytorch",
        "a YAML of another neuron",
        slayer(WEIGHTS, {**LOIHI, "type": "CUBA"}),
        "config 'net.yaml', neuron.type: 'CUBA' is not known. Choose one of: LOIHI, SRMALPHA.",
    ),
]
CELLS = [*NIR_CELLS, *NET_CELLS, *SLAYER_CELLS]


def table() -> str:
    """Return the cells as CSV, one row each."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(("format", "feature", "outcome", "what is lost, or the refusal"))
    for cell in CELLS:
        if cell.message:
            outcome = "refused"
            # A message goes on after the name of the model, with a colon or a comma.
            remark = cell.message.removeprefix(": ").removeprefix(", ")
        elif cell.lost:
            outcome = "lossy"
            remark = cell.lost
        else:
            outcome = "works"
            remark = ""
        rows.writerow((cell.format, cell.feature, outcome, remark))
    return text.getvalue()


NAMES = [(cell.format, cell.feature) for cell in CELLS]
assert len(set(NAMES)) == len(NAMES), "two cells have one format and feature"
