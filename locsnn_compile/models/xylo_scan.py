"""The compiled steps back of the neurons of a Xylo; the gradient is explained in ``models.xylo_network``."""

import numpy as np

from hw_model.engine.compiled import compiled_with_arrays


@compiled_with_arrays
def scan_back(of_spikes, slope, kept_i, kept_v, recurrent, one, charges):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled  # noqa: PLR0913 - a compiled loop takes arrays
    """Fill ``charges`` (batch, steps, n), the gradients of charges, from the last step to the first.

    ``of_spikes`` are gradients of spikes, and ``slope`` is ds / dv, both of that shape. Weights ``recurrent`` (n, n)
    [out, in], in thresholds, carry spikes of these neurons to the next step; without, they are (0, n). ``one`` is 1 in
    the float type of the arrays.

    ``by_i``, ``by_v`` and ``by_s`` (n,) are the gradients of the current, the voltage and the spikes of a step.
    """
    batch, steps, size = of_spikes.shape
    by_i = np.empty(size, of_spikes.dtype)
    by_v = np.empty(size, of_spikes.dtype)
    by_s = np.empty(size, of_spikes.dtype)
    for recording in range(batch):
        by_i[:] = 0
        by_v[:] = 0
        for t in range(steps - 1, -1, -1):
            for n in range(size):
                by_s[n] = of_spikes[recording, t, n]
            if t < steps - 1:
                for target in range(len(recurrent)):
                    charge = charges[recording, t + 1, target]
                    for n in range(size):
                        by_s[n] += charge * recurrent[target, n]
            for n in range(size):
                left_by_spikes = kept_v[n] * (one - slope[recording, t, n])
                by_v[n] = by_s[n] * slope[recording, t, n] + left_by_spikes * by_v[n]
                by_i[n] = by_v[n] + kept_i[n] * by_i[n]
                # A charge decays in the very step in which it arrives.
                charges[recording, t, n] = kept_i[n] * by_i[n]
