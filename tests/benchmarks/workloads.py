"""The networks and inputs that every simulator is timed on: layers of CUBA-LIF neurons, and recordings to play to them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hw_model as hw
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.frontends import load
from locsnn_compile.pipeline import Levels, lower

ROOT = Path(__file__).parents[2]
RECORDINGS = ROOT.parent / "shared/data/neutouch"
"""Ev-Objects.zip and Ev-Containers.zip; see the README for where they come from."""
PEER_RECORDINGS = 32
"""Recordings that a peer gets: one batch for tools that play batches."""

IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class LayeredNetwork:
    """Layers in a row, one compartment per neuron, with the chip's reset.

    ``weights``: for each layer, even mantissas (n, n of the layer before). ``thresholds``: a mantissa per layer. The decays, in
    4096ths, are those of all neurons. ``recordings``: (batch, steps, lines) of 0 and 1.
    """

    weights: tuple[IntArray, ...]
    thresholds: tuple[int, ...]
    decay_u: int
    decay_v: int
    recordings: NDArray[np.uint8]

    @property
    def sizes(self) -> tuple[int, ...]:
        """Neurons of the layers, without the input."""
        return tuple(len(matrix) for matrix in self.weights)

    def program(self) -> hw.ChipProgram:
        """Return the network as a program."""
        builder = hw.ProgramBuilder(hw.chip("loihi-sim"))
        before = builder.add_input("x", self.recordings.shape[2])
        for name, weights, threshold in zip(
            layer_names(self), self.weights, self.thresholds, strict=True
        ):
            parameters = {"decay_u": self.decay_u, "decay_v": self.decay_v, "threshold": threshold}
            here = builder.add_compartments(name, len(weights), **parameters)
            builder.connect(before, here, weights)
            before = here
        return builder.build()

    def job(self) -> dict[str, Any]:
        """Return the network as the drivers in ``tests/peers`` read it, but with ``recordings`` instead of ``spikes``."""
        names = layer_names(self)
        populations = [
            {
                "name": name, "size": size, "decay_u": [self.decay_u] * size, "decay_v": [self.decay_v] * size,
                "threshold": [threshold] * size, "bias": [0] * size, "refractory": [1] * size,
                "vmin": 1 - 2**23, "vmax": 2**23 - 1,
            }
            for name, size, threshold in zip(names, self.sizes, self.thresholds, strict=True)
        ]  # fmt: skip
        projections = [
            {
                "source": source, "target": to, "weights": weights, "delay": [[0]], "exponent": 0, "weight_bits": 8,
                "sign_mode": "mixed",
            }
            for source, to, weights in zip(["x", *names], names, self.weights, strict=False)
        ]  # fmt: skip
        return {
            "populations": populations,
            "projections": projections,
            "recordings": self.recordings,
        }


@dataclass(frozen=True, eq=False)
class Workload:
    """One or more networks that play the same recordings one after the other; their times are added up."""

    name: str
    text: str
    networks: tuple[LayeredNetwork, ...]

    def write_job(self, path: Path) -> None:
        """Write the file that ``peer_worker.py`` reads: arrays, and the rest as JSON; arrays as JSON would be slow to read."""
        jobs = [network.job() for network in self.networks]
        arrays = {}
        for n, job in enumerate(jobs):
            arrays[f"{n}/recordings"] = job.pop("recordings")[:PEER_RECORDINGS]
            for k, projection in enumerate(job["projections"]):
                arrays[f"{n}/{k}"] = projection.pop("weights")
        np.savez(path, jobs=json.dumps(jobs), **arrays)


def layer_names(network: LayeredNetwork) -> list[str]:
    """Return the names of the layers."""
    return [f"layer{k}" for k in range(len(network.weights))]


def random_network(
    sizes: tuple[int, ...], *, steps: int, rate: float, threshold: int, batch: int, seed: int = 0
) -> LayeredNetwork:
    """Draw even 8-bit weights, -254 to 254, and inputs that spike with probability ``rate`` per step."""
    r = np.random.default_rng(seed)
    shapes = zip(sizes[1:], sizes, strict=False)
    return LayeredNetwork(
        weights=tuple(2 * r.integers(-127, 128, shape) for shape in shapes),
        thresholds=(threshold,) * (len(sizes) - 1),
        decay_u=1024,
        decay_v=128,
        recordings=(r.random((batch, steps, sizes[0])) < rate).astype(np.uint8),
    )


def small() -> Workload:
    """Return a network of the size that tactile sensing uses."""
    network = random_network((156, 32, 20), steps=325, rate=0.03, threshold=1000, batch=256)
    return Workload("small", "156-32-20, 325 steps, 3 % input", (network,))


def large() -> Workload:
    """Return a network whose synapses do not fit the caches that a core has for itself."""
    network = random_network((1024, 1024, 1024, 10), steps=200, rate=0.02, threshold=4000, batch=64)
    return Workload("large", "1024-1024-1024-10, 200 steps, 2 % input", (network,))


def hybrid_equivalent(example: str) -> Workload:
    """Return the two branches of an example as CUBA-LIF networks on its test recordings.

    No peer has joined compartments, so the compartment with a neuron's alpha kernel stands alone and resets. Layers, decays,
    steps and recordings are the example's. Its weights are rounded to the grid that all peers have, at a scale at which nothing
    clips. So spikes are not the example's. The location branch plays the transposed recordings.
    """
    levels = example_levels(example)
    recordings = published_test_part(example).spikes
    branches = tuple(_branch(levels, axis, recordings) for axis in ("time", "location"))
    return Workload(
        example, f"the branches of {example}-hybrid, {len(recordings)} test recordings", branches
    )


def _branch(levels: Levels, axis: str, recordings: NDArray[np.uint8]) -> LayeredNetwork:
    """Return a branch of a hybrid as layers of single compartments; a neuron's kernel is in the group ``NAME/dendrite``."""
    graph = levels.compartments
    groups = {group.name: group for group in graph.groups}
    view = next(view for view in levels.network.views if view.axis == axis)
    names = [f"{axis}_hidden", f"{axis}_output"]
    weights = []
    for name in names:
        incoming = [s for s in graph.synapses if s.target == f"{name}/dendrite"]
        sources = view.lines if incoming[0].source == view.name else groups[incoming[0].source].size
        effective = np.zeros((groups[name].size, sources))
        for s in incoming:
            effective[s.target_index, s.source_index] += s.mantissa * 2.0**s.exponent
        weights.append(2 * np.rint(effective / SCALE_DOWN / 2).astype(np.int64))
    decay = int(groups[f"{names[0]}/dendrite"].decay_u[0])
    return LayeredNetwork(
        weights=tuple(weights),
        thresholds=tuple(int(groups[name].threshold[0]) // SCALE_DOWN for name in names),
        decay_u=decay,
        decay_v=decay,
        recordings=view.play(recordings),
    )


def example_levels(example: str) -> Levels:
    """Return a hybrid that ships, compiled at 8 bits, with all levels of the compiler."""
    return lower(
        load(ROOT / f"examples/models/{example}-hybrid.pt"), hw.chip("loihi-sim"), weight_bits=8
    )


SCALE_DOWN = 4
"""Weights and thresholds of an example are divided by this: they then fit the grid, and no voltage clips."""


def published_test_part(example: str) -> Recordings:
    """Return the test part of the published recordings of an example."""
    return read_recordings(RECORDINGS / f"Ev-{example.title()}.zip")


WORKLOADS: Mapping[str, Callable[[], Workload]] = {
    "small": small,
    "large": large,
    "objects": lambda: hybrid_equivalent("objects"),
    "containers": lambda: hybrid_equivalent("containers"),
}
