"""Lists whose targets are told as steps from those before them; ``stepped.sv`` takes them apart.

A step of 1 is no way at all, so that a compartment may be a target twice. A step of 0 is no synapse:
its mantissa has the exponent of what follows, and a jump to it.
"""

import numpy as np

from hw_model.values import IntArray

# A mantissa has nine bits; three of them hold an exponent, so six are left for a signed jump.
FURTHEST = 31
"""Longest jump forward, in targets; a longer way takes several jumps."""
NEAREST = -32
"""Longest jump back, in targets."""


def in_steps(
    half: IntArray, synapses: dict[str, IntArray], bits: int, lists: int
) -> tuple[IntArray, dict[str, IntArray], dict[str, IntArray]]:
    """Return the half and the fields of every entry, and the head of every list: ``place`` and ``exponent``.

    ``half`` (synapses,): twice their list, and their bank. Synapses of an exponent follow each
    other, their targets ascending, with jumps wherever ``bits`` do not tell the way.
    """
    keys = (synapses["target"], synapses["delay"], -synapses["exponent"], half)
    order = np.lexsort(keys)
    half = half[order]
    target = synapses["target"][order]
    exponent = synapses["exponent"][order]
    list_of = half >> 1
    is_first = np.diff(half, prepend=-1) != 0
    heads = _heads(list_of[is_first], target[is_first], exponent[is_first], lists)

    target_before = np.where(is_first, heads["place"][list_of], np.roll(target, 1))
    exponent_before = np.where(is_first, heads["exponent"][list_of], np.roll(exponent, 1))
    way = target - target_before
    longest_way = (1 << bits) - 2
    fits_field = (way >= 0) & (way <= longest_way)
    is_told = fits_field & (exponent == exponent_before)
    longest_jump = np.where(way < 0, NEAREST, FURTHEST)
    jumps_on_way = -(-way // longest_jump)
    jumps = np.where(is_told, 0, np.maximum(jumps_on_way, 1))  # a new exponent takes one as well

    # Each synapse becomes its jumps, and then itself.
    synapse = np.repeat(np.arange(len(order)), jumps + 1)
    first_entry = np.cumsum(jumps + 1) - jumps - 1
    jumps_before = np.arange(len(synapse)) - first_entry[synapse]
    is_synapse = jumps_before == jumps[synapse]
    way_left = way[synapse] - longest_jump[synapse] * jumps_before
    jump = np.clip(way_left, NEAREST, FURTHEST)
    step = np.where(is_told, way, 0) + 1
    mantissa = synapses["mantissa"][order]
    entries = {
        "step": np.where(is_synapse, step[synapse], 0),
        "delay": synapses["delay"][order][synapse],
        "mantissa": np.where(is_synapse, mantissa[synapse], 8 * jump + exponent[synapse]),
    }
    return half[synapse], entries, heads


def _heads(
    list_of: IntArray, target: IntArray, exponent: IntArray, lists: int
) -> dict[str, IntArray]:
    """Return where every list begins, given the first synapse of each of its halves; 0 without any.

    It begins at the nearer target, with the larger exponent.
    """
    place = np.full(lists, np.iinfo(np.int64).max)
    np.minimum.at(place, list_of, target)
    place[np.bincount(list_of, minlength=lists) == 0] = 0
    largest_exponent = np.zeros(lists, dtype=np.int64)
    np.maximum.at(largest_exponent, list_of, exponent)
    return {"place": place, "exponent": largest_exponent}
