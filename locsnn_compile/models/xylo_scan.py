"""The compiled steps back of the neurons of a Xylo; the gradient is explained in ``models.xylo_network``."""

import numpy as np

from hw_model.engine.compiled import compiled_with_arrays


@compiled_with_arrays
def scan_back(of_spikes, slope, kept_i, kept_v, recurrent, one, charges):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled
    """Fill ``charges`` (batch, steps, n), the gradients of charges, from the last step to the first.

    ``of_spikes`` are gradients of spikes, and ``slope`` is ds / dv, both of that shape. Weights ``recurrent`` (n, n)
    [out, in], in thresholds, carry spikes of these neurons to the next step; without, they are (0, n). ``one`` is 1 in
    the float type of the arrays.
    """
    batch, steps, size = of_spikes.shape
    di = np.empty(size, of_spikes.dtype)
    dv = np.empty(size, of_spikes.dtype)
    ds = np.empty(size, of_spikes.dtype)
    for b in range(batch):
        di[:] = 0
        dv[:] = 0
        for t in range(steps - 1, -1, -1):
            for n in range(size):
                ds[n] = of_spikes[b, t, n]
            if t < steps - 1:
                for target in range(len(recurrent)):
                    charge = charges[b, t + 1, target]
                    for n in range(size):
                        ds[n] += charge * recurrent[target, n]
            for n in range(size):
                left_by_spikes = kept_v[n] * (one - slope[b, t, n])
                dv[n] = ds[n] * slope[b, t, n] + left_by_spikes * dv[n]
                di[n] = dv[n] + kept_i[n] * di[n]
                # A charge decays in the very step in which it arrives.
                charges[b, t, n] = kept_i[n] * di[n]
