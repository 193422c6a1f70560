"""Sessions replay a location phase from the first step that a new row changes: against the plain engine.

Each row of a recording adds events to steps of the phase that have run before, so the session runs it again from there.
:data:`PHASES` are small phases for every way in which it does so, with registers at their limits.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.mapping.graph import Readout
from tests.support.hybrids import CHIP, graph_in_phase, program_of_graphs
from tests.support.register_units import FORGETS_AT_ONCE, KEEPS_ALL, LARGEST_BIAS

FORGETS = {"decay_u": FORGETS_AT_ONCE, "decay_v": FORGETS_AT_ONCE}
STEPS = 12


def neuron(weights, **parameters):
    """Return a builder of one compartment with a weight per input line."""

    def build(builder, x):
        y = builder.add_compartments("y", 1, **{"threshold": 100, **FORGETS, **parameters})
        builder.connect(x, y, [weights], exponent=7)

    return build


def dendrites(count, weights, soma, times=(1, 1, 1), biases=None, **parameters):
    """Return a builder of a soma that only adds some dendrites.

    ``times`` scales the weights of each dendrite, and ``biases`` are those of each.
    """

    def build(builder, x):
        y = builder.add_compartments("y", 1, **FORGETS, **soma)
        for k in range(count):
            parameters_of_child = {**FORGETS, **parameters}
            if biases is not None:
                parameters_of_child["bias"] = biases[k]
            child = builder.add_compartments(
                f"d{k}", 1, threshold=0, joined_to=y, **parameters_of_child
            )
            builder.connect(x, child, times[k] * np.array([weights]), exponent=7)

    return build


def chain(weights, soma, **parameters):
    """Return a builder of a soma that only adds a dendrite, to which another dendrite is joined."""

    def build(builder, x):
        y = builder.add_compartments("y", 1, **FORGETS, **soma)
        near = builder.add_compartments(
            "near", 1, threshold=0, joined_to=y, **{**FORGETS, **parameters}
        )
        far = builder.add_compartments(
            "far", 1, threshold=0, joined_to=near, **{**FORGETS, **parameters}
        )
        for child, sign in ((near, 1), (far, -1)):
            builder.connect(x, child, sign * np.array([weights]), exponent=7)

    return build


def relay(builder, x):
    """Add neurons whose spikes the second row cancels, and with them what a matrix, and then a list, has delivered."""
    h = builder.add_compartments("h", 1, threshold=90, **FORGETS)
    many = builder.add_compartments("many", 16, threshold=90, **FORGETS)
    y = builder.add_compartments("y", 1, threshold=100, **FORGETS)
    builder.connect(x, h, [[100, -200]])
    builder.connect(h, many, np.full((16, 1), 100))
    builder.connect(many, y, 200 * np.eye(1, 16, dtype=np.int64))


def two_chunks_driven_apart(builder, x):
    """Add two chunks of one population, each driven by its own row: one is refractory while the other runs again."""
    h = builder.add_compartments("h", 20, threshold=90, refractory=3, **FORGETS)
    y = builder.add_compartments("y", 1, threshold=100, **FORGETS)
    ends = np.isin(np.arange(20), [0, 19])
    builder.connect(x, h, 100 * np.outer(ends, [1, 1]) * (np.arange(20)[:, None] // 10 == [0, 1]))
    builder.connect(h, y, 200 * ends[None].astype(np.int64))


def echoing(children, onto=1, **parameters):
    """Return a builder of twenty neurons in two chunks, whose spikes return to their own dendrite, with different weights."""

    def build(builder, x):
        h = builder.add_compartments("h", 20, threshold=60, **FORGETS)
        for k in range(children):
            child = builder.add_compartments(
                f"d{k}", 20, threshold=0, joined_to=h, **{**FORGETS, **parameters}
            )
            builder.connect(x, child, np.add.outer(2 * np.arange(20), [60, 20]) * (k == 0))
            if k == onto:
                builder.connect(h, child, np.diag(4 * np.arange(20) - 120))
        y = builder.add_compartments("y", 1, threshold=900, **FORGETS)
        builder.connect(h, y, np.full((1, 20), 100))

    return build


def delay_line(to=lambda neuron: neuron, onto=("h",)):
    """Return a builder of forty neurons in three chunks: for five steps, a spike acts on ``to(neuron)`` of some groups."""

    def build(builder, x):
        h = builder.add_compartments("h", 40, threshold=60, **FORGETS)
        of_group = {"h": h} | {
            name: builder.add_compartments(
                name, 40, threshold=0, joined_to=h, decay_u=2000, decay_v=1000
            )
            for name in ("d0", "d1", "d2")
        }
        builder.connect(
            x, of_group[onto[0]], 30 + 60 * np.not_equal.outer(np.arange(40) % 2, [0, 1])
        )
        for name in onto:
            for delay in range(5):
                weights = np.zeros((40, 40), dtype=np.int64)
                weights[to(np.arange(40)), np.arange(40)] = 40 - 2 * np.arange(40) - 10 * delay
                builder.connect(h, of_group[name], weights, delay=delay)
        y = builder.add_compartments("y", 1, threshold=900, **FORGETS)
        builder.connect(h, y, 4 * np.arange(40)[None])

    return build


LARGE = {"decay_u": KEEPS_ALL, "bias": LARGEST_BIAS}
"""A current without decay, which five charges of 254 * 2^13 and the bias raise beyond 2^23."""
PHASES = {
    "a spike that is taken back": relay,
    "a pair that forgets, the second alone": dendrites(
        2, [100, -60], {"threshold": 6000}, times=(0, 1)
    ),
    "two chunks, refractory": two_chunks_driven_apart,
    "pulled to vmin": neuron([100, -200], decay_v=KEEPS_ALL, vmin=0, threshold=300),
    "a dendrite, pushed to vmax": dendrites(
        1, [200, -100], {"threshold": 30_000, "vmax": 2**21 - 1}, decay_v=KEEPS_ALL, vmax=2**21 - 1
    ),
    "u + bias wraps": neuron([252, -252], **LARGE, threshold=20_000),
    "a current that outlasts a spike": neuron([20, -10], decay_u=600, threshold=2000),
    "refractory": neuron([200, 100], refractory=4),
    "a soma refractory": dendrites(1, [200, 100], {"threshold": 100, "refractory": 5}),
    "a soma of two, refractory": dendrites(2, [200, 100], {"threshold": 20_000, "refractory": 5}),
    "a pair": dendrites(2, [200, -100], {"threshold": 10_000}, decay_u=1024, decay_v=512),
    "a pair of unlike dendrites": dendrites(
        2, [-120, 60], {"threshold": 500}, times=(1, -2), decay_u=1024, decay_v=512
    ),
    "a pair, the first alone": dendrites(
        2, [100, -60], {"threshold": 9000}, times=(1, 0), decay_u=900, decay_v=900
    ),
    "a pair, the second alone": dendrites(
        2, [100, -60], {"threshold": 9000}, times=(0, 1), decay_u=900, decay_v=900
    ),
    "a pair at its threshold": dendrites(2, [100, 60], {"threshold": 200 * 128}),
    "a pair, pulled to vmin": dendrites(
        2, [100, -200], {"threshold": 300, "vmin": 0}, decay_v=KEEPS_ALL, vmin=0
    ),
    "a pair, its sum cut off": dendrites(
        2, [250, -60], {"threshold": 30_000, "vmax": 2**21 - 1}, decay_v=2048, vmax=2**21 - 1
    ),
    "a pair that wraps": dendrites(2, [252, -252], {"threshold": 20_000}, **LARGE),
    "a bias after refractory steps": neuron(
        [40, 20], bias=-64_000, refractory=3, decay_v=512, threshold=100
    ),
    "three dendrites": dendrites(
        3, [100, -60], {"threshold": 9000}, times=(1, 1, -1), decay_u=900, decay_v=900
    ),
    "a dendrite of a dendrite": chain([100, -60], {"threshold": 900}, decay_u=900, decay_v=2000),
    "a pair, the first biased": dendrites(
        2, [10, 20], {"threshold": 100}, times=(1, 0), biases=(-40_960, 0), decay_v=KEEPS_ALL
    ),
    "a pair, the second biased": dendrites(
        2, [10, 20], {"threshold": 100}, times=(0, 1), biases=(0, -40_960), decay_v=KEEPS_ALL
    ),
    "spikes that come back": echoing(2, decay_u=2000, decay_v=1000),
    "spikes that come back to the first": echoing(2, onto=0, decay_u=2000, decay_v=1000),
    "spikes that come back to one of three": echoing(3, decay_u=2000, decay_v=1000),
    "a delay line": delay_line(),
    "a delay line onto a dendrite": delay_line(onto=("d1",)),
    "a delay line onto two dendrites": delay_line(onto=("d1", "d2")),
    "a delay line onto a neighbour in the chunk": delay_line(lambda neuron: neuron ^ 1),
    "a delay line onto the next chunk": delay_line(lambda neuron: (neuron + 16) % 32),
    "a pair with a bias": dendrites(
        2, [250, -250], {"threshold": 10_000}, bias=-64_000, decay_v=512
    ),
}


def location_program(build) -> hw.ChipProgram:
    """Return a phase of ``STEPS`` channels, visited in order. A recording has two rows, which are two input lines."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    build(builder, x)
    graph = graph_in_phase(builder.graph(), "location", STEPS, np.arange(STEPS))
    return program_of_graphs(CHIP, Readout(("y",), (1.0,)), graph)


