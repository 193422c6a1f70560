"""Programs of one to four phases over both step axes, from a seed, and recordings for them.

Phases that end before the recording or after it, that begin at the first touch, or whose length nothing says; one or two
inputs a phase from one or two streams, as they come or through the transpose buffer; visits of several channels at a
step; readouts of any populations with weights whose sums depend on their order. Chips have registers of any width.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np
import yaml

import hw_model as hw
from hw_model.arithmetic.loihi import voltage_maxima, voltage_minima
from hw_model.description.chip import parse_chip
from hw_model.mapping.check_graph import check_graph
from hw_model.mapping.graph import AXES, CompartmentGraph, Phase, Readout
from tests.support import any_program, hybrids

WEIGHTS = [0.0, -0.0, 1.0, -1.0, 0.1, 0.2, 0.3, -0.7, 1e-300, 1e100, 3.5, 1 / 3, 1e16, -1e16]
"""Weights of readouts; sums of several depend on their order."""
PLAIN_WEIGHTS = [0.0, 1.0, 2.0, -1.0, -0.5, 3.5]
"""Those that the open core can add in integers."""
WIDTHS = [9, 10, 12, 15, 16, 21, 23, 31, 32, 40]
SHAPES = [shape for shape in any_program.SHAPES if shape != "many"]
"""Ways to join compartments, of so few that they fit on a core of ten."""


@dataclass(frozen=True, eq=False)
class Case:
    """A program, the graph that it was made of, and recordings by stream, (batch, steps, channels)."""

    program: hw.ChipProgram
    graph: CompartmentGraph
    spikes: dict[str, np.ndarray]
    steps: int | None
    """Asked for, of phases that do not say theirs; never None for recordings without rows."""

    @property
    def rows(self) -> int:
        return next(iter(self.spikes.values())).shape[1]

    @property
    def first(self) -> dict[str, np.ndarray]:
        """The first recording, (steps, channels) by stream."""
        return {name: array[0] for name, array in self.spikes.items()}

    @property
    def mixed(self) -> list[str]:
        """The phases that hear inputs both as they come and through the transpose buffer."""
        kinds = {
            p.name: {i.positions is None for i in self.program.inputs_of(p.name)}
            for p in self.program.phases
        }
        return [name for name, kind in kinds.items() if len(kind) == 2]


@cache
def _file_of_loihi() -> dict[str, Any]:
    """The chip file that others are drawn from, read once: YAML in Python takes longer than a short recording."""
    return yaml.safe_load(any_program.LOIHI.document)


def _chip(r: np.random.Generator, plain: bool) -> hw.Chip:
    """A chip as its file would give it; with ``plain`` it has the registers that the open core has."""
    text = deepcopy(_file_of_loihi())
    text["limits"] |= {"compartment_profiles_per_core": 1024, "threshold_profiles_per_core": 1024}
    text["limits"]["synapse_formats_per_core"] = 256
    if r.random() < 0.5:
        text["limits"]["compartments_per_core"] = int(r.choice([8, 10, 13]))
    if r.random() < 0.5:
        # Tiles of one core on many small chips, so that packets have ways to go.
        columns = int(r.choice([1, 2, 4]))
        text["mesh"] |= {"columns": columns, "rows": 4 // columns, "cores_per_tile": 1}
        text["limits"]["cores_per_chip"], text["chips"] = 4, 64
    if not plain and r.random() < 0.7:
        text["registers"] |= {
            **{f"{name}_bits": int(r.choice(WIDTHS)) for name in ("charge", "current", "voltage")},
            "threshold_mantissa_bits": int(r.integers(1, 35)),
            "bias_mantissa_bits": int(r.integers(1, 25)),
            "bias_exponent_max": int(r.integers(25)),
            "refractory_max": int(r.choice([1, 2, 63, 65535])),
            "delay_max": int(r.choice([0, 1, 2, 62, 300])),
            "weight_bits_max": int(r.integers(1, 9)),
        }
    return parse_chip(yaml.safe_dump(text), "drawn")


def _parameters(
    r: np.random.Generator, size: int, chip: hw.Chip, quiet: bool
) -> dict[str, np.ndarray]:
    given = any_program.parameters(r, size, chip)
    if quiet:
        # Few biases, and nothing that stays: or all spike in every step, and no phase would hear another's silence.
        given |= {name: r.choice([4096, 2000, 390], size) for name in ("decay_u", "decay_v")}
        given["threshold"] = np.minimum(
            r.choice([0, 1, 30, 300], size), chip.registers.threshold_mantissa_max
        )
        given["bias"] = given["bias"] * int(r.random() < 0.4)
    return given


def _branch(
    r: np.random.Generator, chip: hw.Chip, name: str, lines: list[int], classes: int
) -> CompartmentGraph:
    """Populations ``y`` and ``z`` of so many classes and up to two more, with what is joined to them, and synapses."""
    builder = hw.ProgramBuilder(chip)
    quiet = bool(r.random() < 0.5)
    narrow = bool(r.random() < 0.5)
    senders = [builder.add_input(f"{name}/x{i}", n) for i, n in enumerate(lines)]
    targets = []
    for group in ["y", "z", *(f"h{i}" for i in range(r.integers(3)))]:
        size = classes if group in "yz" else int(r.integers(1, 4))
        kept = {}
        if narrow:
            kept = {
                "vmin": int(r.choice(voltage_minima(chip.registers))),
                "vmax": int(r.choice(voltage_maxima(chip.registers))),
            }
        soma = builder.add_compartments(
            f"{name}/{group}", size, **_parameters(r, size, chip, quiet), **kept
        )
        senders.append(soma)
        shape = str(r.choice(["none", *SHAPES]))
        targets += [soma, *any_program.add_children(builder, soma, shape, chip, r, kept)]
    for _ in range(int(r.choice([0, 3, 6, 12]))):
        source = senders[int(r.integers(len(senders)))]
        target = targets[int(r.integers(len(targets)))]
        for _ in range(int(r.choice([1, 1, 2]))):
            any_program.connect(r, builder, source, target, chip)
    return builder.graph()


def _visits(
    r: np.random.Generator, channels: int, rows: int, steps: int
) -> tuple[int, dict[str, Any]]:
    """The lines that the transpose buffer fills, and when: channels of one step have lines of their own."""
    if r.random() < 0.6:
        positions = r.integers(0, steps, channels)
        number = np.array([np.count_nonzero(positions[:c] == at) for c, at in enumerate(positions)])
    else:
        positions = np.full(channels, r.integers(steps))
        number = r.permutation(channels)
    alone = not number.any() and r.random() < 0.3
    visits = {"positions": positions, "first_lines": None if alone else number * rows}
    return (int(number.max()) + 1) * rows, visits


def _phase(
    r: np.random.Generator,
    name: str,
    rows: int,
    streams: dict[str, int],
    touches: list[int],
    alike: bool,
) -> tuple[Phase, list[int], list[dict[str, Any]]]:
    """A phase, the lines of each of its inputs, and what each input hears of which stream.

    ``touches``: so many events may begin it; ``alike``: its inputs hear equally many rows.
    """
    axis = str(r.choice(AXES))
    mixed = bool(r.random() < 0.1)
    steps = None if r.random() < 0.4 else int(r.choice([1, 2, 5, rows + 1, max(rows, 1), 60]))
    align = None if mixed or r.random() < 0.5 else int(r.choice(touches))
    lines = []
    feeds = []
    heard = [1, 2, max(rows, 1), rows + 3, max(1, rows - 2)]
    if alike:
        heard = [int(r.choice(heard))]
    for i in range(int(r.choice([1, 1, 2]))):
        stream = str(r.choice(list(streams)))
        channels = streams[stream]
        size = streams[stream]
        visits = {}
        if (axis == "location") != (mixed and i == 1):
            size, visits = _visits(
                r,
                channels,
                int(r.choice(heard)),
                steps or int(r.choice([1, channels, channels + 5])),
            )
        lines.append(size)
        feeds.append({"stream": stream, **visits})
    return Phase(name, axis, steps, align), lines, feeds


def _readout(r: np.random.Generator, names: list[str], plain: bool) -> Readout:
    """Some of the populations in any order, by spikes or potentials."""
    read = [str(name) for name in r.permutation(names)[: int(r.integers(1, len(names) + 1))]]
    weights = (
        r.choice(PLAIN_WEIGHTS if plain else WEIGHTS, len(read))
        if r.random() < 0.6
        else np.ones(len(read))
    )
    first: int | tuple[int | None, ...] | None = None
    if not plain and r.random() < 0.4:
        first = tuple(None if r.random() < 0.4 else int(r.choice([0, 1, 3, 100])) for _ in read)
    elif r.random() < 0.2:
        first = int(r.choice([0, 1, 3, 100]))
    return Readout(tuple(read), tuple(weights.tolist()), first)


@lru_cache(maxsize=64)
def case(seed: int, plain: bool = False) -> Case:
    """Return :func:`drawn`, and keep it: several tests play the same seeds, and to draw one takes longer than to play."""
    return drawn(seed, plain)


def drawn(seed: int, plain: bool = False) -> Case:
    """A program of several phases and up to nine recordings for it; with ``plain`` mostly one that the open core has."""
    r = np.random.default_rng(seed)
    chip = _chip(r, plain)
    rows = int(r.choice([0, 1, 1, 2, 3, 7, 20, 40, 70]))
    streams = {f"s{i}": int(r.choice([1, 1, 2, 5, 9])) for i in range(int(r.integers(1, 3)))}
    classes = int(r.integers(1, 4))
    graphs = []
    touches = [1, 1, 2, 4, 1000]
    if plain:
        touches = [int(r.choice(touches))]
    for i in range(int(r.choice([1, 2, 2, 3, 4]))):
        phase, lines, feeds = _phase(r, f"p{i}", rows, streams, touches, plain)
        graphs.append(hybrids.moved(_branch(r, chip, phase.name, lines, classes), phase, *feeds))
    readout = _readout(
        r, [f"{graph.phases[0].name}/{name}" for graph in graphs for name in "yz"], plain
    )
    graph = replace(hybrids.graphs_side_by_side(*graphs), readout=readout)
    check_graph(graph, chip)
    program = hybrids.program_of_graphs(chip, readout, *graphs)
    batch = int(r.choice([1, 1, 2, 3, 9]))
    density = r.choice([0, 0.02, 0.1, 0.5, 1], (batch, 1, 1))
    spikes = {
        name: (r.random((batch, rows, n)) < density).astype(np.uint8)
        for name, n in program.streams.items()
    }
    steps = int(r.choice([1, 3, 50])) if rows == 0 or r.random() < 0.3 else None
    return Case(program, graph, spikes, steps)


LARGE = (1, 9)
"""Seeds of programs that the reference engine takes long for."""


QUICK = [seed for seed in range(36) if seed not in LARGE]


MANY = [*LARGE, *range(36, 200)]


FEW_ON_CORE = (8, 10, 15, 17, 22, 25, 29, 30, 33, 35, 38, 39)
"""Seeds of programs that the core runs, short enough for Icarus Verilog."""
