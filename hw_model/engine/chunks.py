"""The compiled loops over the lanes of a chunk in one step: how a compartment is updated.

Registers and charges are of one type, 32 or 64 bits: :func:`hw_model.engine.lay_out.fast_layout` knows which one holds
every sum. Charges are in units of 64, the least that a weight can be; ``widths`` are
:class:`hw_model.engine.layout.Widths`.
"""

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_SHIFT
from hw_model.engine.compiled import absorbed
from hw_model.engine.lane_arithmetic import constant_in_32_bits, fit, rz, wrap
from hw_model.engine.layout import FIELDS, LANES, USUAL_WIDTHS

# Offsets of the registers from the first of a chunk; unsigned, or each index would be tested for being negative.
_LANES, _CHUNK = np.uint64(LANES), np.uint64(FIELDS * LANES)
_AT = [np.uint64(field * LANES) for field in range(FIELDS)]  # in the order of the fields of the layout
_KEEP_U, _KEEP_V, _THRESHOLD, _BIAS, _REFRACTORY, _VMIN, _VMAX = _AT[:7]
_U, _V, _POTENTIAL, _BLOCKED, _JOINED = _AT[7:12]
_CHARGE_WRAPS, _CURRENT_WRAPS, _VOLTAGE_CLIPS = _AT[12:]


@absorbed
def _halves(widths, registers):  # type: ignore[no-untyped-def]
    half_charge = constant_in_32_bits(widths.half_charge, USUAL_WIDTHS.half_charge, registers)
    return half_charge, constant_in_32_bits(widths.half_current, USUAL_WIDTHS.half_current, registers)


@absorbed
def _take_charge(registers, k, charge, half_charge, half_current):  # type: ignore[no-untyped-def]
    """Decay u and take the charge of a step into it; return q, and u before and after it wraps."""
    q = wrap(charge, half_charge)
    kept = rz(registers[k + _U], registers[k + _KEEP_U])
    unwrapped = fit(kept + fit(q << WEIGHT_SHIFT, q), q)
    return q, unwrapped, wrap(unwrapped, half_current)


@absorbed
def _take_current(registers, k, u, added, half_current):  # type: ignore[no-untyped-def]
    """Decay v and take u, bias and what children add into it; return the drive, that wrapped, and v before clipping."""
    drive = fit(u + registers[k + _BIAS], u)
    wrapped = wrap(drive, half_current)
    return drive, wrapped, fit(fit(rz(registers[k + _V], registers[k + _KEEP_V]) + wrapped, u) + added, u)


@absorbed
def _clip(registers, k, v):  # type: ignore[no-untyped-def]
    return fit(min(max(v, registers[k + _VMIN]), registers[k + _VMAX]), v)


@absorbed
def _fire(registers, k, v):  # type: ignore[no-untyped-def]
    """Compare v with the threshold, unless blocked; set v and blocked.

    Return whether it spikes, whether it was not blocked, v as the threshold saw it, and both registers ored.
    """
    zero, one = fit(0, v), fit(1, v)
    blocked = registers[k + _BLOCKED]
    live = blocked == 0
    seen = fit(v if live else zero, v)
    fired = live & (v > registers[k + _THRESHOLD])
    held = zero if live else fit(blocked - one, v)
    blocked = fit(registers[k + _REFRACTORY] - one, v) if fired else held
    left = zero if fired else seen
    registers[k + _V] = left
    registers[k + _BLOCKED] = blocked
    return fired, live, seen, fit(left | blocked, v)


@absorbed
def update(registers, at, charge, row, slot, widths):  # type: ignore[no-untyped-def]
    """Update a chunk, whose registers begin at ``at``; return its spikes as bits, how many were busy, 0 if all rest.

    Its charges are taken and set to 0. The loop has no branches and a fixed length, so that it runs in vectors.
    """
    half_charge, half_current = _halves(widths, registers)
    spikes = np.int32(0)
    busy_lanes = np.int32(0)
    restless = fit(0, registers)
    for i in range(_LANES):
        k = at + i
        arrived = charge[row, slot + i]
        charge[row, slot + i] = 0
        added = registers[k + _JOINED]
        registers[k + _JOINED] = 0
        u, v, bias = registers[k + _U], registers[k + _V], registers[k + _BIAS]
        busy = (arrived != 0) | (u != 0) | (v != 0) | (bias != 0) | (added != 0)

        q, unwrapped, u = _take_charge(registers, k, arrived, half_charge, half_current)
        drive, wrapped, unclipped = _take_current(registers, k, u, added, half_current)
        clipped = _clip(registers, k, unclipped)
        fired, live, seen, state = _fire(registers, k, clipped)
        registers[k + _U] = u
        registers[k + _POTENTIAL] = seen
        registers[k + _CHARGE_WRAPS] += fit(q != arrived, v)
        registers[k + _CURRENT_WRAPS] += fit(u != unwrapped, v) + fit(live & (wrapped != drive), v)
        registers[k + _VOLTAGE_CLIPS] += fit(live & (clipped != unclipped), v)
        spikes |= np.int32(fired) << np.int32(i)
        busy_lanes += np.int32(busy)
        restless |= u | state | bias
    return spikes, busy_lanes, restless


