"""Compiled loops over the steps of leaky integrate-and-fire (LIF) neurons, forward and backward.

The recursion and its gradient are explained in ``models.lif``, which calls these loops. There are two variants:

- ``scan`` and ``scan_back`` take the drive, that is, the weighted sums of the inputs in every step, which a matrix
  product has computed for all steps at once.
- ``scan_active`` and ``scan_active_back`` take the spikes and the weights, and add up the weights of the active inputs
  step by step. That is faster for large layers, because most inputs are silent in most steps.

Arrays are (batch, steps, n) unless stated otherwise, with n the number of neurons. ``constants`` are (keep, threshold,
0, 1) forward and (keep, threshold, window, 0) backward, with ``keep`` the share of the potential that a step keeps and
``window`` half the width of the surrogate gradient's rectangle, see
:class:`~locsnn_compile.models.description.LifParameters`. They come as arguments in the float type of the arrays,
because literals would make the loops compute in float64.
"""

import numpy as np

from hw_model.engine.compiled import absorbed, compiled, compiled_with_arrays


@absorbed
def _step(arrived, constants, voltage, potential, spikes):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Take one step of n neurons: update ``voltage``, and fill ``potential`` and ``spikes``, all (n,).

    ``potential`` is u before the reset, which the gradient needs; ``voltage`` is u after it, for the next step.
    """
    keep, threshold, zero, one = constants
    for i in range(len(voltage)):
        u = keep * voltage[i] + arrived[i]
        fired = u > threshold
        potential[i] = u
        spikes[i] = one if fired else zero
        voltage[i] = zero if fired else u


@absorbed
def _step_back(gradient, potential, constants, by_u):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Replace ``by_u``, the gradient by u(t + 1), by the gradient by u(t); all arrays are (n,).

    ``gradient`` is the gradient by the spikes of step t, and ``potential`` is u(t).
    """
    keep, threshold, window, zero = constants
    for i in range(len(by_u)):
        u = potential[i]
        by_kept = keep * by_u[i]
        # A spike has two effects: what it sends to others, and the reset, which takes away the share of
        # u that the next step would have kept.
        by_spike = gradient[i] - u * by_kept
        # After a spike, nothing of u reaches the next step.
        through_potential = zero if u > threshold else by_kept
        through_spike = by_spike if abs(u - threshold) < window else zero
        by_u[i] = through_potential + through_spike


@compiled_with_arrays
def scan(drive, constants, potential, spikes):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Fill ``potential`` and ``spikes`` for ``drive``, the weighted sums that the inputs of each step send."""
    batch, steps, size = drive.shape
    voltage = np.empty(size, drive.dtype)
    silence = np.zeros(size, drive.dtype)
    for recording in range(batch):
        voltage[:] = 0
        for t in range(steps):
            # What is sent in a step arrives in the next.
            arrived = drive[recording, t - 1] if t else silence
            _step(arrived, constants, voltage, potential[recording, t], spikes[recording, t])


@compiled_with_arrays
def scan_back(gradient, potential, constants, by_drive):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Fill ``by_drive``, the gradient by the drive, given ``gradient``, the gradient by the spikes."""
    batch, steps, size = gradient.shape
    by_u = np.empty(size, gradient.dtype)
    for recording in range(batch):
        by_u[:] = 0
        for t in range(steps - 1, -1, -1):
            # Before the step back: by_u is still that of step t + 1, in which the drive of step t arrives.
            by_drive[recording, t] = by_u
            _step_back(gradient[recording, t], potential[recording, t], constants, by_u)


@compiled
def list_active(x, ends, inputs):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """List the inputs that are not 0 in each row of x (rows, inputs), and return how many there are in all.

    The active inputs of row r are ``inputs[ends[r - 1] : ends[r]]`` (from 0 for row 0). ``inputs`` needs room for one
    more than x has entries.
    """
    rows, size = x.shape
    count = 0
    for r in range(rows):
        for i in range(size):
            # Without a branch, which would be mispredicted often: every input is written, and the next
            # one overwrites it unless it counts. Hence the room for one more.
            inputs[count] = i
            count += x[r, i] != 0
        ends[r] = count
    return count


@absorbed
def _add_active(row, active, weight, total):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Set ``total`` (n,) to the sum over active inputs i of ``row[i] * weight[i]``; ``weight`` is (inputs, n)."""
    total[:] = 0
    fours = len(active) - len(active) % 4
    # Four inputs per pass, so that the totals are read and written a quarter as often. The brackets keep
    # the order of the additions that one input per pass has, so that the results are equal.
    for k in range(0, fours, 4):
        i0, i1, i2, i3 = active[k], active[k + 1], active[k + 2], active[k + 3]
        x0, x1, x2, x3 = row[i0], row[i1], row[i2], row[i3]
        w0, w1, w2, w3 = weight[i0], weight[i1], weight[i2], weight[i3]
        for o in range(len(total)):
            total[o] = (((total[o] + x0 * w0[o]) + x1 * w1[o]) + x2 * w2[o]) + x3 * w3[o]
    for k in range(fours, len(active)):
        x0, w0 = row[active[k]], weight[active[k]]
        for o in range(len(total)):
            total[o] += x0 * w0[o]


@compiled_with_arrays
def scan_active(x, ends, inputs, weight, constants, potential, spikes):  # type: ignore[no-untyped-def]  # pragma: no cover  # noqa: PLR0913 - a compiled loop takes arrays
    """Fill ``potential`` and ``spikes`` for x (batch * steps, inputs) and ``weight`` (inputs, n).

    ``ends`` and ``inputs`` are the active inputs of each row of x, as :func:`list_active` fills them.
    """
    batch, steps, size = potential.shape
    voltage = np.empty(size, potential.dtype)
    arrived = np.empty(size, potential.dtype)
    for recording in range(batch):
        voltage[:] = 0
        arrived[:] = 0
        for t in range(steps):
            # What is sent in a step arrives in the next: so first the step, then the sums for the next.
            _step(arrived, constants, voltage, potential[recording, t], spikes[recording, t])
            row = recording * steps + t
            first = ends[row - 1] if row else 0
            _add_active(x[row], inputs[first : ends[row]], weight, arrived)


@compiled_with_arrays
def scan_active_back(  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    gradient, potential, constants, x, ends, inputs, by_weight, by_drive
):  # pragma: no cover - compiled
    """Add the gradient by weights to ``by_weight`` (inputs, n), given that by spikes, and fill ``by_drive``.

    ``by_drive``, the gradient by the drive, is (batch * steps, n). It may be (1, n) if the caller does not need it,
    because the gradient by x is not needed: then every step overwrites the one row.
    """
    batch, steps, size = gradient.shape
    by_u = np.empty(size, gradient.dtype)
    for recording in range(batch):
        by_u[:] = 0
        for t in range(steps - 1, -1, -1):
            row = recording * steps + t
            by_drive[min(row, len(by_drive) - 1)] = by_u
            first = ends[row - 1] if row else 0
            for i in inputs[first : ends[row]]:
                value = x[row, i]
                by_weights_of_input = by_weight[i]
                for o in range(size):
                    by_weights_of_input[o] += value * by_u[o]
            _step_back(gradient[recording, t], potential[recording, t], constants, by_u)
