"""Energy and latency of tiny programs against numbers worked out by hand, in :mod:`tests.support.cost_programs`.

The times and energies in this file are those of the published profiles: with ``davies2018`` an active update takes
8.4 ns, one at rest 5.3 ns, a synaptic operation 3.5 ns, a hop 4.1 ns east or west and 6.5 ns north or south.
"""

from dataclasses import replace

import numpy as np
import pytest

import hw_model as hw
from hw_model.accounting.cost import critical_path, energy_pj, latency, step_times
from hw_model.accounting.usage import measure
from hw_model.values import added
from tests.support.cost_programs import FORGETS, chain, crossroads, hybrid
from tests.support.hybrids import program_of_graphs
from tests.support.register_units import FORGETS_AT_ONCE, LARGEST_THRESHOLD

CHIP = hw.chip("loihi-sim")


def test_counts_of_a_chain_equal_those_worked_out_by_hand():
    worked = chain()
    counts = hw.simulate(worked.program, worked.recording).counts
    assert counts.synaptic_ops == 2  # x -> a and a -> b
    assert counts.neuron_updates == 8  # two compartments, four steps
    # a and b are active in the step of their charge, and in the next one, in which u is left.
    assert counts.neuron_updates_active == 4
    assert counts.spikes == 2
    assert counts.axon_packets == 1  # b has no target
    assert counts.packets_within_tile == 1
    assert (counts.input_events, counts.input_packets, counts.hops) == (1, 1, 0)


@pytest.mark.parametrize("profile", CHIP.profiles)
@pytest.mark.parametrize(
    "worked", [chain(), crossroads(), hybrid()], ids=lambda worked: worked.program.name
)
def test_energy_and_latency_equal_those_worked_out_by_hand(worked, profile):
    """The constants have one digit behind the point: nine digits leave room for rounding in float64 only."""
    result = hw.simulate(worked.program, worked.recording, probe=("activity",))
    costs = CHIP.profile(profile)
    assert round(sum(energy_pj(result.counts, costs).values()), 9) == round(worked.pj[profile], 9)
    activity = {phase: recordings[0] for phase, recordings in result.activity.items()}
    time = latency(worked.program, activity, costs)
    expected = worked.phase_ns[profile]
    assert {phase: round(ns, 9) for phase, ns in time.by_phase_ns.items()} == {
        phase: round(ns, 9) for phase, ns in expected.items()
    }
    assert round(time.total_ns, 9) == round(sum(expected.values()), 9)
    assert round(time.after_last_row_ns, 9) == round(worked.after_last_row_ns[profile], 9)


def test_a_wait_on_a_link_north_or_south_is_the_time_of_its_own_hop():
    """Four cores in a row or a column: three packets share the first link, so the farthest waits two hops and takes three."""

    def total_ns(columns, rows):
        chip = replace(
            CHIP,
            limits=replace(CHIP.limits, compartments_per_core=1, cores_per_chip=4),
            mesh=replace(CHIP.mesh, columns=columns, rows=rows, cores_per_tile=1),
        )
        builder = hw.ProgramBuilder(chip)
        x = builder.add_input("x", 1)
        first, others = (
            builder.add_compartments(name, n, **FORGETS)
            for name, n in (("first", 1), ("others", 3))
        )
        builder.connect(x, first, [[20]])
        builder.connect(first, others, [[20], [20], [20]])
        program = program_of_graphs(chip, None, builder.graph())
        result = hw.simulate(program, np.array([[1], [0], [0]]), probe=("activity",))
        activity = {phase: recordings[0] for phase, recordings in result.activity.items()}
        return latency(program, activity, CHIP.profile("davies2018")).total_ns

    hops = 3
    waits = 2
    assert round(total_ns(1, 4) - total_ns(4, 1), 9) == round((hops + waits) * (6.5 - 4.1), 9)


def test_the_formulas_worked_out_by_hand_give_these_digits():
    """The same figures as plain numbers, so that a mistake in the formulas of the support module would show."""
    by_program = {
        worked.program.name: (
            worked.pj,
            {name: sum(ns.values()) for name, ns in worked.phase_ns.items()},
        )
        for worked in (chain(), crossroads(), hybrid())
    }
    assert {
        name: {p: round(v, 9) for p, v in pj.items()} for name, (pj, _) in by_program.items()
    } == {
        "chain": {"davies2018": 580.9, "sanafe": 816.6},
        "crossroads": {"davies2018": 876.4, "sanafe": 1487.8},
        "hybrid": {"davies2018": 488.6, "sanafe": 672.4},
    }
    assert {
        name: {p: round(v, 9) for p, v in ns.items()} for name, (_, ns) in by_program.items()
    } == {
        "chain": {"davies2018": 515.9, "sanafe": 2569.3},
        "crossroads": {"davies2018": 1014.0, "sanafe": 4114.4},
        "hybrid": {"davies2018": 624.8, "sanafe": 3228.3},
    }


