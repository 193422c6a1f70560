"""The compiled loops over the lanes of a chunk in one step: how a compartment is updated.

Charges are in units of 64, the least that a weight can be: wrapping q to 21 bits plus sign is then taking the low 16
bits.
"""

from __future__ import annotations

import numpy as np

from hw_model.engine.compiled import absorbed, inlined
from hw_model.engine.layout import (
    BIAS,
    BLOCKED,
    CHARGE_WRAPS,
    CURRENT_WRAPS,
    FIELDS,
    JOINED,
    KEEP_U,
    KEEP_V,
    LANES,
    POTENTIAL,
    REFRACTORY,
    THRESHOLD,
    VMAX,
    VMIN,
    VOLTAGE_CLIPS,
    U,
    V,
)
from hw_model.engine.registers32 import rz, wrap24

# Offsets of the registers from the first of a chunk; unsigned, or each index would be tested for being negative.
_LANES, _CHUNK = np.uint64(LANES), np.uint64(FIELDS * LANES)
_KEEP_U, _KEEP_V = np.uint64(KEEP_U * LANES), np.uint64(KEEP_V * LANES)
_THRESHOLD, _BIAS, _REFRACTORY = np.uint64(THRESHOLD * LANES), np.uint64(BIAS * LANES), np.uint64(REFRACTORY * LANES)
_VMIN, _VMAX = np.uint64(VMIN * LANES), np.uint64(VMAX * LANES)
_U, _V, _POTENTIAL = np.uint64(U * LANES), np.uint64(V * LANES), np.uint64(POTENTIAL * LANES)
_BLOCKED, _JOINED = np.uint64(BLOCKED * LANES), np.uint64(JOINED * LANES)
_CHARGE_WRAPS, _CURRENT_WRAPS = np.uint64(CHARGE_WRAPS * LANES), np.uint64(CURRENT_WRAPS * LANES)
_VOLTAGE_CLIPS = np.uint64(VOLTAGE_CLIPS * LANES)


@absorbed
def update(registers, at, charge, row, slot):  # type: ignore[no-untyped-def]
    """Update a chunk, whose registers begin at ``at``; return its spikes as bits, how many were busy, 0 if all rest.

    Its charges are taken and set to 0. The loop has no branches and a fixed length, so that it runs in vectors.
    """
    spikes = np.int32(0)
    busy_lanes = np.int32(0)
    restless = np.int32(0)
    for i in range(_LANES):
        k = at + i
        arrived = charge[row, slot + i]
        charge[row, slot + i] = 0
        added = registers[k + _JOINED]
        registers[k + _JOINED] = 0
        u, v, bias = registers[k + _U], registers[k + _V], registers[k + _BIAS]
        busy = (arrived != 0) | (u != 0) | (v != 0) | (bias != 0) | (added != 0)

        q = np.int32(np.int16(arrived))
        unwrapped = np.int32(rz(u, registers[k + _KEEP_U]) + np.int32(q << np.int32(6)))
        u = wrap24(unwrapped)
        drive = np.int32(u + bias)
        wrapped = wrap24(drive)
        unclipped = np.int32(np.int32(rz(v, registers[k + _KEEP_V]) + wrapped) + added)
        clipped = np.int32(min(max(unclipped, registers[k + _VMIN]), registers[k + _VMAX]))

        blocked = registers[k + _BLOCKED]
        live = blocked == 0
        seen = np.int32(clipped if live else np.int32(0))
        fired = live & (clipped > registers[k + _THRESHOLD])
        held = np.int32(0) if live else np.int32(blocked - np.int32(1))
        blocked = np.int32(registers[k + _REFRACTORY] - np.int32(1)) if fired else held
        registers[k + _U] = u
        registers[k + _V] = np.int32(0) if fired else seen
        registers[k + _POTENTIAL] = seen
        registers[k + _BLOCKED] = blocked
        registers[k + _CHARGE_WRAPS] += np.int32(q != arrived)
        registers[k + _CURRENT_WRAPS] += np.int32(u != unwrapped) + np.int32(live & (wrapped != drive))
        registers[k + _VOLTAGE_CLIPS] += np.int32(live & (clipped != unclipped))
        spikes |= np.int32(fired) << np.int32(i)
        busy_lanes += np.int32(busy)
        restless |= u | registers[k + _V] | blocked | bias
    return spikes, busy_lanes, restless


