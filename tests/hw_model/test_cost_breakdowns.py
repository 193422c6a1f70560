"""Breakdowns add up to their totals, to the integer; and latency equals a plain walk of every packet over the mesh."""

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


def played(seed):
    """Return a hybrid, some of them with a core of seven compartments on each tile, and its activity."""
    program, recording = random_hybrid(seed)
    chip = replace(
        program.chip, mesh=replace(program.chip.mesh, columns=8, rows=16, cores_per_tile=1)
    )
    program = replace(program, chip=chip)
    return program, hw.simulate(
        program, np.stack((recording, recording[::-1])), probe=("activity",)
    )


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_counts_by_step_piece_and_way_add_up(seed):
    program, result = played(seed)
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
def test_energy_by_phase_core_and_step_is_the_energy(profile, seed):
    """In exact arithmetic: every part is a count times the constant as it is written."""
    _, result = played(seed)

    def pj(counts):
        return sum(
            Fraction(str(cost)) * int(counts(name)) for name, cost in profile.energy_pj.items()
        )

    whole = pj(lambda name: result.counts[name])
    by_phase = [pj(lambda name, c=counts: c[name]) for counts in result.counts_by_phase.values()]
    assert sum(by_phase) == whole
    items = [item for found in result.activity.values() for item in found]
    by_core = [
        pj(lambda name, i=item, c=core: i.count(name)[:, c].sum())
        for item in items
        for core in range(item.input_packets.shape[1])
    ]
    by_step = [
        pj(lambda name, i=item, t=step: i.count(name)[t].sum())
        for item in items
        for step in range(len(item.buffered))
    ]
    assert sum(by_core) == sum(by_step) == whole
    assert float(whole) == pytest.approx(
        sum(hw.energy_pj(result.counts, profile).values()), rel=1e-12
    )


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
@pytest.mark.parametrize("profile", [DAVIES, SANAFE], ids=["davies2018", "sanafe"])
def test_times_by_part_step_path_and_phase_add_up(profile, seed):
    program, result = played(seed)
    latencies, usage = measure(program, result.activity, profile)
    whole = sum(one.total_ns for one in latencies)
    for cut in (
        [ns for used in usage.values() for ns in used.parts_ns.values()],
        [used.step_ns.sum() for used in usage.values()],
        [ns for used in usage.values() for ns in used.paths_ns.values()],
        [ns for one in latencies for ns in one.by_phase_ns.values()],
        [total_ns(program, result.activity, profile)],
    ):
        assert sum(cut) == pytest.approx(whole, rel=1e-12)
    assert [one.total_ns for one in latencies] == [
        pytest.approx(
            latency(
                program, {phase: items[i] for phase, items in result.activity.items()}, profile
            ).total_ns
        )
        for i in range(2)
    ]
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
    """Return the time of a step, packet by packet, from the axons alone."""
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
        core: sum(ns for name, ns in its.items() if name in BEFORE) for core, its in spent.items()
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
    done = [
        arrived[core] + read + sum(ns for name, ns in its.items() if name not in BEFORE)
        for core, its in spent.items()
    ]
    tiles = {chip.tile_of(core.slot) for core in cores}
    return max(done) + profile.barrier_ns.ns(len(tiles), chip.mesh.tiles)


BEFORE = (
    "neuron_updates",
    "neuron_updates_active",
    "neuron_updates_inactive",
    "spikes",
    "axon_packets",
    "packets_within_tile",
)
TIMED = (*BEFORE, "packets_received", "synaptic_ops")


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
    for name, its in columns.items():
        if name in result.spikes:
            spikes[:, its] = result.spikes[name]
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
    """From the tables of the cores alone: each list that a spike reaches, each packet and each link on its way."""
    program, recording = random_hybrid(seed)
    chip = replace(
        program.chip, mesh=replace(program.chip.mesh, columns=8, rows=16, cores_per_tile=1)
    )
    program = replace(program, chip=chip)
    if seed % 2:
        program = replace(program, cores=tuple(map(two_axons_of_a_neuron, program.cores)))
        check_program(program)
    result = hw.simulate(program, recording, probe=("spikes", "activity"))
    for phase, (item,) in result.activity.items():
        counts = Counter()
        reached = []
        for core in program.cores_of(phase):
            sent = spikes_of(program, phase, result, len(item.buffered))[
                :, program.columns_of_core(core)
            ].sum(axis=0)
            counts["spikes"] += int(sent.sum())
            for k, here in enumerate(core.axons.out_compartment):
                to = int(core.axons.out_core[k])
                many = int(sent[here])
                crossed = links(chip, core.slot, program.cores[to].slot)
                reached.append((to, int(core.axons.out_axon[k]), many))
                counts["axon_packets"] += many
                counts["packets_within_tile"] += many * (not crossed)
                for a, b in crossed:
                    counts["hops_y" if a[0] == b[0] else "hops_x"] += many
        for its in program.inputs_of(phase):
            route = program.route_of(its.name)
            # A transposed input has a line for each row of the recording.
            events = recording.sum(axis=0 if its.positions is None else 1)
            for line, to, axon in zip(route.line, route.core, route.axon, strict=True):
                many = int(events[line]) if line < len(events) else 0
                reached.append((int(to), int(axon), many))
                counts["input_packets"] += many
        by_core = {"synaptic_ops": Counter(), "packets_received": Counter()}
        for to, axon, many in reached:
            by_core["packets_received"][to] += many
            by_core["synaptic_ops"][to] += many * int(
                np.diff(program.cores[to].axons.list_start)[axon]
            )
        counts["synaptic_ops"] = by_core["synaptic_ops"].total()
        assert {name: result.counts_by_phase[phase][name] for name in counts} == dict(counts)
        for name, wanted in by_core.items():
            assert item.count(name).sum(axis=0).tolist() == [
                wanted[core.number] for core in program.cores_of(phase)
            ]


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(seed=SEEDS)
@pytest.mark.parametrize("profile", [DAVIES, SANAFE], ids=["davies2018", "sanafe"])
def test_latency_equals_a_walk_of_every_packet(profile, seed):
    program, recording = random_hybrid(seed)
    chip = replace(
        program.chip, mesh=replace(program.chip.mesh, columns=8, rows=16, cores_per_tile=1)
    )
    program = replace(program, chip=chip)
    result = hw.simulate(program, recording, probe=("spikes", "activity"))
    for phase, (item,) in result.activity.items():
        spikes = spikes_of(program, phase, result, len(item.buffered))
        found = critical_path(step_times(program, phase, item, profile)).step_ns
        expected = [
            walked_step_ns(program, phase, item, spikes, profile, t) for t in range(len(spikes))
        ]
        assert found.tolist() == pytest.approx(expected, rel=1e-12)
