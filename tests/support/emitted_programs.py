"""Programs for the tests of the emitters, on small chips, so that a few compartments fill several cores and tiles.

An emitter writes a program as files for another tool.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import hw_model as hw
from hw_model.mapping.graph import CompartmentGraph, Compartments, Input, Phase, Synapses, read_only
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble

CHIP = hw.chip("loihi-sim")


def small_chip(compartments=6, cores_per_tile=1, columns=2, rows=2):
    """Return the chip with few compartments per core and few cores per tile."""
    return replace(
        CHIP,
        limits=replace(
            CHIP.limits,
            compartments_per_core=compartments,
            cores_per_chip=cores_per_tile * columns * rows,
        ),
        mesh=replace(CHIP.mesh, columns=columns, rows=rows, cores_per_tile=cores_per_tile),
    )


def everything(seed=0, chip=None):
    """Return a program with delays, biases, refractory steps, joined compartments and all kinds of weight formats."""
    r = np.random.default_rng(seed)
    chip = chip or small_chip()
    b = hw.ProgramBuilder(chip, name="everything")
    x = b.add_input("x", 9)
    y = b.add_input("y", 3)
    names = {"h": 7, "o": 5}
    nodes = {}
    for name, size in names.items():
        # The first compartment keeps almost all of its current, so that it grows until it wraps.
        decay_u = np.append(1, r.integers(0, 4097, size - 1))
        nodes[name] = b.add_compartments(
            name,
            size,
            decay_u=decay_u,
            decay_v=r.integers(0, 4097, size),
            threshold=r.integers(0, 3, size) * 150,
            bias=r.choice([0, 0, 64, -128, 4095 << 7], size),
            refractory=r.integers(1, 4, size),
            vmin=-((1 << 20) - 1),
            vmax=(1 << 21) - 1,
        )
    child = b.add_compartments(
        "o/dendrite",
        5,
        decay_u=300,
        decay_v=r.integers(0, 4097, 5),
        threshold=0,
        joined_to=nodes["o"],
        vmin=-((1 << 20) - 1),
        vmax=(1 << 21) - 1,
    )

    def weights(shape, step, low, high):
        """Draw weights from low to high that are multiples of a format's step, about 40 % of them 0."""
        drawn = r.integers(low // step, high // step + 1, shape) * step
        drawn[r.random(shape) < 0.4] = 0
        return drawn

    b.connect(
        x, nodes["h"], weights((7, 9), step=2, low=-256, high=254), delay=r.integers(0, 6, (7, 9))
    )
    b.connect(
        x,
        nodes["h"],
        weights((7, 9), step=8, low=0, high=248),
        exponent=-2,
        weight_bits=5,
        sign_mode="excitatory",
    )
    b.connect(y, child, np.full((5, 3), -64), exponent=3, weight_bits=4, sign_mode="inhibitory")
    b.connect(y, nodes["o"], np.full((5, 3), 255), sign_mode="excitatory", delay=62)
    strong = np.zeros((7, 3), dtype=np.int64)
    strong[0] = 254
    b.connect(y, nodes["h"], strong, exponent=7)
    b.connect(
        nodes["h"],
        nodes["h"],
        weights((7, 7), step=256, low=-256, high=0),
        exponent=1,
        weight_bits=1,
    )
    b.connect(
        nodes["h"],
        child,
        weights((5, 7), step=1, low=-255, high=0),
        weight_bits=8,
        sign_mode="inhibitory",
    )
    b.connect(
        nodes["h"], nodes["o"], weights((5, 7), step=16, low=-256, high=240), weight_bits=5, delay=3
    )
    b.connect(nodes["o"], nodes["h"], weights((7, 5), step=2, low=-256, high=254))
    b.read_out(nodes["o"])
    return b.build()


def played_streams(program, steps=40, rate=0.3, seed=0):
    """Return random spikes for every stream of a program, (steps, channels)."""
    r = np.random.default_rng(seed)
    return {
        name: (r.random((steps, n)) < rate).astype(np.uint8) for name, n in program.streams.items()
    }


def two_phases(align_events=None, bias=0):
    """Return a program of a time phase and a location phase with a neuron each, for four channels and five time steps.

    The location phase visits the channels in the order 2, 1, 3, 0.
    """

    def column(value):
        return read_only([value])

    def neuron(name, phase):
        return Compartments(
            name=name,
            phase=phase,
            size=1,
            decay_u=column(4096),
            decay_v=column(128),
            threshold=column(100),
            bias_mantissa=column(bias),
            bias_exponent=column(0),
            refractory=column(1),
            vmin=column(-CHIP.registers.voltage_max),
            vmax=column(CHIP.registers.voltage_max),
        )

    def synapses_onto(group, item):
        return Synapses(
            source=item.name,
            target=group.name,
            source_index=read_only(range(item.size)),
            target_index=read_only([0] * item.size),
            mantissa=read_only([60] * item.size),
            delay=read_only([0] * item.size),
            exponent=0,
            weight_bits=8,
            sign_mode="mixed",
        )

    groups = (neuron("a", "time"), neuron("b", "location"))
    inputs = (
        Input("x", size=4, phase="time", stream="x"),
        Input("xt", size=5, phase="location", stream="x", positions=read_only([3, 1, 0, 2])),
    )
    synapses = tuple(synapses_onto(group, item) for group, item in zip(groups, inputs, strict=True))
    phases = (
        Phase("time", "time", steps=5, align_events=align_events),
        Phase("location", "location", steps=4, align_events=align_events),
    )
    graph = CompartmentGraph("two phases", phases, inputs, groups, synapses)
    return assemble(route_axons(place_cores(graph, CHIP)))
