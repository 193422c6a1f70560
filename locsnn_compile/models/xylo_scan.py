"""Backpropagation through time for the neurons of a Xylo, as one compiled loop.

The equations of the neurons and their gradient are explained in ``models.xylo_network``, which calls this loop. In
their letters, with i the synaptic current, v the potential, s the spikes, and ``charges`` the weighted spikes W x that
arrive in a step:

    i(t) = a (i(t - 1) + charge(t)),    v(t) = k (v(t - 1) - s(t - 1)) + i(t)

where ``a`` and ``k`` are ``kept_i`` and ``kept_v``, the shares of current and potential that a step keeps.
"""

import numpy as np

from hw_model.engine.compiled import compiled_with_arrays


@compiled_with_arrays
def scan_back(of_spikes, slope, kept_i, kept_v, recurrent, one, charges):  # type: ignore[no-untyped-def]  # pragma: no cover - compiled  # noqa: PLR0913 - a compiled loop takes arrays
    """Fill ``charges``, the gradients of the loss by charges, from the last step to the first.

    - ``of_spikes``: gradients by spikes, from the layers that these neurons feed; ``slope``: ds / dv. Both, like
      ``charges``, are (batch, steps, n).
    - ``kept_i``, ``kept_v``: (n,)
    - ``recurrent``: weights (n, n) [out, in], in thresholds, that carry spikes of these neurons to their next step;
      (0, n) for neurons without such synapses
    - ``one``: 1 in the float type of the arrays, because a literal would make the loop compute in float64

    ``by_i``, ``by_v`` and ``by_s`` (n,) are the gradients by current, potential and spikes; until a step replaces them,
    they are those of step t + 1.
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
                # A spike also acts through the recurrent weights, on the charges of the next step.
                for target in range(len(recurrent)):
                    charge = charges[recording, t + 1, target]
                    for n in range(size):
                        by_s[n] += charge * recurrent[target, n]
            for n in range(size):
                # dv(t + 1) / dv(t) = k (1 - ds / dv): a spike takes away one threshold of potential.
                left_by_spikes = kept_v[n] * (one - slope[recording, t, n])
                by_v[n] = by_s[n] * slope[recording, t, n] + left_by_spikes * by_v[n]
                by_i[n] = by_v[n] + kept_i[n] * by_i[n]
                # A charge decays in the very step in which it arrives.
                charges[recording, t, n] = kept_i[n] * by_i[n]