def test_a_step_waits_for_the_farthest_packet():
    worked = crossroads()
    result = hw.simulate(worked.program, worked.recording, probe=("activity",))
    times = step_times(
        worked.program, "time", result.activity["time"][0], CHIP.profile("davies2018")
    )
    path = critical_path(times)
    assert [worked.program.cores[i].slot for i in path.last] == [0, 2, 0]
    assert [worked.program.cores[i].slot for i in path.sender] == [0, 0, 0]
    assert {part: np.round(ns, 9).tolist() for part, ns in path.parts_ns.items()} == {
        "updates": [5.3, 8.4, 8.4],
        "sending": [0, 0, 0],
        "mesh": [0, 12.3, 0],
        "buffer": [0, 0, 0],
        "deliveries": [0, 0, 0],
        "synapses": [3.5, 3.5, 0],
        "barrier": [324.2, 324.2, 324.2],
    }


@pytest.mark.parametrize(
    ("others", "barrier_ns"), [(1, 113.0), (3, 113.0), (4, 113.0 + (465.0 - 113.0) / 31)]
)
def test_the_barrier_takes_longer_with_more_tiles(others, barrier_ns):
    """With one compartment per core, two or four cores are one tile, and five are two of 32 tiles.

    A barrier takes 113 ns for one tile, and grows linearly to 465 ns for all 32.
    """
    small = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=1))
    builder = hw.ProgramBuilder(small)
    builder.connect(
        builder.add_input("x", 1),
        builder.add_compartments("y", 1 + others, threshold=1),
        [[20]] * (1 + others),
    )
    program = builder.build()
    result = hw.simulate(program, [[1], [0]], probe=("activity",))
    times = step_times(program, "time", result.activity["time"][0], CHIP.profile("davies2018"))
    assert (len(program.cores), times.barrier_ns) == (1 + others, barrier_ns)


@pytest.mark.parametrize(
    ("synapses", "core"), [((1, 3), 1), ((3, 1), 0)], ids=["the second", "the first"]
)
def test_the_critical_core_is_the_one_that_is_last_for_longest(synapses, core):
    """One event reaches two cores, by different numbers of synapses."""
    small = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=1))
    builder = hw.ProgramBuilder(small)
    x = builder.add_input("x", 1)
    for name, many in zip("ab", synapses, strict=True):
        y = builder.add_compartments(
            name, 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=LARGEST_THRESHOLD
        )
        for _ in range(many):
            builder.connect(x, y, [[20]])
    program = program_of_graphs(small, None, builder.graph())
    result = hw.simulate(program, np.ones((9, 1), dtype=np.uint8), probe=("activity",))
    activity = {phase: recordings[0] for phase, recordings in result.activity.items()}
    assert latency(program, activity, CHIP.profile("davies2018")).critical_core == core


def test_the_critical_core_is_one_of_the_program_and_not_of_its_phase():
    program = hybrid().program
    recording = hybrid().recording
    activity = hw.simulate(program, recording, probe=("activity",)).activity
    for phase, (item,) in activity.items():
        (core,) = program.cores_of(phase)
        assert (
            latency(program, {phase: item}, CHIP.profile("davies2018")).critical_core == core.number
        )


@pytest.mark.parametrize(
    ("worked", "slowest_ns"),
    [(chain(), 8.4 + 5.3 + 2.1 + 3.5 + 113.0), (hybrid(), 8.4 + 2 * 3.5 + 113.0)],
    ids=["of one phase", "of the phase that plays rows as they come"],
)
def test_the_slowest_step_of_a_row_is_known_by_hand(worked, slowest_ns):
    result = hw.simulate(worked.program, worked.recording, probe=("activity",))
    activity = {phase: slowest[0] for phase, slowest in result.activity.items()}
    slowest = latency(worked.program, activity, CHIP.profile("davies2018"))
    assert round(slowest.slowest_step_ns, 9) == round(slowest_ns, 9)


def test_the_buffer_is_read_in_cycles_of_the_clock():
    program = hybrid().program
    fast = replace(program, chip=replace(program.chip, clock_ghz=4.0))
    for played, ns in ((program, [1.0, 2.0]), (fast, [0.25, 0.5])):
        result = hw.simulate(played, hybrid().recording, probe=("activity",))
        times = step_times(
            played, "location", result.activity["location"][0], CHIP.profile("davies2018")
        )
        assert times.buffer_ns.ravel().tolist() == ns


def test_each_input_has_its_own_delay_when_synapses_are_due_after_the_end():
    """The line of the second input has its own delay, and not that of the first input's first line."""
    builder = hw.ProgramBuilder(CHIP)
    y = builder.add_compartments("y", 1, **FORGETS)
    for name, lines, delay in (("first", 2, 0), ("second", 1, 2)):
        builder.connect(builder.add_input(name, lines), y, [[20] * lines], delay=delay)
    rows = {"first": np.zeros((4, 2)), "second": np.array([[0], [1], [1], [0]])}
    assert hw.simulate(builder.build(), rows).counts.synaptic_ops_after_end == 2
    rows["first"][3] = 1
    assert hw.simulate(builder.build(), rows).counts.synaptic_ops_after_end == 4


