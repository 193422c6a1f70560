"""Broken and hostile files are refused with one line and exit code 2, write nothing, and take bounded time and memory.

Each case breaks a valid NIR graph in one place; the whole message is compared.
"""

import h5py
import nir
import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main
from tests.support.net_files import dense, write_net
from tests.support.nir_graphs import DT, chain, graphs, lif, linear

RNG = np.random.default_rng(1)


def graph_file(folder, change=None):
    """Write a graph of 10 inputs and 12 LIF neurons, apply ``change`` to its HDF5 file, and return its path."""
    path = folder / "model.nir"
    nir.write(path, chain((10,), ("fc", linear(RNG, outs=12, ins=10)), ("lif", lif(RNG, 12))))
    if change:
        with h5py.File(path, "a") as file:
            change(file)
    return path


def edges(*rows):
    """Return a change that replaces the edges of a graph's file."""

    def change(file):
        del file["node/edges"]
        file["node"].create_dataset(
            "edges", data=np.array(rows, dtype=object), dtype=h5py.string_dtype()
        )

    return change


def put(path, value):
    """Return a change that sets a dataset of an HDF5 file."""

    def change(file):
        if path in file:
            del file[path]
        file[path] = value

    return change


def circle(file):
    """Add two Linear nodes that feed each other, before the weights."""
    for name in ("a", "b"):
        file[f"node/nodes/{name}/type"] = "Linear"
        file[f"node/nodes/{name}/weight"] = np.eye(10)
    edges(("input", "a"), ("a", "b"), ("b", "a"), ("b", "fc"), ("fc", "lif"), ("lif", "output"))(
        file
    )


def rename(file):
    """Give a node a name with a slash, which HDF5 turns into a group in a group."""
    file.move("node/nodes/lif", "node/nodes/deep/lif")


def absurd(file):
    """Declare a weight of 8 TiB that takes no space in the file, as no chunk of it is written."""
    del file["node/nodes/fc/weight"]
    file["node/nodes/fc"].create_dataset(
        "weight", shape=(2**20, 2**20), chunks=(64, 64), compression="gzip", dtype="f4"
    )


def output_of_weights(file):
    """The neurons come first, one for each of the ten inputs, and the weights last."""
    edges(("input", "lif"), ("lif", "fc"), ("fc", "output"))(file)
    for name, values in list(file["node/nodes/lif"].items()):
        if values.shape == (12,):
            put(f"node/nodes/lif/{name}", values[:10])(file)


