"""``--emit sanafe``: write the chip and each phase of a program as files for SANA-FE 2.2, and the results to expect.

SANA-FE is a simulator of neuromorphic chips that counts operations and energy. A phase whose spikes its neurons would
find is computed; any other phase is replayed: its neurons play back the spikes that our simulator found, and SANA-FE
counts the traffic.
"""

import math
from collections.abc import Mapping

import yaml

from hw_model.description.profile import Profile
from locsnn_compile.backends.played import Played, unique_names
from locsnn_compile.backends.sanafe.architecture import (
    PROFILE,
    TileUse,
    architecture,
    priced_by,
    tile_number,
)
from locsnn_compile.backends.sanafe.network import PhaseNetwork
from locsnn_compile.backends.sanafe.rules import UNIT_SIZE, obstacles, updates
from locsnn_compile.errors import check_most

FOLDER = "sanafe"
PARTS = {
    "synapse": ("synaptic_ops",),
    "soma": ("neuron_updates", "neuron_updates_active", "spikes"),
    "network": ("axon_packets", "hops_x", "hops_y"),
}
"""Parts of SANA-FE's energy, with the counts that each adds up."""


def sanafe_files(played: Played) -> dict[str, bytes]:
    """Return the content of the files by name, in the folder ``sanafe``."""
    program = played.program
    profile = priced_by(program.chip)
    largest_core = max(core.compartments for core in program.cores)
    what = "a core has more compartments than SANA-FE's units hold"
    check_most(largest_core, UNIT_SIZE, "--emit sanafe", what, fix="Leave it out for this chip.")
    # A phase that SANA-FE's neurons cannot compute is replayed; these are the reasons.
    reasons = {phase.name: obstacles(played, phase.name) for phase in played.phases}
    networks = {
        phase: PhaseNetwork(played, phase, replayed=bool(reasons[phase])) for phase in reasons
    }
    names = unique_names(networks)
    expected_by_phase = []
    for phase, network in networks.items():
        results = _expected(played, phase, network, reasons[phase], profile)
        expected_by_phase.append({"file": f"{names[phase]}.yaml", **results})
    expected = {"profile": PROFILE, "phases": expected_by_phase}
    first_phase = played.phases[0].name
    texts = {
        "README.md": played.readme(
            __package__,
            profile=PROFILE,
            first=names[first_phase],
            steps=str(played.steps(first_phase)),
        ),
        "arch.yaml": architecture(program.chip, _uses(played, networks, reasons)),
        **{f"{names[phase]}.yaml": network.text() for phase, network in networks.items()},
        "expected.yaml": yaml.safe_dump(expected, sort_keys=False, width=120),
    }
    return {f"{FOLDER}/{name}": text.encode() for name, text in texts.items()}


def _uses(
    played: Played, networks: Mapping[str, PhaseNetwork], reasons: Mapping[str, list[str]]
) -> dict[int, TileUse]:
    """Return what each tile must hold for any of the phases, which are loaded one at a time.

    ``reasons[phase]`` say why a phase is replayed; without any, it is computed.
    """
    program = played.program
    uses: dict[int, TileUse] = {}
    for phase, network in networks.items():
        lines = network.lines_by_tile()
        for core in program.cores_of(phase):
            tile = tile_number(program.chip, core.slot)
            largest = uses.get(tile, TileUse(lines=0, replayed=0))
            replayed = core.compartments if reasons[phase] else 0
            uses[tile] = TileUse(
                lines=max(largest.lines, lines.get(tile, 0)),
                replayed=max(largest.replayed, replayed),
            )
    return uses


def _expected(
    played: Played, phase: str, network: PhaseNetwork, why_replayed: list[str], profile: Profile
) -> dict[str, object]:
    """Return the results that SANA-FE must give for a phase, and next to them the figures of our report.

    SANA-FE's figures differ in two ways. It counts active updates by rules of its own, so the energy of its somas
    differs as well. And input lines are neurons to it, which fire and are updated, but take no energy.
    """
    counts = played.result.counts_by_phase[phase]
    if why_replayed:
        # A soma that plays spikes back is updated only when it spikes.
        active_updates = counts.spikes
    else:
        active_updates = sum(updates(core, played) for core in played.program.cores_of(phase))
    energy = {
        part: math.fsum(counts[name] * profile.energy_pj.get(name, 0.0) for name in names)
        for part, names in PARTS.items()
    }
    pj_per_update = profile.energy_pj.get("neuron_updates_active", 0.0)
    # Negative where SANA-FE counts fewer active updates than the chip.
    extra_energy_pj = (active_updates - counts.neuron_updates_active) * pj_per_update
    input_spikes = network.input_spikes()
    return {
        "phase": phase,
        "first_step": played.runs[phase].start,
        "steps": played.steps(phase),
        "neurons": "replayed" if why_replayed else "simulated",
        "because": why_replayed,
        "counts": {
            "neurons_fired": counts.spikes + input_spikes,
            "neurons_updated": active_updates + input_spikes,
            "packets_sent": counts.axon_packets + counts.input_packets,
            "hops": counts.hops,
            "spikes": counts.synaptic_ops,
        },
        "energy_pj": {**energy, "soma": energy["soma"] + extra_energy_pj},
        "report": {
            "neuron_updates_active": counts.neuron_updates_active,
            "energy_pj": dict(energy),
        },
    }
