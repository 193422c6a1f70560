"""Draw programs of one to four phases, and recordings for them, from a seed.

A phase is a part of a recording's time on the chip; its steps go over time or over the recording's channels. Drawn are
phases that end before or after the recording, that begin at the first touch, or whose length is not stated; one or two
inputs per phase, from one or two streams, either as events arrive or through the transpose buffer; several channels
per step of the buffer; readouts of any populations, with weights whose sums depend on their order. Chips have registers
of any width.
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
"""Weights of readouts that the open core can add in integers."""
WIDTHS = [9, 10, 12, 15, 16, 21, 23, 31, 32, 40]
"""Bits of registers: those of the chips that ship (21, 23), and both sides of 16 and of 32 bits, where engines differ."""
SHAPES = [shape for shape in any_program.SHAPES if shape != "many"]
"""Ways to join compartments, except the one with so many that they do not fit on a core of ten."""


@dataclass(frozen=True, eq=False)
class Case:
    """A program, its graph, and its recordings: arrays (batch, steps, channels) by stream."""

    program: hw.ChipProgram
    graph: CompartmentGraph
    spikes: dict[str, np.ndarray]
    steps: int | None
    """Steps of the phases that do not state theirs; never None for recordings without rows."""

    @property
    def rows(self) -> int:
        return next(iter(self.spikes.values())).shape[1]

    @property
    def first(self) -> dict[str, np.ndarray]:
        """The first recording, (steps, channels) by stream."""
        return {name: array[0] for name, array in self.spikes.items()}

    @property
    def mixed(self) -> list[str]:
        """The phases that have both direct inputs and inputs through the transpose buffer."""
        names = []
        for phase in self.program.phases:
            is_direct = {item.positions is None for item in self.program.inputs_of(phase.name)}
            if len(is_direct) == 2:
                names.append(phase.name)
        return names


@cache
def _file_of_loihi() -> dict[str, Any]:
    """Return the chip file that others are drawn from; it is read once, for parsing takes longer than a short recording."""
    return yaml.safe_load(any_program.LOIHI.document)


def _chip(r: np.random.Generator, plain: bool) -> hw.Chip:
    """Draw a chip file and parse it; with ``plain`` the chip has the registers of the open core."""
    fields = deepcopy(_file_of_loihi())
    # Every compartment has drawn parameters, so it needs profiles and formats of its own.
    fields["limits"] |= {"compartment_profiles_per_core": 1024, "threshold_profiles_per_core": 1024}
    fields["limits"]["synapse_formats_per_core"] = 256
    if r.random() < 0.5:
        fields["limits"]["compartments_per_core"] = int(r.choice([8, 10, 13]))
    if r.random() < 0.5:
        # Tiles of one core on many small chips, so that packets have ways to go.
        columns = int(r.choice([1, 2, 4]))
        fields["mesh"] |= {"columns": columns, "rows": 4 // columns, "cores_per_tile": 1}
        fields["limits"]["cores_per_chip"], fields["chips"] = 4, 64
    if not plain and r.random() < 0.7:
        fields["registers"] |= {
            **{f"{name}_bits": int(r.choice(WIDTHS)) for name in ("charge", "current", "voltage")},
            "threshold_mantissa_bits": int(r.integers(1, 35)),
            "bias_mantissa_bits": int(r.integers(1, 25)),
            "bias_exponent_max": int(r.integers(25)),
            "refractory_max": int(r.choice([1, 2, 63, 65535])),
            "delay_max": int(r.choice([0, 1, 2, 62, 300])),
            "weight_bits_max": int(r.integers(1, 9)),
        }
    return parse_chip(yaml.safe_dump(fields), "drawn")


def _parameters(
    r: np.random.Generator, size: int, chip: hw.Chip, quiet: bool
) -> dict[str, np.ndarray]:
    """Draw the parameters of a population; ``quiet`` compartments rest where nothing arrives."""
    parameters = any_program.parameters(r, size, chip)
    if quiet:
        # Strong biases, or states that never decay, would let all compartments spike in every step.
        parameters |= {name: r.choice([4096, 2000, 390], size) for name in ("decay_u", "decay_v")}
        parameters["threshold"] = np.minimum(
            r.choice([0, 1, 30, 300], size), chip.registers.threshold_mantissa_max
        )
        parameters["bias"] = parameters["bias"] * int(r.random() < 0.4)
    return parameters


def _branch(
    r: np.random.Generator, chip: hw.Chip, name: str, lines: list[int], classes: int
) -> CompartmentGraph:
    """Draw the graph of one phase: populations, compartments that are joined to them, and synapses.

    ``lines[i]`` is the size of input i. Populations ``y`` and ``z`` have a compartment per class; up to two more have
    any size.
    """
    builder = hw.ProgramBuilder(chip)
    quiet = bool(r.random() < 0.5)
    limited = bool(r.random() < 0.5)  # whether voltages have narrower limits than their register
    senders = [builder.add_input(f"{name}/x{i}", n) for i, n in enumerate(lines)]
    targets = []
    for group in ["y", "z", *(f"h{i}" for i in range(r.integers(3)))]:
        size = classes if group in "yz" else int(r.integers(1, 4))
        voltage_limits = {}
        if limited:
            voltage_limits = {
                "vmin": int(r.choice(voltage_minima(chip.registers))),
                "vmax": int(r.choice(voltage_maxima(chip.registers))),
            }
        soma = builder.add_compartments(
            f"{name}/{group}", size, **_parameters(r, size, chip, quiet), **voltage_limits
        )
        senders.append(soma)
        shape = str(r.choice(["none", *SHAPES]))
        targets += [soma, *any_program.add_children(builder, soma, shape, chip, r, voltage_limits)]
    for _ in range(int(r.choice([0, 3, 6, 12]))):
        source = senders[int(r.integers(len(senders)))]
        target = targets[int(r.integers(len(targets)))]
        for _ in range(int(r.choice([1, 1, 2]))):
            any_program.connect(r, builder, source, target, chip)
    return builder.graph()


def _visits(
    r: np.random.Generator, channels: int, rows: int, steps: int
) -> tuple[int, dict[str, Any]]:
    """Draw in which step the transpose buffer plays each channel (a visit), and onto which lines.

    A visit plays ``rows`` rows of a channel at once, each onto a line of its own. Channels that share a step need
    different lines, so each step numbers its channels, and channel number k has the lines from ``k * rows`` on.

    Returns:
        The lines in all, and the fields of the input: ``positions`` (channels,) are steps, ``first_lines`` (channels,)
        lines.
    """
    if r.random() < 0.6:
        positions = r.integers(0, steps, channels)
        number_in_step = np.array(
            [np.count_nonzero(positions[:c] == step) for c, step in enumerate(positions)]
        )
    else:
        positions = np.full(channels, r.integers(steps))
        number_in_step = r.permutation(channels)
    # One channel per step needs no first lines; None and zeros must then mean the same.
    omitted = not number_in_step.any() and r.random() < 0.3
    first_lines = None if omitted else number_in_step * rows
    lines = (int(number_in_step.max()) + 1) * rows
    return lines, {"positions": positions, "first_lines": first_lines}


def _phase(
    r: np.random.Generator,
    name: str,
    rows: int,
    streams: dict[str, int],
    touches: list[int],
    alike: bool,
) -> tuple[Phase, list[int], list[dict[str, Any]]]:
    """Draw a phase, the number of lines of each of its inputs, and the stream and visits of each input.

    ``streams`` gives the channels of each stream. ``touches`` are the numbers of events in a row that may begin the
    phase. With ``alike`` its transposed inputs hear equally many rows, as the open core's do.
    """
    axis = str(r.choice(AXES))
    mixed = bool(r.random() < 0.1)
    steps = None if r.random() < 0.4 else int(r.choice([1, 2, 5, rows + 1, max(rows, 1), 60]))
    align = None if mixed or r.random() < 0.5 else int(r.choice(touches))
    lines = []
    feeds = []
    rows_heard = [1, 2, max(rows, 1), rows + 3, max(1, rows - 2)]
    if alike:
        rows_heard = [int(r.choice(rows_heard))]
    for i in range(int(r.choice([1, 1, 2]))):
        stream = str(r.choice(list(streams)))
        channels = streams[stream]
        size = channels
        visits = {}
        # Phases over channels read the buffer, phases over time do not; the second input of a mixed phase is the other.
        is_transposed = (axis == "location") != (mixed and i == 1)
        if is_transposed:
            size, visits = _visits(
                r,
                channels,
                int(r.choice(rows_heard)),
                steps or int(r.choice([1, channels, channels + 5])),
            )
        lines.append(size)
        feeds.append({"stream": stream, **visits})
    return Phase(name, axis, steps, align), lines, feeds


def _readout(r: np.random.Generator, names: list[str], plain: bool) -> Readout:
    """Draw a readout of some populations in any order, by spikes, or by potentials from a step on."""
    populations = [str(name) for name in r.permutation(names)[: int(r.integers(1, len(names) + 1))]]
    weights = np.ones(len(populations))
    if r.random() < 0.6:
        weights = r.choice(PLAIN_WEIGHTS if plain else WEIGHTS, len(populations))
    potentials_from: int | tuple[int | None, ...] | None = None
    if not plain and r.random() < 0.4:
        potentials_from = tuple(
            None if r.random() < 0.4 else int(r.choice([0, 1, 3, 100])) for _ in populations
        )
    elif r.random() < 0.2:
        potentials_from = int(r.choice([0, 1, 3, 100]))
    return Readout(tuple(populations), tuple(weights.tolist()), potentials_from)


@lru_cache(maxsize=64)
def case(seed: int, plain: bool = False) -> Case:
    """Return :func:`drawn` from a cache: several tests play the same seeds, and drawing takes longer than playing."""
    return drawn(seed, plain)


def drawn(seed: int, plain: bool = False) -> Case:
    """Draw a program of one to four phases and up to nine recordings for it.

    With ``plain`` the open core can run most of them: registers of its widths, equal alignment of all phases.
    """
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
"""Seeds of programs that take the reference engine long."""

QUICK = [seed for seed in range(36) if seed not in LARGE]
"""Seeds for tests that every run takes."""

MANY = [*LARGE, *range(36, 200)]
"""Seeds for slow tests."""

FEW_ON_CORE = (8, 10, 15, 17, 22, 25, 29, 30, 33, 35, 38, 39)
"""Seeds of programs that the core runs, short enough for Icarus Verilog."""
