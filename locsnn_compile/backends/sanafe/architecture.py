"""The chip as an architecture file of SANA-FE: its mesh, tiles and cores, priced by an energy profile.

Input spikes come from outside the chip, but in SANA-FE spikes can only come from cores. So every tile in use has one
extra core, the host's, whose somas play the input lines of that tile without energy or time, and without hops.
"""

from collections.abc import Mapping
from itertools import groupby
from typing import Any

import yaml

import hw_model as hw
from hw_model.texts.templates import yaml_table
from hw_model.values import Frozen
from locsnn_compile.backends.sanafe.rules import UNIT_SIZE
from locsnn_compile.errors import InputError

SYNAPSE, DENDRITE, SOMA, REPLAY, LINE = "synapse", "dendrite", "soma", "replay", "line"
"""Names of units: those of a compartment, a soma that plays spikes back, and the host's soma for an input line."""
PROFILE = "sanafe"
PRICED = (
    "synaptic_ops",
    "neuron_updates",
    "neuron_updates_active",
    "spikes",
    "axon_packets",
    "hops_x",
    "hops_y",
)
"""Counts that SANA-FE has a cost for."""
_EVENTS = {*PRICED, "packets_received", "free"}
"""What the template of a tile gives for an event; what is ``free`` costs nothing in any profile."""
LINK_BUFFER = 16


class TileUse(Frozen):
    """What a tile holds: ``lines`` input lines on its host core, and up to ``replayed`` compartments per core."""

    lines: int
    replayed: int


def priced_by(chip: hw.Chip) -> hw.Profile:
    """Return the profile ``sanafe`` of a chip; ``InputError`` if it has none that SANA-FE can follow."""
    if PROFILE not in chip.profiles or not set(chip.profiles[PROFILE].energy_pj) <= set(PRICED):
        what = f"it has no energy profile {PROFILE!r} that prices what SANA-FE counts"
        fix = f"Copy the profile {PROFILE!r} of loihi-sim into the chip file."
        raise InputError(f"chip {chip.name}", what, fix=fix)
    return chip.profiles[PROFILE]


def tile_number(chip: hw.Chip, slot: int) -> int:
    """Return SANA-FE's number of a core's tile; it counts column by column."""
    column, row = chip.tile_of(slot)
    return column * chip.mesh.rows + row


def architecture(chip: hw.Chip, uses: Mapping[int, TileUse]) -> str:
    """Return the architecture file; ``uses[tile]`` is the use of each tile, by SANA-FE's numbers."""
    profile = priced_by(chip)
    columns = chip.mesh.columns * chip.chips
    attributes = {
        "width": columns,
        "height": chip.mesh.rows,
        "link_buffer_size": LINK_BUFFER,
        "sync_model": "table",
        "latency_sync": {
            n: profile.barrier_ns.ns(n, chip.mesh.tiles) * 1e-9 for n in range(1, len(uses) + 1)
        },
    }
    tiles = []
    for use_of_tiles, tiles_alike in groupby(range(columns * chip.mesh.rows), key=uses.get):
        use = use_of_tiles or TileUse(0, 0)
        tile: Any = _priced(_tile(chip, list(tiles_alike), use), profile)
        if not use.replayed:
            del tile["core"][0]["soma"][1]
        if not use.lines:
            del tile["core"][1]
        tiles.append(tile)
    return yaml.safe_dump(
        {"architecture": {"name": "chip", "attributes": attributes, "tile": tiles}}, sort_keys=False
    )


def _tile(chip: hw.Chip, numbers: list[int], use: TileUse) -> Any:
    places = {"first": numbers[0], "last": numbers[-1], "last_core": chip.mesh.cores_per_tile - 1}
    places |= {"unit_size": UNIT_SIZE, "lines": use.lines, "last_line": use.lines - 1}
    places |= {"last_replayed": use.replayed - 1}
    return yaml_table(
        __package__, "tile.template.yaml", **{name: str(number) for name, number in places.items()}
    )


def _priced(value: Any, profile: hw.Profile) -> Any:
    """Return a part of a tile with events replaced by their energy and latency, in joules and seconds."""
    if isinstance(value, list):
        return [_priced(one, profile) for one in value]
    if not isinstance(value, dict):
        return value
    priced = {}
    for name, entry in value.items():
        if isinstance(entry, str) and entry in _EVENTS:
            priced[f"energy_{name}"] = profile.energy_pj.get(entry, 0.0) * 1e-12
            priced[f"latency_{name}"] = profile.time_ns.get(entry, 0.0) * 1e-9
        else:
            priced[name] = _priced(entry, profile)
    return priced
