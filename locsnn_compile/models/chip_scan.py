"""A population's steps in the chip's integers, compiled: one function a strategy, and the way back for the gradient.

The scans take charges (batch, steps, n), int32 in units of 64, that the spikes of each step send on: what step t sends
arrives at step t + 1. A step is that of ``hw_model``: q and u wrap, v is clipped, a spike where v > threshold; ``keep``
is 4096 less a decay, and ``ends`` are :func:`register_ends`. They fill ``potential`` (int32), v at the threshold before
any reset, ``spikes`` (uint8) and ``live`` (uint8, 0 in a refractory step), all (batch, steps, n), and add to ``events``
(3,): charge wraps, current wraps and voltage clips of all compartments of the population.
"""

from __future__ import annotations

import numpy as np

from hw_model.arithmetic.fixed_point import WEIGHT_SHIFT
from hw_model.engine.compiled import compiled, inlined
from hw_model.engine.lane_arithmetic import rz, wrap
from locsnn_compile.models.chip_numbers import RegisterWidths

Ends = tuple[np.int32, np.int32, np.int32]


def register_ends(registers: RegisterWidths) -> Ends:
    """Return 2^bits of q, in units of 64, and of u, and the largest v."""
    return (
        np.int32(1 << (registers.charge_bits - WEIGHT_SHIFT)),
        np.int32(1 << registers.current_bits),
        np.int32((1 << registers.voltage_bits) - 1),
    )


@inlined
def _clip(x, last):  # type: ignore[no-untyped-def]
    """Return x within the voltage register's limits."""
    return np.int32(min(max(x, np.int32(-last)), last))


@compiled
def scan_dendrite(charge, constants, ends, potential, spikes, live, events):  # type: ignore[no-untyped-def]
    """An alpha and a refractory dendrite, added by a memoryless soma whose spikes drive the refractory one.

    ``constants``: keep of the alpha dendrite, keep of the refractory one, the charge of an own spike, the threshold.
    """
    keep, pull_keep, own_charge, threshold = constants
    half_charge, half_current, last = ends
    batch, steps, n = charge.shape
    u, v, pull_u, pull_v, fired = (
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
    )
    wraps_q, wraps_u, clips = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    silence, own = np.zeros(n, np.int32), wrap(own_charge, half_charge)
    own_wraps = np.int32(own != own_charge)
    many = np.uint64(n)
    live[:] = 1
    for b in range(batch):
        for state in (u, v, pull_u, pull_v, fired):
            state[:] = 0
        for t in range(steps):
            arrived = charge[b, t - 1] if t else silence
            for i in range(many):
                q = wrap(arrived[i], half_charge)
                current = np.int32(rz(u[i], keep) + np.int32(q << np.int32(6)))
                u[i] = wrap(current, half_current)
                voltage = np.int32(rz(v[i], keep) + u[i])
                v[i] = _clip(voltage, last)
                pull_q = np.int32(own * fired[i])
                pull_current = np.int32(rz(pull_u[i], pull_keep) + np.int32(pull_q << np.int32(6)))
                pull_u[i] = wrap(pull_current, half_current)
                pull_voltage = np.int32(rz(pull_v[i], pull_keep) + pull_u[i])
                pull_v[i] = _clip(pull_voltage, last)
                soma = np.int32(v[i] + pull_v[i])
                seen = _clip(soma, last)

                wraps_q[i] += np.int32(q != arrived[i]) + np.int32(own_wraps * fired[i])
                wraps_u[i] += np.int32(u[i] != current) + np.int32(pull_u[i] != pull_current)
                clips[i] += np.int32(v[i] != voltage) + np.int32(pull_v[i] != pull_voltage) + np.int32(seen != soma)
                fired[i] = np.int32(seen > threshold)
                potential[b, t, i] = seen
                spikes[b, t, i] = np.uint8(fired[i])
    _add(events, wraps_q, wraps_u, clips)


