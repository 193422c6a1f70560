"""Model files that frameworks write, against how the frameworks themselves spike: neuron by neuron, step by step.

The float reference must be equal, and so must the chip if the file holds integers (lava-dl). In our networks each projection
of a NIR graph takes one step and in the frameworks none, so spikes are compared as many steps later as a layer is deep;
lava-dl's layers take the step too.
"""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import networkx as nx
import numpy as np
import pytest
from make_environments import python_of, why_missing

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import Projection, matrix
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.request.recordings import recordings_for
from tests.support.spike_agreement import spike_agreement

pytestmark = pytest.mark.peers

SCRIPTS = Path(__file__).parent
STEP = {"norse": 1e-6, "sinabs": 1.0}
"""Seconds per step, for frameworks that do not write time constants for a step of 1e-4 s."""
RESETS = ("late-zero", "late-subtract", "subtract")
"""Resets that the name of a network may end with. A NIR file does not hold the reset, so it is passed when it is read."""
NETWORKS = {
    "snntorch": (
        "leaky", "synaptic", "leaky-late-subtract", "synaptic-late-subtract", "synaptic-late-zero", "beta-0", "beta-1", "recurrent",
        "recurrent-one-to-one", "recurrent-late-zero", "recurrent-late-subtract", "recurrent-synaptic-late-zero",
        "recurrent-synaptic-late-subtract", "nested", "conv",
    ),
    "norse": ("lif", "lif-at-rest-off-0", "iaf", "li", "skip", "skips", "branches", "recurrent-skip", "spikes-by-itself"),
    "sinabs": ("lif", "lif-subtract", "iaf", "iaf-subtract", "li", "conv", "conv1d"),
    "spikingjelly": ("lif", "lif-at-rest-off-0", "lif-whole-input", "parametric", "if", "if-reset-off-0", "cuba", "skip", "skip-sum", "conv", "conv1d"),
    "lava-dl": ("dense", "weight-norm", "decay-of-each", "recurrent", "delay", "input", "conv", "conv-groups-delay", "affine"),
}  # fmt: skip
CHIP_LEAST = 0.85
"""Least agreement of the chip, which rounds weights and decays, with the spikes of a first layer. Later layers are not judged:
heavy weights pass the few differences of the first on to them."""
LEAST_SPIKES = 5
"""More spikes than these must have come from each layer that is compared, or equality would say little."""


@pytest.fixture(scope="session")
def written(tmp_path_factory):
    """Return a function that gives the folder of files that a framework has written; each framework is run once."""

    @cache
    def run(framework: str) -> Path:
        reason = why_missing(framework)
        if reason:
            pytest.skip(f"{framework}: {reason}")
        folder = tmp_path_factory.mktemp(framework)
        script = SCRIPTS / f"export_{framework.replace('-', '_')}.py"
        process = subprocess.run(
            [str(python_of(framework)), str(script), str(folder)], capture_output=True, text=True
        )
        assert process.returncode == 0, process.stderr
        return folder

    return run


def load(framework: str, name: str, folder: Path) -> lc.Network:
    """Return a network as we read it from the framework's file."""
    if framework == "lava-dl":
        return lc.load(folder / f"{name}.net")
    how = "hold" if framework == "sinabs" else None
    reset = next((reset for reset in RESETS if name.endswith(reset)), None)
    return lc.load(folder / f"{name}.nir", dt=STEP.get(framework), reset=reset, discretisation=how)


def depths(network: lc.Network) -> dict[str, int]:
    """Return the longest way from the input to each population."""
    pairs = {(p.source, p.target) for p in network.projections if not p.source.startswith("nir/")}
    layers = nx.topological_generations(nx.DiGraph((a, b) for a, b in pairs if a != b))
    return {name: depth for depth, names in enumerate(layers) for name in names}