@absorbed
def update_plain(registers, at, charge, row, slot):  # type: ignore[no-untyped-def]
    """Do the same for a chunk without bias, refractory steps and children, in which nothing can wrap."""
    spikes = np.int32(0)
    busy_lanes = np.int32(0)
    restless = fit(0, registers)
    for i in range(_LANES):
        k = at + i
        arrived, u, v = charge[row, slot + i], registers[k + _U], registers[k + _V]
        charge[row, slot + i] = 0
        busy_lanes += np.int32((arrived | u | v) != 0)
        u = fit(rz(u, registers[k + _KEEP_U]) + fit(arrived << WEIGHT_SHIFT, u), u)
        unclipped = fit(rz(v, registers[k + _KEEP_V]) + u, u)
        clipped = _clip(registers, k, unclipped)
        fired = clipped > registers[k + _THRESHOLD]
        left = fit(0 if fired else clipped, u)
        registers[k + _U] = u
        registers[k + _V] = left
        registers[k + _POTENTIAL] = clipped
        registers[k + _VOLTAGE_CLIPS] += fit(clipped != unclipped, u)
        spikes |= np.int32(fired) << np.int32(i)
        restless |= u | left
    return spikes, busy_lanes, restless


@absorbed
def add_up(registers, at):  # type: ignore[no-untyped-def]
    """Do the same for a chunk that keeps nothing, and that no synapse reaches: its v is what its children add."""
    spikes = np.int32(0)
    busy_lanes = np.int32(0)
    restless = fit(0, registers)
    for i in range(_LANES):
        k = at + i
        unclipped = registers[k + _JOINED]
        registers[k + _JOINED] = 0
        busy = (registers[k + _V] != 0) | (unclipped != 0)
        clipped = _clip(registers, k, unclipped)
        fired, live, seen, state = _fire(registers, k, clipped)
        registers[k + _POTENTIAL] = seen
        registers[k + _VOLTAGE_CLIPS] += fit(live & (clipped != unclipped), unclipped)
        spikes |= np.int32(fired) << np.int32(i)
        busy_lanes += np.int32(busy)
        restless |= state
    return spikes, busy_lanes, restless


@absorbed
def _respond(registers, k, charge, added, half_charge, half_current):  # type: ignore[no-untyped-def]
    """Take charge and what children add into u and v, and count nothing; return v before any threshold."""
    _, _, u = _take_charge(registers, k, charge, half_charge, half_current)
    _, _, v = _take_current(registers, k, u, added, half_current)
    registers[k + _U] = u
    return _clip(registers, k, v)


@absorbed
def advance(registers, at, charge, row, slot, widths):  # type: ignore[no-untyped-def]
    """Do what :func:`update` does, but count nothing and leave the charge; return spikes as bits, and all state ored.

    What no one will ask for need not be counted, in steps that are run only for their spikes.
    """
    half_charge, half_current = _halves(widths, registers)
    spikes = np.int32(0)
    remains = fit(0, registers)
    for i in range(_LANES):
        k = at + i
        added = registers[k + _JOINED]
        registers[k + _JOINED] = 0
        v = _respond(registers, k, charge[row, slot + i], added, half_charge, half_current)
        fired, _, seen, state = _fire(registers, k, v)
        registers[k + _POTENTIAL] = seen
        spikes |= np.int32(fired) << np.int32(i)
        remains |= registers[k + _U] | state
    return spikes, remains


@absorbed
def advance_pair(registers, at, charge, row, slot, other_slot, widths):  # type: ignore[no-untyped-def]
    """Do the same for two chunks of dendrites, whose registers follow each other, and a third that is only their sum.

    This is how a spike response neuron is lowered: its alpha dendrite, its refractory dendrite, and its soma.
    """
    zero = fit(0, registers)
    half_charge, half_current = _halves(widths, registers)
    # First next to the registers: two places in one array at an unknown distance would keep the loop from vectors.
    for i in range(_LANES):
        registers[at + _JOINED + i] = charge[row, slot + i]
    for i in range(_LANES):
        registers[at + _CHUNK + _JOINED + i] = charge[row, other_slot + i]
    spikes = np.int32(0)
    remains = zero
    for i in range(_LANES):
        k = at + i
        other = k + _CHUNK
        soma = other + _CHUNK
        v = _respond(registers, k, registers[k + _JOINED], zero, half_charge, half_current)
        registers[k + _V] = v
        v_other = _respond(registers, other, registers[other + _JOINED], zero, half_charge, half_current)
        registers[other + _V] = v_other
        total = _clip(registers, soma, fit(v + v_other, v))
        spikes |= np.int32(total > registers[soma + _THRESHOLD]) << np.int32(i)
        remains |= registers[k + _U] | v | registers[other + _U] | v_other
    return spikes, remains


@absorbed
def pass_on(registers, child, parent):  # type: ignore[no-untyped-def]
    """Add the voltages of a chunk to its parent's."""
    for i in range(_LANES):
        registers[parent + _JOINED + i] += registers[child + _V + i]
