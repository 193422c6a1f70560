"""The compiled steps of integrate-and-fire neurons, for sums of weights, and for spikes with the weights of each input.

Arrays are (batch, steps, n) unless stated otherwise. The recursion and its gradient are explained in ``models.lif``.
The ``constants`` are keep, threshold, 0 and 1 for a step, and keep, threshold, window and 0 for a step back, all in the
float type of the arrays.
"""

import numpy as np

from hw_model.engine.compiled import absorbed, compiled, compiled_with_arrays


@absorbed
def _step(arrived, constants, voltage, potential, spikes):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Take one step of n neurons: ``voltage`` is updated, ``potential`` and ``spikes`` are filled, all (n,)."""
    keep, threshold, zero, one = constants
    for i in range(len(voltage)):
        u = keep * voltage[i] + arrived[i]
        fired = u > threshold
        potential[i] = u
        spikes[i] = one if fired else zero
        voltage[i] = zero if fired else u


@absorbed
def _step_back(gradient, potential, constants, by_u):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Make the gradient by u of the next step that of this one, all (n,)."""
    keep, threshold, window, zero = constants
    for i in range(len(by_u)):
        u = potential[i]
        by_kept = keep * by_u[i]
        # A spike sends on, and takes away what the next step would keep of u.
        by_spike = gradient[i] - u * by_kept
        through_potential = zero if u > threshold else by_kept
        through_spike = by_spike if abs(u - threshold) < window else zero
        by_u[i] = through_potential + through_spike


@compiled_with_arrays
def scan(drive, constants, potential, spikes):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Fill ``potential`` and ``spikes`` for what the inputs of each step add up to."""
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
    """Fill ``by_drive``, the gradient by drive, for that by spikes."""
    batch, steps, size = gradient.shape
    by_u = np.empty(size, gradient.dtype)
    for recording in range(batch):
        by_u[:] = 0
        for t in range(steps - 1, -1, -1):
            by_drive[recording, t] = by_u
            _step_back(gradient[recording, t], potential[recording, t], constants, by_u)


@compiled
def list_active(x, ends, inputs):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """List the inputs that are not 0 in each row of x (rows, inputs), and return how many there are in all.

    Those of row r end before ``ends[r]`` in ``inputs`` and begin where the previous row ends; ``inputs`` needs room for
    one more than x has entries.
    """
    rows, size = x.shape
    count = 0
    for r in range(rows):
        for i in range(size):
            inputs[count] = i
            count += x[r, i] != 0
        ends[r] = count
    return count


@absorbed
def _add_active(row, active, weight, total):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Make ``total`` (n,) the sum of ``weight`` (inputs, n) over active inputs, each times its entry of ``row``."""
    total[:] = 0
    fours = len(active) - len(active) % 4
    # Four inputs a pass, so that the sums are read and written a quarter as often; their order stays.
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
    """Fill ``potential`` and ``spikes`` for x (batch * steps, inputs), as listed, and ``weight`` (inputs, n)."""
    batch, steps, size = potential.shape
    voltage = np.empty(size, potential.dtype)
    arrived = np.empty(size, potential.dtype)
    for recording in range(batch):
        voltage[:] = 0
        arrived[:] = 0
        for t in range(steps):
            _step(arrived, constants, voltage, potential[recording, t], spikes[recording, t])
            row = recording * steps + t
            first = ends[row - 1] if row else 0
            _add_active(x[row], inputs[first : ends[row]], weight, arrived)


@compiled_with_arrays
def scan_active_back(  # type: ignore[no-untyped-def]  # noqa: PLR0913 - a compiled loop takes arrays
    gradient, potential, constants, x, ends, inputs, by_weight, by_drive
):  # pragma: no cover - compiled
    """Add the gradient by weights to ``by_weight`` (inputs, n), for that by spikes, and fill ``by_drive``.

    ``by_drive``, the gradient by drive, is (batch * steps, n), or (1, n) where the gradient by x is not needed.
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