BROKEN = [
    pytest.param(
        edges(("input", "fc"), ("fc", "lif"), ("lif", "outputs")),
        "model 'model.nir': the edge 'lif' -> 'outputs' names a node that does not exist. "
        "Did you mean 'output'?",
        id="a dangling edge",
    ),
    pytest.param(
        circle,
        "model 'model.nir': a loop of edges has no neuron (a -> b). Put a neuron into the loop.",
        id="a circle of weights",
    ),
    pytest.param(
        rename,
        "model 'model.nir', node 'deep': it has no type; HDF5 makes groups of a name with a "
        "slash. Rename nodes without slashes.",
        id="a slash in a name",
    ),
    pytest.param(
        put("node/nodes/lif/type", "LIFF"),
        "model 'model.nir', node 'lif': 'LIFF' is not a NIR primitive. Did you mean 'LIF'?",
        id="an unknown primitive",
    ),
    pytest.param(
        absurd,
        "model 'model.nir', node 'fc': 'weight': the file unpacks to more than is read "
        "(8796093022224 bytes against 500000000). Give a smaller file.",
        id="absurd dimensions",
    ),
    pytest.param(
        put("node/nodes/lif/tau", "long"),
        "model 'model.nir', node 'lif': 'tau' is not made of numbers (object). Give a whole "
        "file, or write it again.",
        id="text for numbers",
    ),
    pytest.param(
        lambda f: f.__delitem__("node/nodes/lif/r"),
        "model 'model.nir', node 'lif': 'r' is missing. Give a whole file, or write it again.",
        id="a parameter missing",
    ),
    pytest.param(
        lambda f: (f.__delitem__("node/nodes/lif/r"), f.create_group("node/nodes/lif/r")),
        "model 'model.nir', node 'lif': 'r' is a group, not a value. Give a whole file, or "
        "write it again.",
        id="a group for a number",
    ),
    pytest.param(
        put("node/nodes/lif/r", np.full(12, np.inf)),
        "model 'model.nir', node 'lif': r is infinite, and its tau is not. Give both as numbers.",
        id="an infinite resistance",
    ),
    pytest.param(
        put("node/nodes/fc/weight", np.full((12, 10), np.inf)),
        "model 'model.nir', node 'fc': 'weight' holds a number that is not finite. Train or "
        "export again.",
        id="an infinite weight",
    ),
    pytest.param(
        put("node/nodes/lif/tau", np.full(12, np.nan)),
        "model 'model.nir', node 'lif': 'tau' holds a number that is not finite. Train or "
        "export again.",
        id="not a number",
    ),
    pytest.param(
        put("node/nodes/lif/tau", np.full(12, -1e-3)),
        "model 'model.nir', node 'lif': tau must be above 0 (-0.001). Correct it.",
        id="a negative tau",
    ),
    pytest.param(
        put("node/nodes/lif/tau", np.full(12, 1e-4)),
        "model 'model.nir', node 'lif': tau is shorter than a step (0.0001 s against 0.001 "
        "s). Give a smaller --dt, or --discretisation exact or hold.",
        id="a tau below a step",
    ),
    pytest.param(
        put("node/nodes/lif/v_reset", np.full(12, 2.0)),
        "model 'model.nir', node 'lif': the threshold is not above the reset (by -1). Train "
        "with a threshold above v_reset and v_leak, and above 0.",
        id="a threshold below the reset",
    ),
    pytest.param(
        put("node/nodes/lif/tau", np.full(5, 1e-2)),
        "model 'model.nir', node 'lif': tau is not one number per neuron ((5,) against 12). "
        "Give as many.",
        id="too few parameters",
    ),
    pytest.param(
        put("node/nodes/lif/type", "I"),
        "model 'model.nir', node 'lif': an integrator without leak or threshold overflows "
        "every register. Use an LI with a long tau, or an IF.",
        id="an integrator",
    ),
    pytest.param(
        put("node/nodes/fc/weight", np.ones((12, 9))),
        "model 'model.nir', node 'fc': its input has another size (10 against 9). Correct "
        "its weight.",
        id="weights that do not fit",
    ),
    pytest.param(
        edges(("input", "lif"), ("lif", "output"), ("fc", "lif")),
        "model 'model.nir', node 'fc': no node feeds it. Connect it to the input, or remove it.",
        id="weights that nothing feeds",
    ),
    pytest.param(
        output_of_weights,
        "model 'model.nir', node 'fc': it outputs the values of Linear, but the chip outputs "
        "spikes. End the graph in a LIF, or in an LI whose potential is read.",
        id="an output of weights",
    ),
    pytest.param(
        edges(("input", "lif"), ("lif", "fc"), ("fc", "output")),
        "model 'model.nir', node 'lif': its parameters do not fit its input ((12,) against "
        "(10,)). Give one number per neuron.",
        id="neurons of another size than the input",
    ),
    pytest.param(
        put("node/nodes/fc/weight", np.ones((11, 10))),
        "model 'model.nir', node 'lif': its input has another size (11 against 12). Give it "
        "a neuron for each value.",
        id="neurons that do not fit",
    ),
    pytest.param(
        lambda f: (
            f.__delitem__("node/nodes/fc/weight"),
            f["node/nodes/fc"].__setitem__("weight", h5py.ExternalLink("/etc/passwd", "/")),
        ),
        "model 'model.nir', node 'fc': 'weight' is a link, and links are not followed. Store "
        "the data itself.",
        id="a link out of the file",
    ),
    pytest.param(
        lambda f: f.__delitem__("node"),
        "model 'model.nir': it contains neither a NIR graph nor a lava-dl network. Give a "
        "checkpoint (.pt) that `locsnn train` wrote, a NIR graph (.nir), or a lava-dl "
        "network (.net).",
        id="no graph",
    ),
]