@compiled
def scan_delay_line(charge, constants, ends, taps, potential, spikes, live, events):  # type: ignore[no-untyped-def]
    """An alpha dendrite and a memoryless soma, whose spikes come back to the dendrite through delayed synapses.

    ``constants``: keep of the dendrite, the threshold. ``taps`` (2, k), int32: delays, and charges in units of 64.
    """
    keep, threshold = constants
    half_charge, half_current, last = ends
    batch, steps, n = charge.shape
    due = np.zeros((steps + 1 + taps[0].max(), n), np.int32)
    u, v, fired = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    wraps_q, wraps_u, clips = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    many = np.uint64(n)
    live[:] = 1
    for b in range(batch):
        u[:] = 0
        v[:] = 0
        due[0] = 0
        due[1 : steps + 1] = charge[b]
        due[steps + 1 :] = 0
        for t in range(steps):
            any_fired = np.int32(0)
            for i in range(many):
                q = wrap(due[t, i], half_charge)
                current = np.int32(rz(u[i], keep) + np.int32(q << np.int32(6)))
                u[i] = wrap(current, half_current)
                voltage = np.int32(rz(v[i], keep) + u[i])
                v[i] = _clip(voltage, last)
                wraps_q[i] += np.int32(q != due[t, i])
                wraps_u[i] += np.int32(u[i] != current)
                clips[i] += np.int32(v[i] != voltage)
                fired[i] = np.int32(v[i] > threshold)
                any_fired |= fired[i]
                potential[b, t, i] = v[i]
                spikes[b, t, i] = np.uint8(fired[i])
            if any_fired:
                for k in range(taps.shape[1]):
                    row = np.uint64(t + 1 + taps[0, k])
                    for i in range(many):
                        due[row, i] += np.int32(taps[1, k] * fired[i])
    _add(events, wraps_q, wraps_u, clips)


@compiled
def scan_reset(charge, constants, ends, potential, spikes, live, events):  # type: ignore[no-untyped-def]
    """One compartment with the chip's own reset and refractory count.

    ``constants``: keep of u, keep of v, the threshold, the refractory count.
    """
    keep_u, keep_v, threshold, refractory = constants
    half_charge, half_current, last = ends
    batch, steps, n = charge.shape
    u, v, blocked = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    wraps_q, wraps_u, clips = np.zeros(n, np.int32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    silence = np.zeros(n, np.int32)
    many = np.uint64(n)
    for b in range(batch):
        for state in (u, v, blocked):
            state[:] = 0
        for t in range(steps):
            arrived = charge[b, t - 1] if t else silence
            for i in range(many):
                q = wrap(arrived[i], half_charge)
                current = np.int32(rz(u[i], keep_u) + np.int32(q << np.int32(6)))
                u[i] = wrap(current, half_current)
                voltage = np.int32(rz(v[i], keep_v) + u[i])
                clipped = _clip(voltage, last)
                open_now = blocked[i] == 0
                seen = np.int32(clipped if open_now else np.int32(0))
                fired = open_now & (clipped > threshold)

                wraps_q[i] += np.int32(q != arrived[i])
                wraps_u[i] += np.int32(u[i] != current)
                clips[i] += np.int32(open_now & (clipped != voltage))
                v[i] = np.int32(0) if fired else seen
                held = np.int32(0) if open_now else np.int32(blocked[i] - np.int32(1))
                blocked[i] = np.int32(refractory - np.int32(1)) if fired else held
                potential[b, t, i] = seen
                spikes[b, t, i] = np.uint8(fired)
                live[b, t, i] = np.uint8(open_now)
    _add(events, wraps_q, wraps_u, clips)


@inlined
def _add(events, wraps_q, wraps_u, clips):  # type: ignore[no-untyped-def]
    events[0] += wraps_q.sum()
    events[1] += wraps_u.sum()
    events[2] += clips.sum()


@compiled
def charge_gradient(gradient, carry, constants, found):  # type: ignore[no-untyped-def]
    """Write into ``found`` the gradient by the charge that each step sends on, of that by v, both (batch, steps, n).

    The linear step, backwards: dv(t) = gradient(t) + keep_v * carry(t) * dv(t + 1), du(t) = dv(t) + keep_u * du(t + 1)
    and, one step of latency later, found(t) = du(t + 1). ``carry`` (uint8) is 0 where v is reset and does not go on.
    ``constants``: keep_u and keep_v as fractions, and 0, in the type of ``gradient``.
    """
    keep_u, keep_v, zero = constants
    batch, steps, n = gradient.shape
    du, dv = np.zeros(n, gradient.dtype), np.zeros(n, gradient.dtype)
    many = np.uint64(n)
    for b in range(batch):
        du[:] = zero
        dv[:] = zero
        for t in range(steps - 1, -1, -1):
            for i in range(many):
                found[b, t, i] = du[i]
                kept = keep_v * dv[i] if carry[b, t, i] else zero
                dv[i] = gradient[b, t, i] + kept
                du[i] = dv[i] + keep_u * du[i]
