"""Three programs so small that their energy and time are worked out by hand, with the working next to the figures.

The constants are those of the chip file ``loihi-sim`` for its two cost profiles, in picojoules and nanoseconds.
All compartments forget at once (decays 4096), so that one input spike makes one output spike. A compartment is active
in the step in which a charge arrives and in the next, in which its current decays to 0.
"""

from dataclasses import dataclass, replace

import numpy as np

import hw_model as hw
from tests.support.hybrids import CHIP, graph_in_phase, program_of_graphs
from tests.support.register_units import FORGETS_AT_ONCE

FORGETS = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE, "threshold": 10}


@dataclass(frozen=True)
class Worked:
    """A program, its recording, and by cost profile: its energy, the time of each phase, and the time after the last row."""

    program: hw.ChipProgram
    recording: np.ndarray
    pj: dict[str, float]
    phase_ns: dict[str, dict[str, float]]
    after_last_row_ns: dict[str, float]


def chain() -> Worked:
    """x -> a -> b on one core, four steps, one event in the first.

    ====  =======================  =========================  ==================
    step  active / at rest         spikes, packets in tile    synapses
    ====  =======================  =========================  ==================
    0     0 / 2                    input packet 1             x -> a
    1     1 / 1  (a)               a, 1 packet                a -> b
    2     2 / 0  (a once more, b)  b, which has no target
    3     1 / 1  (b once more)
    ====  =======================  =========================  ==================
    """
    builder = hw.ProgramBuilder(CHIP, name="chain")
    x = builder.add_input("x", 1)
    a = builder.add_compartments("a", 1, **FORGETS)
    b = builder.add_compartments("b", 1, **FORGETS)
    builder.connect(x, a, [[20]])
    builder.connect(a, b, [[20]])
    # Each step: updates of active compartments (8.4 ns) and of those at rest (5.3), packets, synapses; then the
    # barrier at which tiles wait for each other (113 for one tile).
    davies = (
        (5.3 * 2 + 3.5)  # both at rest, one synapse
        + (8.4 + 5.3 + 2.1 + 3.5)  # a active, b at rest, a packet within the tile, one synapse
        + (8.4 * 2)  # both active
        + (8.4 + 5.3)  # b active, a at rest
        + 4 * 113.0  # four barriers
    )
    sanafe = (
        (6.0 * 2 + 16.0 + 4.7)  # two visits, the input packet, one synapse
        # a updated, spikes, its packet out and in, one synapse
        + (6.0 * 2 + 3.7 + 30.0 + 5.1 + 16.0 + 4.7)
        + (6.0 * 2 + 3.7 * 2 + 30.0)  # both updated, b spikes
        + (6.0 * 2 + 3.7)  # b updated
        + 4 * 600.0  # four barriers
    )
    return Worked(
        builder.build(),
        np.array([[1], [0], [0], [0]]),
        pj={
            # 2 synapses, 4 active updates, 4 updates at rest, 1 packet within the tile
            "davies2018": 2 * 23.6 + 4 * 81.0 + 4 * 52.0 + 1 * 1.7,
            # 2 synapses, 8 visits of compartments, 4 updates, 2 spikes, 1 packet
            "sanafe": 2 * 35.5 + 8 * 51.2 + 4 * 21.6 + 2 * 69.3 + 1 * 111.0,
        },
        phase_ns={"davies2018": {"time": davies}, "sanafe": {"time": sanafe}},
        after_last_row_ns={"davies2018": 8.4 + 5.3 + 113.0, "sanafe": 6.0 * 2 + 3.7 + 600.0},
    )