def test_the_most_packets_in_a_step_are_those_of_one_recording():
    """It is so whether recordings are measured together, or separately and then added."""
    worked = crossroads()
    profile = CHIP.profile("davies2018")
    one, two = (
        hw.simulate(worked.program, np.stack(many * [worked.recording]), probe=("activity",))
        for many in (1, 2)
    )
    (_, usage), (_, together) = (
        measure(worked.program, of_phase.activity, profile) for of_phase in (one, two)
    )
    for of_phase in (together["time"], added(usage, usage)["time"]):
        assert np.array_equal(of_phase.link_packets, 2 * usage["time"].link_packets)
        assert np.array_equal(of_phase.link_most, usage["time"].link_most)


def test_the_packets_of_each_link_are_counted():
    """Two recordings have three events, each of which sends two packets to (1, 0), one of them on to (2, 0), and one to (0, 1)."""
    worked = crossroads()
    recordings = np.array([[[1], [0], [0]], [[1], [1], [0]]])
    result = hw.simulate(worked.program, recordings, probe=("activity",))
    _, usage = measure(worked.program, result.activity, CHIP.profile("davies2018"))
    steps = result.activity["time"][1]
    assert steps.routes.links == (((0, 0), (1, 0)), ((1, 0), (2, 0)), ((0, 0), (0, 1)))
    assert usage["time"].link_packets.tolist() == [6, 3, 3]
    assert usage["time"].link_most.tolist() == [2, 1, 1]
    # Spikes of steps 1 and 2: three hops to the east, and one to the south.
    assert steps.count("hops").sum(axis=1).tolist() == [0, 4, 4]


def test_spikes_by_piece_are_those_of_its_compartments():
    """Somas and dendrites share cores, so that the pieces of a core are not consecutive columns."""
    small = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=4))
    builder = hw.ProgramBuilder(small)
    x = builder.add_input("x", 5)
    for name in ("first", "second"):
        soma = builder.add_compartments(name, 5, **FORGETS)
        dendrite = builder.add_compartments(
            f"{name}/dendrite", 5, **(FORGETS | {"threshold": 0}), joined_to=soma
        )
        builder.connect(x, dendrite, np.diag([20] * 5))
    program = builder.build()
    result = hw.simulate(program, np.tri(6, 5), probe=("spikes", "activity"))
    counted = result.activity["time"][0].by_piece["spikes"]
    pieces = [piece for core in program.cores_of("time") for piece in core.slices]
    for piece, spikes_of_piece in zip(pieces, counted.T, strict=True):
        spikes = result.spikes.get(piece.group, np.zeros((6, 5)))
        assert np.array_equal(spikes_of_piece, spikes[:, piece.start : piece.stop].sum(axis=1)), (
            piece
        )


def test_hops_are_counted_from_tile_to_tile():
    """With one compartment per core, a spike of ``first`` goes to 40 cores, in tiles of four cores, eight per row."""
    small = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=1))
    builder = hw.ProgramBuilder(small)
    x = builder.add_input("x", 1)
    first = builder.add_compartments(
        "first", 1, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    rest = builder.add_compartments(
        "rest", 40, decay_u=FORGETS_AT_ONCE, decay_v=FORGETS_AT_ONCE, threshold=10
    )
    builder.connect(x, first, [[20]])
    builder.connect(first, rest, np.full((40, 1), 20))
    program = builder.build()
    counts = hw.simulate(program, [[1], [0], [0]]).counts
    tiles = [(core.slot // 4 % 8, core.slot // 4 // 8) for core in program.cores]
    ways = [(abs(x - tiles[0][0]), abs(y - tiles[0][1])) for x, y in tiles[1:]]
    assert counts.axon_packets == 40
    assert counts.packets_within_tile == ways.count((0, 0)) == 3
    assert (counts.hops_x, counts.hops_y) == (sum(x for x, _ in ways), sum(y for _, y in ways))


@pytest.mark.parametrize(
    ("slots", "hops"),
    [
        ((0, 3), (0, 0)),
        ((0, 4), (1, 0)),
        ((0, 31), (7, 0)),
        ((0, 32), (0, 1)),
        ((31, 32), (7, 1)),
        ((0, 128), (8, 0)),
    ],
    ids=["same tile", "next tile", "end of row", "next row", "both", "next chip"],
)
def test_hops_between_two_slots_are_those_between_their_tiles(slots, hops):
    assert CHIP.hops(*slots) == CHIP.hops(*reversed(slots)) == hops


def test_times_of_every_step_and_core_of_a_chain_are_those_by_hand():
    program = chain().program
    result = hw.simulate(program, chain().recording, probe=("activity",))
    times = step_times(program, "time", result.activity["time"][0], CHIP.profile("davies2018"))
    assert times.work_ns["synaptic_ops"].ravel().tolist() == [3.5, 3.5, 0, 0]
    assert times.work_ns["neuron_updates_active"].ravel().tolist() == [0, 8.4, 2 * 8.4, 8.4]
    assert times.mesh_ns.ravel().tolist() == [0, 0, 0, 0]
    assert times.used.ravel().tolist() == [False, True, False, False]  # a to b, on the same core
    assert times.barrier_ns == 113.0
