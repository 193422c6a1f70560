"""Describe the chip in an architecture file of SANA-FE, a simulator of neuromorphic chips: mesh, tiles, cores, costs.

Costs come from an energy profile of the chip. Input spikes come from outside the chip, but in SANA-FE spikes can only
come from cores. So every tile in use has one extra core, the host's, whose somas play the input lines of that tile
without energy or time, and without hops.
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

SYNAPSE = "synapse"
DENDRITE = "dendrite"
SOMA = "soma"
"""Names of the three units of a core through which the spikes of a compartment pass."""
REPLAY = "replay"
"""Name of a soma that plays spikes back instead of computing them."""
LINE = "line"
"""Name of the host's soma for an input line."""
PROFILE = "sanafe"
"""Name of the profile whose costs SANA-FE can follow."""
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
"""Values in the template of a tile that stand for a cost: counts, and ``free``, which costs nothing in any profile."""
LINK_BUFFER = 16
"""Packets that a link of the mesh can hold, chosen by hand: SANA-FE asks for a number, and only its times depend on it,
which are not compared."""


class TileUse(Frozen):
    """What a tile must hold: ``lines`` input lines on its host core, and up to ``replayed`` compartments per core."""

    lines: int
    replayed: int


def priced_by(chip: hw.Chip) -> hw.Profile:
    """Return the profile ``sanafe`` of a chip. Raise InputError if it has none that SANA-FE can follow."""
    if PROFILE not in chip.profiles or not set(chip.profiles[PROFILE].energy_pj) <= set(PRICED):
        what = f"it has no energy profile {PROFILE!r} that prices what SANA-FE counts"
        fix = f"Copy the profile {PROFILE!r} of loihi-sim into the chip file."
        raise InputError(f"chip {chip.name}", what, fix=fix)
    return chip.profiles[PROFILE]


def tile_number(chip: hw.Chip, slot: int) -> int:
    """Return SANA-FE's number of the tile of a core, given the core's slot; it counts tiles column by column."""
    column, row = chip.tile_of(slot)
    return column * chip.mesh.rows + row


def architecture(chip: hw.Chip, uses: Mapping[int, TileUse]) -> str:
    """Return the architecture file; ``uses`` says what each tile in use must hold, by SANA-FE's number of the tile."""
    profile = priced_by(chip)
    # The chips of a board lie side by side.
    columns = chip.mesh.columns * chip.chips
    # The time of the barrier at the end of a step, by the number of tiles in use.
    barrier_seconds = {
        tiles_in_use: profile.barrier_ns.ns(tiles_in_use, chip.mesh.tiles) * 1e-9
        for tiles_in_use in range(1, len(uses) + 1)
    }
    attributes = {
        "width": columns,
        "height": chip.mesh.rows,
        "link_buffer_size": LINK_BUFFER,
        "sync_model": "table",
        "latency_sync": barrier_seconds,
    }
    tiles = []
    # Neighbouring tiles with equal use are one entry, which keeps the file small.
    for use_or_none, numbers in groupby(range(columns * chip.mesh.rows), key=uses.get):
        use = use_or_none or TileUse(lines=0, replayed=0)
        tile: Any = _priced(_tile(chip, list(numbers), use), profile)
        chip_core, _ = tile["core"]
        # SANA-FE cannot have a range of no units.
        if not use.replayed:
            del chip_core["soma"][1]
        if not use.lines:
            del tile["core"][1]
        tiles.append(tile)
    return yaml.safe_dump(
        {"architecture": {"name": "chip", "attributes": attributes, "tile": tiles}}, sort_keys=False
    )


def _tile(chip: hw.Chip, numbers: list[int], use: TileUse) -> Any:
    """Return the entry of neighbouring tiles with these numbers, in which costs still have their names."""
    values = {
        "first": numbers[0],
        "last": numbers[-1],
        "last_core": chip.mesh.cores_per_tile - 1,
        "unit_size": UNIT_SIZE,
        "lines": use.lines,
        "last_line": use.lines - 1,
        "last_replayed": use.replayed - 1,
    }
    texts = {name: str(number) for name, number in values.items()}
    return yaml_table(__package__, "tile.template.yaml", **texts)


def _priced(value: Any, profile: hw.Profile) -> Any:
    """Return a part of a tile with the names of costs replaced by energy and latency, in joules and seconds.

    ``process_spike: synaptic_ops`` becomes ``energy_process_spike`` and ``latency_process_spike``.
    """
    if isinstance(value, list):
        return [_priced(item, profile) for item in value]
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
