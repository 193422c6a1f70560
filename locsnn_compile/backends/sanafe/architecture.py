"""The chip as an architecture file of SANA-FE: its mesh, tiles and cores, priced by an energy profile.

Input spikes come from outside the chip, but SANA-FE's can only come from cores. So every tile in use has one core more,
the host's, whose somas play the input lines of that tile for no energy and no time: their packets travel no hop.
"""

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import yaml

import hw_model as hw
from hw_model.values import Frozen
from locsnn_compile.backends.sanafe.rules import UNIT_SIZE
from locsnn_compile.errors import InputError

SYNAPSE, DENDRITE, SOMA, REPLAY, LINE = "synapse", "dendrite", "soma", "replay", "line"
"""Names of units: what a compartment has, a soma that plays spikes back, and the host's for one input line."""
PROFILE = "sanafe"
PRICED = ("synaptic_ops", "neuron_updates", "neuron_updates_active", "spikes", "axon_packets", "hops_x", "hops_y")
"""Counts that SANA-FE has a price for."""
SOMA_EVENTS = {"access_neuron": "neuron_updates", "update_neuron": "neuron_updates_active", "spike_out": "spikes"}
"""Events of a soma that SANA-FE prices, and the counts that they are."""
HOPS = {"east": "hops_x", "west": "hops_x", "north": "hops_y", "south": "hops_y"}
"""Ways that SANA-FE prices a hop on, and the counts that they are."""
LINK_BUFFER = 16


class TileUse(Frozen):
    """What a tile holds: ``lines`` input lines on its host core, and up to ``replayed`` compartments a core."""

    lines: int
    replayed: int


def priced_by(chip: hw.Chip) -> hw.Profile:
    """Return the profile ``sanafe`` of a chip, or say that it has none that SANA-FE can follow."""
    if PROFILE not in chip.profiles or not set(chip.profiles[PROFILE].energy_pj) <= set(PRICED):
        what = f"it has no energy profile {PROFILE!r} that prices what SANA-FE counts"
        fix = f"Copy the profile {PROFILE!r} of loihi-sim into the chip file."
        raise InputError(f"chip {chip.name}", what, fix=fix)
    return chip.profiles[PROFILE]


def tile_number(chip: hw.Chip, slot: int) -> int:
    """Return SANA-FE's number of a core's tile: it counts a column from its first row on, then the next column."""
    column, row = chip.tile_of(slot)
    return column * chip.mesh.rows + row


def architecture(chip: hw.Chip, uses: Mapping[int, TileUse]) -> str:
    """Return the architecture file; ``uses[tile]`` says what is on each tile in use, by SANA-FE's numbers."""
    profile, columns = priced_by(chip), chip.mesh.columns * chip.chips
    attributes = {
        "width": columns,
        "height": chip.mesh.rows,
        "link_buffer_size": LINK_BUFFER,
        "sync_model": "table",
        "latency_sync": {n: profile.barrier_ns.ns(n, chip.mesh.tiles) * 1e-9 for n in range(1, len(uses) + 1)},
    }
    tiles = []
    for use, tiles_alike in groupby(range(columns * chip.mesh.rows), key=uses.get):
        numbers = list(tiles_alike)
        cores = [_core(profile, chip.mesh.cores_per_tile, use.replayed if use else 0)]
        cores += [_host(use.lines)] if use and use.lines else []
        hops = _costs(profile, {f"{way}_hop": count for way, count in HOPS.items()})
        tiles.append({"name": f"tile[{numbers[0]}..{numbers[-1]}]", "attributes": hops, "core": cores})
    return yaml.safe_dump({"architecture": {"name": "chip", "attributes": attributes, "tile": tiles}}, sort_keys=False)


def _core(profile: hw.Profile, alike: int, replayed: int) -> dict[str, Any]:
    """Return cores of the chip. Dendrites add up charge and hold it until the step in which it is due."""
    costs = _costs(profile, SOMA_EVENTS)
    # A profile prices the energy of a packet once; all of it is put on the sender.
    arrives = {"energy_message_in": 0.0, "latency_message_in": _seconds(profile, "packets_received")}
    return {
        "name": f"core[0..{alike - 1}]",
        "attributes": _buffer("dendrite", inside=True, neurons=UNIT_SIZE),
        "axon_in": [_unit("axon_in", arrives)],
        "synapse": [_unit(SYNAPSE, _costs(profile, {"process_spike": "synaptic_ops"}), "current_based")],
        "dendrite": [_unit(DENDRITE, _free("update"), "accumulator_with_delay")],
        "soma": [
            _unit(SOMA, costs, "leaky_integrate_fire"),
            *([_unit(f"{REPLAY}[0..{replayed - 1}]", costs, "input")] if replayed else []),
        ],
        "axon_out": [_unit("axon_out", _costs(profile, {"message_out": "axon_packets"}))],
    }


def _host(lines: int) -> dict[str, Any]:
    return {
        "name": "host",
        "attributes": _buffer("soma", inside=False, neurons=lines),
        "axon_in": [_unit("axon_in", _free("message_in"))],
        "synapse": [_unit(SYNAPSE, _free("process_spike"), "current_based")],
        "dendrite": [_unit(DENDRITE, _free("update"), "accumulator")],
        "soma": [_unit(f"{LINE}[0..{lines - 1}]", _free(*SOMA_EVENTS), "input")],
        "axon_out": [_unit("axon_out", _free("message_out"))],
    }


def _buffer(before: str, *, inside: bool, neurons: int) -> dict[str, Any]:
    return {"buffer_position": before, "buffer_inside_unit": inside, "max_neurons_supported": neurons}


def _unit(name: str, costs: Mapping[str, float], model: str | None = None) -> dict[str, Any]:
    return {"name": name, "attributes": {**({"model": model} if model else {}), **costs}}


def _free(*events: str) -> dict[str, float]:
    return {f"{kind}_{event}": 0.0 for event in events for kind in ("energy", "latency")}


def _costs(profile: hw.Profile, counts: Mapping[str, str]) -> dict[str, float]:
    """Return the energy and the latency of every event, in joules and seconds, from the counts that price it."""
    found = {}
    for event, count in counts.items():
        found[f"energy_{event}"] = profile.energy_pj.get(count, 0.0) * 1e-12
        found[f"latency_{event}"] = _seconds(profile, count)
    return found


def _seconds(profile: hw.Profile, count: str) -> float:
    return profile.time_ns.get(count, 0.0) * 1e-9
