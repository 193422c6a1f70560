"""Breakdowns of random programs add up to their totals, and counts and latency equal a plain walk of every packet.

The walk (``walked_step_ns``) reads only the axon tables of the cores, and follows each packet link by link.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import hw_model as hw
from hw_model.accounting.cost import (
    PARTS,
    SENDING,
    SYNAPSES,
    UPDATES,
    critical_path,
    latency,
    step_times,
)
from hw_model.accounting.usage import measure, total_ns
from hw_model.description.counts import BY_CORE
from hw_model.program.check import check_program
from tests.support.hybrids import CHIP, random_hybrid

SEEDS = st.integers(0, 2**32 - 1)
DAVIES, SANAFE = (CHIP.profile(name) for name in ("davies2018", "sanafe"))


def one_core_per_tile(program):
    """Return a program with a core on each tile, so that spikes between its cores cross links of the mesh.

    128 tiles hold the cores of every hybrid that is drawn.
    """
    mesh = replace(program.chip.mesh, columns=8, rows=16, cores_per_tile=1)
    return replace(program, chip=replace(program.chip, mesh=mesh))


def played_twice(seed):
    """Return a random hybrid, and its activity for a recording and the same one backwards in time."""
    program, recording = random_hybrid(seed)
    program = one_core_per_tile(program)
    both = np.stack((recording, recording[::-1]))
    return program, hw.simulate(program, both, probe=("activity",))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_counts_by_step_piece_and_way_add_up(seed):
    program, result = played_twice(seed)
    _, usage = measure(program, result.activity, DAVIES)
    for phase, used in usage.items():
        counts = result.counts_by_phase[phase]
        for name in BY_CORE:
            assert int(used.counts[name].sum()) == counts[name], name
        items = result.activity[phase]
        assert int(used.link_packets.sum()) == counts.hops
        assert sum(int(item.packets.sum()) for item in items) == counts.axon_packets
        received = sum(int(item.count("packets_received").sum()) for item in items)
        assert received == counts.axon_packets + counts.input_packets
        assert sum(int(item.buffered.sum()) for item in items) == counts.transpose_events
        north_south = np.array([a[0] == b[0] for a, b in items[0].routes.links], dtype=bool)
        assert int(used.link_packets[north_south].sum()) == counts.hops_y


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
@pytest.mark.parametrize("profile", [DAVIES, SANAFE], ids=["davies2018", "sanafe"])
def test_energy_by_phase_core_and_step_adds_up_to_the_energy(profile, seed):
    """The sums are exact: fractions of the constants as they are written, times integers."""
    _, result = played_twice(seed)

    def pj(counts):
        return sum(
            Fraction(str(cost)) * int(counts(name)) for name, cost in profile.energy_pj.items()
        )

    total_pj = pj(lambda name: result.counts[name])
    by_phase = [pj(lambda name, c=counts: c[name]) for counts in result.counts_by_phase.values()]
    assert sum(by_phase) == total_pj
    activities = [activity for of_phase in result.activity.values() for activity in of_phase]
    by_core = [
        pj(lambda name, a=activity, c=core: a.count(name)[:, c].sum())
        for activity in activities
        for core in range(activity.input_packets.shape[1])
    ]
    by_step = [
        pj(lambda name, a=activity, t=step: a.count(name)[t].sum())
        for activity in activities
        for step in range(len(activity.buffered))
    ]
    assert sum(by_core) == sum(by_step) == total_pj
    assert float(total_pj) == pytest.approx(
        sum(hw.energy_pj(result.counts, profile).values()), rel=1e-12
    )


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
@pytest.mark.parametrize("profile", [DAVIES, SANAFE], ids=["davies2018", "sanafe"])
def test_times_by_part_step_path_and_phase_add_up(profile, seed):
    program, result = played_twice(seed)
    latencies, usage = measure(program, result.activity, profile)
    all_ns = sum(of_recording.total_ns for of_recording in latencies)
    by_part = [ns for used in usage.values() for ns in used.parts_ns.values()]
    by_step = [used.step_ns.sum() for used in usage.values()]
    by_path = [ns for used in usage.values() for ns in used.paths_ns.values()]
    by_phase = [ns for of_recording in latencies for ns in of_recording.by_phase_ns.values()]
    added_up = [total_ns(program, result.activity, profile)]
    for breakdown in (by_part, by_step, by_path, by_phase, added_up):
        assert sum(breakdown) == pytest.approx(all_ns, rel=1e-12)
    for i, of_recording in enumerate(latencies):
        activity = {phase: items[i] for phase, items in result.activity.items()}
        alone = latency(program, activity, profile)
        assert of_recording.total_ns == pytest.approx(alone.total_ns)
    assert all(tuple(used.parts_ns) == PARTS for used in usage.values())
    for phase, used in usage.items():
        for part, names in (("updates", UPDATES), ("sending", SENDING), ("synapses", SYNAPSES)):
            spent = [
                item.count(name).sum(axis=0) * profile.time_ns.get(name, 0.0)
                for item in result.activity[phase]
                for name in names
            ]
            assert used.busy_ns[part] == pytest.approx(sum(spent), rel=1e-12)


def test_events_of_a_direct_input_are_not_read_from_the_buffer():
    program, recording = random_hybrid(8)
    item = program.inputs_of("location")[0]
    direct = replace(item, name="direct", positions=None)
    route = replace(program.route_of(item.name), input="direct")
    mixed = replace(
        program, inputs=(direct, *program.inputs), input_routes=(route, *program.input_routes)
    )
    recording = recording.copy()
    recording[:, 1:] = 0  # so that the two inputs have different events
    result = hw.simulate(mixed, recording[None], probe=("activity",))
    read = result.activity["location"][0].buffered.sum()
    assert 0 < read == result.counts_by_phase["location"].transpose_events


def walked_step_ns(program, phase, item, spikes, profile, step):
    """Return the time of a step by the rules of :mod:`hw_model.accounting.cost`, packet by packet, from the axons alone."""
    chip = program.chip
    cores = program.cores_of(phase)
    costs = profile.time_ns
    spent = {
        core.number: {
            name: float(item.count(name)[step, i] * costs.get(name, 0.0)) for name in TIMED
        }
        for i, core in enumerate(cores)
    }
    sent = {
        core: sum(ns for name, ns in by_count.items() if name in BEFORE_SENDING)
        for core, by_count in spent.items()
    }
    ways = Counter()
    loads = Counter()
    for core in cores:
        fired = spikes[step, program.columns_of_core(core)]
        for k in np.flatnonzero(fired[core.axons.out_compartment]):
            target = int(core.axons.out_core[k])
            ways[core.number, target] += 1
            loads.update(links(chip, core.slot, program.cores[target].slot))
    arrived = dict(sent)
    for source, target in ways:
        crossed = links(chip, program.cores[source].slot, program.cores[target].slot)
        hop = {link: costs["hops_y" if link[0][0] == link[1][0] else "hops_x"] for link in crossed}
        waits = max(((loads[link] - 1) * hop[link] for link in crossed), default=0.0)
        arrived[target] = max(arrived[target], sent[source] + sum(hop.values()) + waits)
    read = item.buffered[step] * chip.transpose_buffer.cycles_per_event / chip.clock_ghz
    ended = [
        arrived[core]
        + read
        + sum(ns for name, ns in by_count.items() if name not in BEFORE_SENDING)
        for core, by_count in spent.items()
    ]
    tiles = {chip.tile_of(core.slot) for core in cores}
    return max(ended) + profile.barrier_ns.ns(len(tiles), chip.mesh.tiles)


BEFORE_SENDING = (
    "neuron_updates",
    "neuron_updates_active",
    "neuron_updates_inactive",
    "spikes",
    "axon_packets",
    "packets_within_tile",
)
"""What a core does in a step before its last packet leaves."""
TIMED = (*BEFORE_SENDING, "packets_received", "synaptic_ops")
"""All counts that take a core time."""


def links(chip, source, target):
    """Return the links from slot to slot, all of X, then all of Y."""
    (x, y), (to_x, to_y) = chip.tile_of(source), chip.tile_of(target)
    stops = [(i, y) for i in range(x, to_x, 1 if to_x > x else -1)]
    stops += [(to_x, j) for j in range(y, to_y, 1 if to_y > y else -1)]
    return list(zip(stops, [*stops[1:], (to_x, to_y)], strict=True)) if stops else []


def spikes_of(program, phase, result, steps):
    """Return the spikes of a phase of one recording, (steps, columns)."""
    columns = program.columns_of(phase)
    spikes = np.zeros((steps, sum(program.populations[name] for name in columns)), dtype=np.uint8)
    for name, columns_of_group in columns.items():
        if name in result.spikes:
            spikes[:, columns_of_group] = result.spikes[name]
    return spikes


def two_axons_of_a_neuron(core):
    """Return a core whose compartments have two output axons each, which may end on one core, as a file may have it."""
    sender = core.axons.out_compartment
    return replace(
        core, axons=replace(core.axons, out_compartment=np.repeat(sender[::2], 2)[: len(sender)])
    )


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_counts_equal_a_walk_of_every_spike(seed):
    """The walk reads the tables of the cores alone: each list that a spike reaches, each packet, each link on its way."""
    program, recording = random_hybrid(seed)
    program = one_core_per_tile(program)
    if seed % 2:
        program = replace(program, cores=tuple(map(two_axons_of_a_neuron, program.cores)))
        check_program(program)
    result = hw.simulate(program, recording, probe=("spikes", "activity"))
    for phase, (item,) in result.activity.items():
        counts = Counter()
        # Core, input axon there, and packets.
        received: list[tuple[int, int, int]] = []
        spikes = spikes_of(program, phase, result, len(item.buffered))
        for core in program.cores_of(phase):
            spikes_of_compartment = spikes[:, program.columns_of_core(core)].sum(axis=0)
            counts["spikes"] += int(spikes_of_compartment.sum())
            for k, compartment in enumerate(core.axons.out_compartment):
                to = int(core.axons.out_core[k])
                packets = int(spikes_of_compartment[compartment])
                crossed = links(program.chip, core.slot, program.cores[to].slot)
                received.append((to, int(core.axons.out_axon[k]), packets))
                counts["axon_packets"] += packets
                counts["packets_within_tile"] += packets * (not crossed)
                for (column, _), (next_column, _) in crossed:
                    counts["hops_y" if column == next_column else "hops_x"] += packets
        for phase_input in program.inputs_of(phase):
            route = program.route_of(phase_input.name)
            # A transposed input has a line for each row of the recording.
            events = recording.sum(axis=0 if phase_input.positions is None else 1)
            for line, to, axon in zip(route.line, route.core, route.axon, strict=True):
                packets = int(events[line]) if line < len(events) else 0
                received.append((int(to), int(axon), packets))
                counts["input_packets"] += packets
        by_core = {"synaptic_ops": Counter(), "packets_received": Counter()}
        for to, axon, packets in received:
            synapses = int(np.diff(program.cores[to].axons.list_start)[axon])
            by_core["packets_received"][to] += packets
            by_core["synaptic_ops"][to] += packets * synapses
        counts["synaptic_ops"] = by_core["synaptic_ops"].total()
        assert {name: result.counts_by_phase[phase][name] for name in counts} == dict(counts)
        numbers = [core.number for core in program.cores_of(phase)]
        for name, count_of_core in by_core.items():
            expected = [count_of_core[number] for number in numbers]
            assert item.count(name).sum(axis=0).tolist() == expected


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
@pytest.mark.parametrize("profile", [DAVIES, SANAFE], ids=["davies2018", "sanafe"])
def test_latency_equals_a_walk_of_every_packet(profile, seed):
    program, recording = random_hybrid(seed)
    program = one_core_per_tile(program)
    result = hw.simulate(program, recording, probe=("spikes", "activity"))
    for phase, (item,) in result.activity.items():
        spikes = spikes_of(program, phase, result, len(item.buffered))
        step_ns = critical_path(step_times(program, phase, item, profile)).step_ns
        expected = [
            walked_step_ns(program, phase, item, spikes, profile, t) for t in range(len(spikes))
        ]
        assert step_ns.tolist() == pytest.approx(expected, rel=1e-12)