@absorbed
def add_up(registers, at):  # type: ignore[no-untyped-def]
    """Do the same for a chunk that keeps nothing, and that no synapse reaches: its v is what its children add."""
    spikes = np.int32(0)
    busy_lanes = np.int32(0)
    restless = np.int32(0)
    for i in range(_LANES):
        k = at + i
        unclipped = registers[k + _JOINED]
        registers[k + _JOINED] = 0
        busy = (registers[k + _V] != 0) | (unclipped != 0)
        clipped = np.int32(min(max(unclipped, registers[k + _VMIN]), registers[k + _VMAX]))
        blocked = registers[k + _BLOCKED]
        live = blocked == 0
        seen = np.int32(clipped if live else np.int32(0))
        fired = live & (clipped > registers[k + _THRESHOLD])
        held = np.int32(0) if live else np.int32(blocked - np.int32(1))
        blocked = np.int32(registers[k + _REFRACTORY] - np.int32(1)) if fired else held
        registers[k + _V] = np.int32(0) if fired else seen
        registers[k + _POTENTIAL] = seen
        registers[k + _BLOCKED] = blocked
        registers[k + _VOLTAGE_CLIPS] += np.int32(live & (clipped != unclipped))
        spikes |= np.int32(fired) << np.int32(i)
        busy_lanes += np.int32(busy)
        restless |= registers[k + _V] | blocked
    return spikes, busy_lanes, restless


@inlined
def _respond(registers, k, charge, added):  # type: ignore[no-untyped-def]
    """Take charge and what children add into u and v, and count nothing; return v before any threshold."""
    u = wrap24(rz(registers[k + _U], registers[k + _KEEP_U]) + np.int32(np.int32(np.int16(charge)) << np.int32(6)))
    wrapped = wrap24(np.int32(u + registers[k + _BIAS]))
    v = np.int32(np.int32(rz(registers[k + _V], registers[k + _KEEP_V]) + wrapped) + added)
    registers[k + _U] = u
    return np.int32(min(max(v, registers[k + _VMIN]), registers[k + _VMAX]))


@absorbed
def advance(registers, at, charge, row, slot):  # type: ignore[no-untyped-def]
    """Do what :func:`update` does, but count nothing and leave the charge; return spikes as bits, and all state ored.

    What no one will ask for need not be counted, in steps that are run only for their spikes.
    """
    spikes = np.int32(0)
    remains = np.int32(0)
    for i in range(_LANES):
        k = at + i
        added = registers[k + _JOINED]
        registers[k + _JOINED] = 0
        v = _respond(registers, k, charge[row, slot + i], added)
        blocked = registers[k + _BLOCKED]
        live = blocked == 0
        fired = live & (v > registers[k + _THRESHOLD])
        v = np.int32(v if live & (not fired) else np.int32(0))
        held = np.int32(0) if live else np.int32(blocked - np.int32(1))
        blocked = np.int32(registers[k + _REFRACTORY] - np.int32(1)) if fired else held
        registers[k + _V] = v
        registers[k + _BLOCKED] = blocked
        spikes |= np.int32(fired) << np.int32(i)
        remains |= registers[k + _U] | v | blocked
    return spikes, remains


@absorbed
def advance_pair(registers, at, charge, row, slot, other_slot):  # type: ignore[no-untyped-def]
    """Do the same for two chunks of dendrites, whose registers follow each other, and a third that is only their sum.

    This is how a spike response neuron is lowered: its alpha dendrite, its refractory dendrite, and its soma.
    """
    # First beside the registers: two places in one array at an unknown distance would keep the loop from vectors.
    for i in range(_LANES):
        registers[at + _JOINED + i] = charge[row, slot + i]
    for i in range(_LANES):
        registers[at + _CHUNK + _JOINED + i] = charge[row, other_slot + i]
    spikes = np.int32(0)
    remains = np.int32(0)
    for i in range(_LANES):
        k = at + i
        other = k + _CHUNK
        soma = other + _CHUNK
        v = _respond(registers, k, registers[k + _JOINED], np.int32(0))
        registers[k + _V] = v
        v_other = _respond(registers, other, registers[other + _JOINED], np.int32(0))
        registers[other + _V] = v_other
        total = np.int32(v + v_other)
        total = np.int32(min(max(total, registers[soma + _VMIN]), registers[soma + _VMAX]))
        spikes |= np.int32(total > registers[soma + _THRESHOLD]) << np.int32(i)
        remains |= registers[k + _U] | v | registers[other + _U] | v_other
    return spikes, remains


@absorbed
def pass_on(registers, child, parent):  # type: ignore[no-untyped-def]
    """Add the voltages of a chunk to its parent's."""
    for i in range(_LANES):
        registers[parent + _JOINED + i] += registers[child + _V + i]
