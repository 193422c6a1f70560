"""Windows of a recording: what the hidden neurons of ``window-snn`` hear, and which of them an output hears.

Channels are taken in the order of the walk. Hidden neuron ``(i * windows + w) * levels + k`` spikes where channel
``walk[i]`` had at least ``levels[k]`` events in window ``w``. Nothing here imports torch, so that the compiler can make
the synapses without it.
"""

from collections.abc import Sequence

import numpy as np
from scipy import sparse

from hw_model.values import Frozen, IntArray
from locsnn_compile.errors import InputError, check_most
from locsnn_compile.models.plain_checks import is_whole, require, require_rising

HEARD_BY_OUTPUT = 1_024
"""Hidden neurons that an output hears, if it hears several taxels.

The charge register has room for all of their weights at once: with 4,096, weights of the networks in docs/results.md
lost up to two bits.
"""
AXONS_OF_CORE = 4_096
"""Input axons of a core of the chip, and so the hidden neurons that an output can hear at all."""
MAX_WINDOW_NEURONS = 131_072
"""Hidden neurons of a network: 128 cores of 1,024."""


class WindowParameters(Frozen):
    """Windows of ``steps`` time steps, one every ``stride``, and the numbers of events that are told apart, ``levels``.

    The published 20 ms bins and these values make a window 0.12 s long.
    """

    steps: int = 6
    stride: int = 3
    levels: tuple[int, ...] = (1, 2)

    def __post_init__(self) -> None:
        for name in ("steps", "stride"):
            value = getattr(self, name)
            holds = is_whole(value) and value >= 1
            require(holds, f"windows {name!r}", "a whole number of steps", value, "Give 1 or more.")
        require_rising("windows 'levels'", self.levels, 1, self.steps, "numbers of events", "Give, for example, 1 2.")

    def starts(self, steps: int) -> IntArray:
        """Return the first step of every window of a recording of ``steps``; ``InputError`` where none fits."""
        if steps < self.steps:
            measured = f"{steps} steps against {self.steps}"
            fix = "Take shorter windows (window_steps)."
            raise InputError("recordings", "they are shorter than one window", measured=measured, fix=fix)
        return np.arange(0, steps - self.steps + 1, self.stride, dtype=np.int64)

    def of_channel(self, steps: int) -> int:
        """Return how many hidden neurons hear one channel of a recording of ``steps``."""
        return len(self.starts(steps)) * len(self.levels)

    def synapses(self, steps: int, channels: int) -> sparse.csr_array:
        """Return the weights onto the hidden neurons, all 1: (channels * windows * levels, channels * steps), float64.

        Line ``i * steps + t`` has the event of channel ``walk[i]`` at time step t.
        """
        starts, levels = self.starts(steps), len(self.levels)
        heard = (starts[:, np.newaxis] + np.arange(self.steps)).repeat(levels, axis=0)
        first = self.steps * np.arange(len(heard) + 1)
        of_one = sparse.csr_array((np.ones(heard.size), heard.reshape(-1), first), shape=(len(heard), steps))
        return sparse.csr_array(sparse.kron(sparse.eye_array(channels), of_one, format="csr"))


def output_parts(hidden_of_taxel: Sequence[int] | IntArray) -> list[slice]:
    """Return the hidden neurons of each output population: as many taxels as :data:`HEARD_BY_OUTPUT` allows, or one.

    ``hidden_of_taxel``: hidden neurons of every taxel of the walk. ``InputError`` where one alone has too many.
    """
    parts: list[slice] = []
    start = end = 0
    for size in map(int, hidden_of_taxel):
        what, fix = "one taxel has more hidden neurons than an output can hear", "Take a larger window_stride"
        check_most(size, AXONS_OF_CORE, "windows", what, fix=f"{fix}, or fewer window_levels.")
        if end > start and end + size - start > HEARD_BY_OUTPUT:
            parts.append(slice(start, end))
            start = end
        end += size
    return [*parts, slice(start, end)]