def crossroads() -> Worked:
    """x -> first -> three others, one compartment per core and one core per tile of a mesh of 3 by 2, three steps.

    Tiles: first (0, 0), others (1, 0), (2, 0) and (0, 1). The spike of step 1 sends three packets: two over the link
    from (0, 0) to (1, 0), one of them on to (2, 0), and one over the link to (0, 1). Where two share a link, each is
    assumed to wait for the other, for the time of one hop. The farthest core finishes last.
    """
    chip = replace(
        CHIP,
        limits=replace(CHIP.limits, compartments_per_core=1, cores_per_chip=6),
        mesh=replace(CHIP.mesh, columns=3, rows=2, cores_per_tile=1),
    )
    builder = hw.ProgramBuilder(chip, name="crossroads")
    x = builder.add_input("x", 1)
    first = builder.add_compartments("first", 1, **FORGETS)
    others = builder.add_compartments("others", 3, **FORGETS)
    builder.connect(x, first, [[20]])
    builder.connect(first, others, [[20], [20], [20]])
    mesh = 2 * 4.1 + 4.1  # two hops east, and a wait on the first
    davies = (
        (5.3 + 3.5)  # first at rest, and its synapse
        + (8.4 + mesh + 3.5)  # first active; at (2, 0) one synapse
        + 8.4  # all active
        # The barrier grows linearly from one tile (113) to all six (465); four take part.
        + 3 * (113.0 + 3 / 5 * (465.0 - 113.0))
    )
    sanafe = (
        (6.0 + 16.0 + 4.7)
        + (6.0 + 3.7 + 30.0 + 3 * 5.1 + mesh + 16.0 + 4.7)
        + (6.0 + 3.7 + 30.0)  # the others spike, without a target
        + 3 * (600.0 + 3 / 5 * 1200.0)
    )
    # Placing keeps the order of the groups, so `first` lies on core 0, unlike in a program that the builder optimises.
    program = program_of_graphs(chip, None, builder.graph())
    return Worked(
        program,
        np.array([[1], [0], [0]]),
        pj={
            # 1 + 3 synapses; first is active in two steps and the others in one: 5 of 12 updates; 3 hops east, 1 south.
            "davies2018": 4 * 23.6 + 5 * 81.0 + 7 * 52.0 + 3 * 3.0 + 1 * 4.0,
            "sanafe": 4 * 35.5 + 12 * 51.2 + 5 * 21.6 + 4 * 69.3 + 3 * 111.0 + 3 * 3.0 + 1 * 4.2,
        },
        phase_ns={"davies2018": {"time": davies}, "sanafe": {"time": sanafe}},
        after_last_row_ns={
            "davies2018": 8.4 + 113.0 + 0.6 * 352.0,
            "sanafe": 39.7 + 600.0 + 0.6 * 1200.0,
        },
    )


def hybrid() -> Worked:
    """Two channels, three rows: a neuron of a time phase, and one of a location phase that visits channel 1 first.

    Events (row, channel): (0, 0), (2, 0), (2, 1). The buffer plays line 2 at location step 0, and lines 0 and 2 at
    step 1; at 1 GHz each event read takes 1 ns. Neither neuron has a target.
    """

    def branch(axis: str, lines: int) -> hw.ProgramBuilder:
        builder = hw.ProgramBuilder(CHIP, name="hybrid")
        x = builder.add_input(f"{axis}/x", lines)
        builder.connect(x, builder.add_compartments(f"{axis}/y", 1, **FORGETS), [[20] * lines])
        return builder

    program = program_of_graphs(
        CHIP,
        None,
        graph_in_phase(branch("time", 2).graph(), "time", 3),
        graph_in_phase(branch("location", 3).graph(), "location", steps=2, positions=[1, 0]),
    )
    davies = {
        "time": (5.3 + 3.5) + 8.4 + (8.4 + 2 * 3.5) + 3 * 113.0,
        "location": (5.3 + 1.0 + 3.5) + (8.4 + 2.0 + 2 * 3.5) + 2 * 113.0,
    }
    sanafe = {
        # step 1: updated and spikes; step 2: once more updated, and two input packets
        "time": (6.0 + 16.0 + 4.7)
        + (6.0 + 3.7 + 30.0)
        + (6.0 + 3.7 + 2 * (16.0 + 4.7))
        + 3 * 600.0,
        "location": (6.0 + 1.0 + 16.0 + 4.7)
        + (6.0 + 3.7 + 30.0 + 2.0 + 2 * (16.0 + 4.7))
        + 2 * 600.0,
    }
    return Worked(
        program,
        np.array([[1, 0], [0, 0], [1, 1]]),
        pj={
            "davies2018": (3 + 3) * 23.6 + (2 + 1) * 81.0 + (1 + 1) * 52.0,
            "sanafe": 6 * 35.5 + 5 * 51.2 + 3 * 21.6 + 2 * 69.3,
        },
        phase_ns={"davies2018": davies, "sanafe": sanafe},
        # the step of the last row, then the whole location phase
        after_last_row_ns={
            "davies2018": 8.4 + 2 * 3.5 + 113.0 + davies["location"],
            "sanafe": 6.0 + 3.7 + 2 * 20.7 + 600.0 + sanafe["location"],
        },
    )