@pytest.mark.parametrize("name", PHASES)
def test_a_session_equals_the_plain_engine_after_every_row(name):
    """In a dozen recordings, the second row changes what the first has done, from any step on."""
    program = location_program(PHASES[name])
    recordings = (np.random.default_rng(3).random((12, 2, STEPS)) < 0.5).astype(np.uint8)
    recordings[6:, 1, :6] = 0
    recordings[11, 1] = np.arange(STEPS) == STEPS - 2
    expected = hw.simulate(program, recordings, engine="reference").spikes["y"]
    first = hw.simulate(program, recordings * [[1], [0]], engine="reference").spikes["y"]
    session = hw.Session(program)
    for recording, after_both, after_first in zip(recordings, expected, first, strict=True):
        session.reset()
        assert session.push(recording[:1]).spikes["y"][0] == after_first.sum()
        assert np.array_equal(session.spikes("y"), after_first)
        assert session.push(recording[1:]).spikes["y"][0] == after_both.sum()
        assert np.array_equal(session.spikes("y"), after_both)
        # A third row has no line.
        third_row = np.ones((1, STEPS), dtype=np.uint8)
        assert session.push(third_row).spikes["y"][0] == after_both.sum()
    assert 12 < expected.sum() < expected.size
    assert not np.array_equal(expected, first)