@pytest.mark.parametrize(
    ("framework", "name"),
    [pytest.param(f, n, id=f"{f}-{n}") for f, names in NETWORKS.items() for n in names],
)
def test_we_spike_as_the_framework_does(framework, name, written):
    folder = written(framework)
    network = load(framework, name, folder)
    with np.load(folder / f"{name}.npz") as held:
        theirs = {
            key.removeprefix("out/"): held[key] for key in held.files if key.startswith("out/")
        }
        given = held["given"].astype(np.uint8)[None]
    reference = evaluate(network, given, potentials=True)
    chip = hw.simulate(lc.compile(network, events=given, diagnosis=False).program, given)
    depth_of = depths(network)
    compared = 0
    for population in network.populations:
        layer = population.name.removesuffix(".lif")
        if layer not in theirs:
            continue
        lag = 0 if framework == "lava-dl" else depth_of[population.name]
        expected = theirs[layer][: len(given[0]) - lag]
        if (
            population.name in network.readout.populations
            and network.readout.potentials_from is not None
        ):
            if framework != "lava-dl":  # potentials of slayer are in other units
                chip_agreement = reference.potential[population.name][0, lag:]
                np.testing.assert_allclose(chip_agreement, expected, atol=1e-5)
            continue
        np.testing.assert_array_equal(
            reference.spikes[population.name][0, lag:], expected, err_msg=population.name
        )
        chip_agreement = spike_agreement(chip.spikes[population.name][0, lag:], expected)
        if framework == "lava-dl" or depth_of[population.name] == 1:
            assert chip_agreement >= (1.0 if framework == "lava-dl" else CHIP_LEAST), (
                population.name
            )
        assert expected.sum() > LEAST_SPIKES
        compared += 1
    assert compared


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_numbers_through_the_host_spike_as_in_lava_dl(seed, tmp_path):
    if reason := why_missing("lava-dl"):
        pytest.skip(f"lava-dl: {reason}")
    script = SCRIPTS / "record_lava_dl_numbers.py"
    command = [str(python_of("lava-dl")), str(script), str(tmp_path), str(seed)]
    ran = subprocess.run(command, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    files = sorted(tmp_path.glob("*.npz"))
    assert len(files) == 5
    for file in files:
        with np.load(file) as arrays:
            held = dict(arrays)
        path = file.with_suffix(".net")
        path.write_bytes(held["net"].tobytes())
        network = lc.load(path, host_layers=1)
        events = recordings_for(network, held["inputs"]).spikes
        np.testing.assert_array_equal(events, held["layer0"], err_msg=file.stem)
        for name, spikes in evaluate(network, events).spikes.items():
            if name in held:
                np.testing.assert_array_equal(spikes, held[name], err_msg=f"{file.stem}, {name}")


CHAIN = (("input", "a", 0), ("a", "b", 0), ("b", "c", 0))
NEURONS = {
    "lif": {"decay_u": 1.0, "decay_v": 0.1, "threshold": 1.0},
    "cuba": {"decay_u": 0.3, "decay_v": 0.1, "threshold": 1.5},
    "if": {"decay_u": 1.0, "decay_v": 0.0, "threshold": 1.0},
}
OURS = {
    **{name: (name, CHAIN) for name in NEURONS},
    "lif-skip": ("lif", (*CHAIN, ("a", "c", 1))),
    "lif-recurrent": ("lif", (*CHAIN, ("b", "b", 0))),
    "cuba-recurrent": ("cuba", (*CHAIN, ("b", "b", 0))),
}
READ = {
    # Its reader takes no IF whose r is not 1, and none of our recurrent networks.
    "snntorch": ("lif", "cuba", "lif-skip"),
    # It leaves out the r of an LIF.
    "norse": ("cuba", "if", "cuba-recurrent"),
    "spikingjelly": tuple(OURS),
}


def our_network(kind: str, ways: Sequence[tuple[str, str, int]]) -> lc.Network:
    """Return a network of three populations, with connections (source, target, delay)."""
    rng, sizes = np.random.default_rng(0), {"input": 10, "a": 8, "b": 7, "c": 6}

    def onto(source, target, delay):
        scale = 0.2 if source == target else 0.6
        return Projection(
            source,
            target,
            matrix(rng.normal(0.1, scale, (sizes[target], sizes[source])), np.float64),
            delay,
        )

    neurons = {name: Cuba.of(sizes[name], **NEURONS[kind], rule=">") for name in "abc"}
    populations = tuple(lc.Population(name, "time", sizes[name], neurons[name]) for name in neurons)
    view, projections = lc.InputView("input", "time", 10), tuple(onto(*way) for way in ways)
    return lc.Network("ours", 10, 60, (view,), populations, projections, lc.Readout(("c",), (1.0,)))


@pytest.mark.parametrize("framework", READ)
def test_a_framework_spikes_as_the_network_that_we_write(framework, tmp_path):
    if reason := why_missing(framework):
        pytest.skip(f"{framework}: {reason}")
    given = (np.random.default_rng(3).random((60, 10)) < 0.25).astype(np.uint8)
    for name in READ[framework]:
        quantized = quantize(our_network(*OURS[name]), hw.chip("loihi-sim"))
        (tmp_path / f"{name}.nir").write_bytes(exchange_file("nir", quantized))
        np.save(tmp_path / f"{name}.npy", given)
    ran = subprocess.run([str(python_of(framework)), str(SCRIPTS / "read_nir.py"), framework, str(tmp_path)], capture_output=True, text=True)  # fmt: skip
    assert ran.returncode == 0, ran.stderr
    for name in READ[framework]:
        ours = evaluate(our_network(*OURS[name]), given[None]).spikes
        theirs = np.load(tmp_path / f"{name}.npz")
        for late, population in enumerate("abc", start=1):
            assert theirs[population].sum() > 10
            np.testing.assert_array_equal(
                ours[population][0, late:], theirs[population][:-late], err_msg=name
            )
