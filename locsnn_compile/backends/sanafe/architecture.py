"""The chip as an architecture file of SANA-FE: its mesh, tiles and cores, priced by an energy profile.

Input spikes come from outside the chip, but SANA-FE's can only come from cores. So every tile in use has one core more,
the host's, whose somas play the input lines of that tile for no energy and no time: their packets travel no hop.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

from hw_model.description.chip import Chip
from hw_model.description.profile import Profile
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
LINK_BUFFER = 16


class TileUse(Frozen):
    """What a tile holds: ``lines`` input lines on its host core, and up to ``replayed`` compartments a core."""

    lines: int
    replayed: int


def priced_by(chip: Chip) -> Profile:
    """Return the profile ``sanafe`` of a chip, or say that it has none that SANA-FE can follow."""
    if PROFILE not in chip.profiles or not set(chip.profiles[PROFILE].energy_pj) <= set(PRICED):
        what = f"it has no energy profile {PROFILE!r} that prices what SANA-FE counts"
        fix = f"Copy the profile {PROFILE!r} of loihi-sim into the chip file."
        raise InputError(f"chip {chip.name}", what, fix=fix)
    return chip.profiles[PROFILE]


def tile_number(chip: Chip, slot: int) -> int:
    """Return SANA-FE's number of a core's tile: it counts a column from its first row on, then the next column."""
    column, row = chip.tile_of(slot)
    return column * chip.mesh.rows + row


def architecture(chip: Chip, uses: Mapping[int, TileUse]) -> str:
    """Return the architecture file; ``uses[tile]`` says what is on each tile in use, by SANA-FE's numbers."""
    profile = priced_by(chip)
    return "\n".join(_lines(chip, profile, uses)) + "\n"


def _lines(chip: Chip, profile: Profile, uses: Mapping[int, TileUse]) -> Iterator[str]:
    columns = chip.mesh.columns * chip.chips
    yield "architecture:"
    yield "  name: chip"
    yield "  attributes:"
    yield f"    width: {columns}"
    yield f"    height: {chip.mesh.rows}"
    yield f"    link_buffer_size: {LINK_BUFFER}"
    yield "    sync_model: table"
    barriers = (profile.barrier_ns.ns(n, chip.mesh.tiles) for n in range(1, len(uses) + 1))
    yield f"    latency_sync: {{{', '.join(f'{n}: {ns * 1e-9!r}' for n, ns in enumerate(barriers, start=1))}}}"
    yield "  tile:"
    for use, tiles in groupby(range(columns * chip.mesh.rows), key=uses.get):
        numbers = list(tiles)
        yield f"    - name: tile[{numbers[0]}..{numbers[-1]}]"
        yield from _attributes(_hop_costs(profile), indent=6)
        yield "      core:"
        yield from _core(profile, f"core[0..{chip.mesh.cores_per_tile - 1}]", use.replayed if use else 0)
        if use and use.lines:
            yield from _host(use.lines)


def _hop_costs(profile: Profile) -> dict[str, str]:
    ways = {"east": "hops_x", "west": "hops_x", "north": "hops_y", "south": "hops_y"}
    return _costs(profile, {f"{way}_hop": count for way, count in ways.items()})


def _core(profile: Profile, name: str, replayed: int) -> Iterator[str]:
    """Yield a core of the chip. Dendrites add up charge and hold it until the step in which it is due."""
    yield f"        - name: {name}"
    buffer = {"buffer_position": "dendrite", "buffer_inside_unit": "true", "max_neurons_supported": str(UNIT_SIZE)}
    yield from _attributes(buffer, indent=10)
    # A profile prices the energy of a packet once; all of it is put on the sender.
    arrives = {"energy_message_in": "0.0", "latency_message_in": _seconds(profile, "packets_received")}
    yield from _unit("axon_in", "axon_in", arrives)
    synapse = _costs(profile, {"process_spike": "synaptic_ops"})
    yield from _unit("synapse", SYNAPSE, {"model": "current_based", **synapse})
    dendrite = {"model": "accumulator_with_delay", "energy_update": "0.0", "latency_update": "0.0"}
    yield from _unit("dendrite", DENDRITE, dendrite)
    costs = _costs(profile, SOMA_EVENTS)
    somas = [(SOMA, {"model": "leaky_integrate_fire", **costs})]
    if replayed:
        somas.append((f"{REPLAY}[0..{replayed - 1}]", {"model": "input", **costs}))
    yield from _units("soma", somas)
    yield from _unit("axon_out", "axon_out", _costs(profile, {"message_out": "axon_packets"}))


def _host(lines: int) -> Iterator[str]:
    yield "        - name: host"
    yield from _attributes(
        {"buffer_position": "soma", "buffer_inside_unit": "false", "max_neurons_supported": str(lines)}, indent=10
    )
    yield from _unit("axon_in", "axon_in", {"energy_message_in": "0.0", "latency_message_in": "0.0"})
    free = {"energy_process_spike": "0.0", "latency_process_spike": "0.0"}
    yield from _unit("synapse", SYNAPSE, {"model": "current_based", **free})
    yield from _unit("dendrite", DENDRITE, {"model": "accumulator", "energy_update": "0.0", "latency_update": "0.0"})
    free = {f"{kind}_{event}": "0.0" for event in SOMA_EVENTS for kind in ("energy", "latency")}
    yield from _unit("soma", f"{LINE}[0..{lines - 1}]", {"model": "input", **free})
    yield from _unit("axon_out", "axon_out", {"energy_message_out": "0.0", "latency_message_out": "0.0"})


def _unit(section: str, name: str, attributes: Mapping[str, str]) -> Iterator[str]:
    yield from _units(section, [(name, attributes)])


def _units(section: str, units: Sequence[tuple[str, Mapping[str, str]]]) -> Iterator[str]:
    yield f"          {section}:"
    for name, attributes in units:
        yield f"            - name: {name}"
        yield from _attributes(attributes, indent=14)


def _attributes(attributes: Mapping[str, str], indent: int) -> Iterator[str]:
    yield " " * indent + "attributes:"
    yield from (" " * (indent + 2) + f"{name}: {value}" for name, value in attributes.items())


def _costs(profile: Profile, counts: Mapping[str, str]) -> dict[str, str]:
    """Return the energy and the latency of every event, in joules and seconds, from the counts that price it."""
    found = {}
    for event, count in counts.items():
        found[f"energy_{event}"] = repr(profile.energy_pj.get(count, 0.0) * 1e-12)
        found[f"latency_{event}"] = _seconds(profile, count)
    return found


def _seconds(profile: Profile, count: str) -> str:
    return repr(profile.time_ns.get(count, 0.0) * 1e-9)