@pytest.mark.parametrize("name", ["pulled to vmin", "a pair", "three dendrites"])
def test_a_session_has_the_largest_potential_after_every_row(name):
    program = replace(location_program(PHASES[name]), readout=Readout(("y",), (1.0,), 2))
    recording = (np.random.default_rng(5).random((2, STEPS)) < 0.5).astype(np.uint8)
    potential = [
        hw.simulate(
            program, recording * [[1], [later]], engine="reference", probe=("potential",)
        ).potential["y"]
        for later in (0, 1)
    ]
    expected = [[float(rows[2:].max())] for rows in potential]
    assert hw.Session(program).push(recording).scores.tolist() == expected
    assert expected[0][0] > 0


def test_a_bias_pulls_down_after_the_last_refractory_step():
    """It is blocked in step 2, and then falls by 64000 per step, so that the charge of 20 * 2^13 in step 6 is not enough."""
    program = location_program(neuron([40, 20], bias=-64_000, refractory=2, decay_v=KEEPS_ALL))
    recording = np.zeros((2, STEPS), dtype=np.uint8)
    recording[0, 0] = recording[1, 5] = 1
    assert hw.Session(program).push(recording).spikes["y"].tolist() == [[1], [1]]


def test_steps_that_nothing_changes_are_not_replayed():
    """A spike returns to its own population, which has run all steps: a silent row after it replays nothing."""

    def build(builder, x):
        y = builder.add_compartments("y", 1, threshold=90, **FORGETS)
        builder.connect(x, y, [[100, 100]])
        builder.connect(y, y, [[100]], delay=2)

    session = hw.Session(location_program(build))
    assert session.push(np.eye(1, STEPS, dtype=np.uint8)).spikes["y"].tolist() == [[4]]
    run = session.replayed[0]
    assert session.push(np.zeros((1, STEPS), dtype=np.uint8)).spikes["y"].tolist() == [[4]]
    assert session.replayed[0] == run == STEPS - 1


def test_a_sum_cut_off_below_its_threshold_never_spikes():
    """Two dendrites together would exceed the threshold, but the soma is clipped below it."""
    build = dendrites(
        2, [250, 0], {"threshold": 40_000, "vmax": 2**21 - 1}, decay_v=KEEPS_ALL, vmax=2**21 - 1
    )
    program = location_program(build)
    session = hw.Session(program)
    assert session.push(np.ones((2, STEPS), dtype=np.uint8)).spikes["y"].tolist() == [[0], [0]]
    assert hw.simulate(program, np.ones((2, STEPS), dtype=np.uint8)).counts.voltage_clips > STEPS


def test_the_phases_reach_the_ends_of_their_registers():
    """The comparison with the plain engine is one of wraps and clips, too."""
    recordings = (np.random.default_rng(3).random((5, 2, STEPS)) < 0.5).astype(np.uint8)
    counts = {
        name: hw.simulate(location_program(build), recordings).counts
        for name, build in PHASES.items()
    }
    assert {name for name, of_phase in counts.items() if of_phase.current_wraps} == {
        "u + bias wraps",
        "a pair that wraps",
    }
    clipped = {name for name, of_phase in counts.items() if of_phase.voltage_clips}
    assert clipped >= {
        "pulled to vmin",
        "a dendrite, pushed to vmax",
        "a pair, pulled to vmin",
        "a pair, its sum cut off",
    }


def test_no_row_is_played_after_the_last_step():
    """Rows after the last step change nothing, however they are pushed; a reset starts again."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 1)
    builder.connect(x, y := builder.add_compartments("y", 1, threshold=10, **FORGETS), [[20]])
    builder.read_out(y)
    program = builder.build()
    program = replace(program, phases=(replace(program.phases[0], steps=5),))
    session = hw.Session(program)
    for _ in range(2):
        spikes_so_far = [
            session.push(np.ones((rows, 1), dtype=np.uint8)).spikes["y"][:, 0].tolist()
            for rows in (3, 4, 1, 2)
        ]
        assert spikes_so_far == [[0, 1, 2], [3, 4, 4, 4], [4], [4, 4]]
        session.reset()
