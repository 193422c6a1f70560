"""Store the targets of a list of synapses as steps, each from the target before it.

The synapses of a half of a list (``lists.py``) are sorted so that targets mostly ascend, and steps
take fewer bits than targets. An entry of a half is one of two things, by its field ``step``:

- a synapse, if ``step`` is 1 or more: its target lies ``step - 1`` after that of the synapse before
  it, so a compartment may be the target of several synapses
- a jump, if ``step`` is 0: its field ``mantissa`` holds a signed number of targets, and the
  exponent of the synapses that follow

Jumps bridge distances that do not fit ``step``, and change the exponent. The head of a list holds
the target and the exponent from which both of its halves begin. ``stepped.sv`` turns entries back
into synapses.
"""

import numpy as np

from hw_model.values import IntArray

# The nine bits of a mantissa hold a jump: an exponent in the lowest three, a signed distance in the
# other six.
EXPONENTS = 8
FURTHEST = 31
"""Longest jump forward, in targets; a longer distance takes several jumps."""
NEAREST = -32
"""Longest jump back, in targets."""


def in_steps(
    half: IntArray, synapses: dict[str, IntArray], step_bits: int, lists: int
) -> tuple[IntArray, dict[str, IntArray], dict[str, IntArray]]:
    """Return the entries of lists whose targets are stored as steps of ``step_bits`` bits.

    ``half`` (synapses,) is the half of a list that each synapse belongs to: twice the number of the
    list, plus the bank. ``synapses`` has ``target``, ``delay``, ``exponent`` and ``mantissa``, in
    any order; ``lists`` is the number of lists.

    The result is the half of every entry, the fields ``step``, ``delay`` and ``mantissa`` of every
    entry, and the fields ``place`` (first target) and ``exponent`` of the head of every list.
    """
    # By half, then by exponent, the largest first, then by delay, then by target: np.lexsort takes
    # the last key first.
    keys = (synapses["target"], synapses["delay"], -synapses["exponent"], half)
    order = np.lexsort(keys)
    half = half[order]
    target = synapses["target"][order]
    exponent = synapses["exponent"][order]
    list_number = half >> 1
    is_first = np.diff(half, prepend=-1) != 0
    heads = _heads(list_number[is_first], target[is_first], exponent[is_first], lists)

    # The distance of each synapse from the one before it in its half, or from the head of its list.
    target_before = np.where(is_first, heads["place"][list_number], np.roll(target, 1))
    exponent_before = np.where(is_first, heads["exponent"][list_number], np.roll(exponent, 1))
    distance = target - target_before
    # A step is the distance plus 1, so the longest distance is 1 less than the largest step.
    longest_distance = (1 << step_bits) - 2
    fits_field = (distance >= 0) & (distance <= longest_distance)
    needs_no_jump = fits_field & (exponent == exponent_before)
    longest_jump = np.where(distance < 0, NEAREST, FURTHEST)
    jumps_to_target = -(-distance // longest_jump)  # rounded up
    # A jump is needed for another exponent even if the distance is 0.
    jumps = np.where(needs_no_jump, 0, np.maximum(jumps_to_target, 1))

    # Each synapse becomes its jumps, and then itself: `synapse` is the synapse of each entry.
    synapse = np.repeat(np.arange(len(order)), jumps + 1)
    first_entry = np.cumsum(jumps + 1) - jumps - 1
    jumps_before = np.arange(len(synapse)) - first_entry[synapse]
    is_synapse = jumps_before == jumps[synapse]
    distance_left = distance[synapse] - longest_jump[synapse] * jumps_before
    jump = np.clip(distance_left, NEAREST, FURTHEST)
    # After jumps, a synapse is at its target already: a step of 1.
    step = np.where(needs_no_jump, distance, 0) + 1
    mantissa = synapses["mantissa"][order]
    mantissa_of_jump = EXPONENTS * jump + exponent[synapse]
    entries = {
        "step": np.where(is_synapse, step[synapse], 0),
        "delay": synapses["delay"][order][synapse],
        "mantissa": np.where(is_synapse, mantissa[synapse], mantissa_of_jump),
    }
    return half[synapse], entries, heads


def _heads(
    list_number: IntArray, target: IntArray, exponent: IntArray, lists: int
) -> dict[str, IntArray]:
    """Return the target and the exponent from which every list begins; 0 for empty lists.

    The arrays (halves,) describe the first synapse of each half that has one. The two halves of a
    list share its head: it has the smaller of their targets and the larger of their exponents, so
    one of them may begin with a jump.
    """
    place = np.full(lists, np.iinfo(np.int64).max)
    np.minimum.at(place, list_number, target)
    place[np.bincount(list_number, minlength=lists) == 0] = 0
    largest_exponent = np.zeros(lists, dtype=np.int64)
    np.maximum.at(largest_exponent, list_number, exponent)
    return {"place": place, "exponent": largest_exponent}