@pytest.mark.parametrize(("change", "message"), BROKEN)
def test_a_broken_graph_is_one_line(change, message, tmp_path):
    with pytest.raises(lc.InputError) as caught:
        lc.load(graph_file(tmp_path, change), dt=DT)
    assert str(caught.value) == message


OPTIONS = [
    pytest.param(
        {"reset": "zeros"}, "reset 'zeros': is not known. Did you mean 'zero'?", id="another reset"
    ),
    pytest.param(
        {"discretisation": "exakt"},
        "discretisation 'exakt': is not known. Did you mean 'exact'?",
        id="another discretisation",
    ),
    pytest.param(
        {"dt": 0.0},
        "dt: a step must last more than 0 s and at most 1e+06 s (0). Give the seconds per step.",
        id="no time",
    ),
    pytest.param(
        {"dt": 1e300},
        "dt: a step must last more than 0 s and at most 1e+06 s (1e+300). Give the seconds "
        "per step.",
        id="no end of time",
    ),
    pytest.param(
        {"dt": 10**400},
        "load, dt: it is too large for a float (1329 bits). Correct it.",
        id="a whole number beyond floats",
    ),
    pytest.param(
        {"config": "net.yaml"},
        "model 'model.nir': config was given, but a NIR graph contains this itself. Leave "
        "config out.",
        id="a config",
    ),
]


@pytest.mark.parametrize(("options", "message"), OPTIONS)
def test_an_option_that_cannot_be_met_is_one_line(options, message, tmp_path):
    with pytest.raises(lc.InputError) as caught:
        lc.load(graph_file(tmp_path), **({"dt": DT} | options))
    assert str(caught.value) == message


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["nir", "net"])
def test_truncated_and_mutated_files_never_end_in_another_error(suffix, tmp_path):
    path = tmp_path / f"model.{suffix}"
    nir.write(path, graphs()["nested"][0]) if suffix == "nir" else write_net(
        path, [dense(RNG, outs=5, ins=4)]
    )
    whole_file = path.read_bytes()
    rng = np.random.default_rng(0)
    messages = []
    trials = 90
    for trial in range(trials):
        data = bytearray(whole_file)
        if trial % 3 == 0:
            # A third of the trials truncates the file, the others change up to five bytes.
            data = data[: rng.integers(len(data))]
        else:
            for at in rng.integers(0, len(data), rng.integers(1, 6)):
                data[at] = rng.integers(256)
        path.write_bytes(data)
        try:
            lc.load(path)
        except lc.InputError as error:
            messages.append(str(error))
    # Truncated files are nearly all refused; many changed bytes are weights, which stay valid.
    assert len(messages) > trials // 3
    assert not any("\n" in message for message in messages)


def test_the_command_line_refuses_a_truncated_file_in_one_line_and_writes_nothing(tmp_path, capsys):
    path = graph_file(tmp_path)
    path.write_bytes(path.read_bytes()[:2000])
    assert main([str(path), "-o", str(tmp_path / "out")]) == 2
    assert (
        capsys.readouterr().err
        == f"model {str(path)!r}: it is damaged, truncated or not an HDF5 file. Give a whole file, or write it again.\n"
    )
    assert not (tmp_path / "out").exists()


def test_the_command_line_compiles_a_graph_and_gives_it_back(tmp_path, capsys):
    path = graph_file(tmp_path)
    assert (
        main(
            [
                str(path),
                "--dt",
                "1e-3",
                "--reset",
                "zero",
                "--emit",
                "nir",
                "-o",
                str(tmp_path / "out"),
            ]
        )
        == 0
    )
    assert "synthetic spikes, 5 % per step" in (tmp_path / "out" / "report.json").read_text()
    again = lc.load(tmp_path / "out" / "network.nir")
    assert again.origin.metadata["dt"] == pytest.approx(1e-3)
