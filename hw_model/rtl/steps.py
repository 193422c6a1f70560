"""Lists whose targets are told as steps from those before them; ``stepped.sv`` takes them apart.

A step of 1 is no way at all, so that a compartment may be a target twice. A step of 0 is no synapse: its mantissa has
the exponent of what follows, and a jump to it.
"""

import numpy as np

from hw_model.values import IntArray

FURTHEST, NEAREST = 31, -32
"""Jumps, forward and back; a way that is longer takes several."""


def in_steps(
    half: IntArray, synapses: dict[str, IntArray], bits: int, lists: int
) -> tuple[IntArray, dict[str, IntArray], dict[str, IntArray]]:
    """Return the half and the fields of every entry, and the head of every list: ``place`` and ``exponent``.

    ``half`` (synapses,): twice their list, and their bank. Synapses of an exponent follow each other, their targets
    ascending, with jumps wherever ``bits`` do not tell the way.
    """
    keys = (synapses["target"], synapses["delay"], -synapses["exponent"], half)
    order = np.lexsort(keys)
    target, delay, falling, half = (key[order] for key in keys)
    exponent, of_list, begins = -falling, half >> 1, np.diff(half, prepend=-1) != 0
    firsts = of_list[begins]
    head = {
        "place": np.full(lists, np.iinfo(np.int64).max),
        "exponent": np.zeros(lists, dtype=np.int64),
    }
    np.minimum.at(head["place"], firsts, target[begins])
    np.maximum.at(head["exponent"], firsts, exponent[begins])
    head["place"][np.bincount(firsts, minlength=lists) == 0] = 0
    way = target - np.where(begins, head["place"][of_list], np.roll(target, 1))
    told = exponent == np.where(begins, head["exponent"][of_list], np.roll(exponent, 1))
    told &= (way >= 0) & (way < (1 << bits) - 1)
    far = np.where(way < 0, NEAREST, FURTHEST)
    jumps = np.where(told, 0, np.maximum(-(-way // far), 1))
    at = np.repeat(np.arange(len(order)), jumps + 1)
    jumped = np.arange(len(at)) - np.repeat(np.cumsum(jumps + 1) - jumps - 1, jumps + 1)
    arrived = jumped == jumps[at]
    jump = np.clip(way[at] - far[at] * jumped, NEAREST, FURTHEST)
    entries = {
        "step": np.where(arrived, np.where(told, way, 0)[at] + 1, 0),
        "delay": delay[at],
        "mantissa": np.where(arrived, synapses["mantissa"][order][at], 8 * jump + exponent[at]),
    }
    return half[at], entries, head
