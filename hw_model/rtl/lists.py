"""Lists of synapses, one for each source of spikes, as words with a synapse for each bank of charges."""

import numpy as np

from hw_model.rtl.steps import in_steps
from hw_model.values import Frozen, IntArray

BANKS = (0, 1)
"""Of charges under way, as seen in a step whose next one has an even slot: delivery.sv says which is which."""
NO_SYNAPSE = {"exponent": 7}
"""What stands for no synapse in a half of a word: a weight of 0 has exponent 0."""
Table = dict[str, IntArray]
"""Fields of a memory's words by name, each (words,)."""


class Lists(Frozen, eq=False):
    """``starts``, ``lengths`` (sources,): words of the list of each source. ``heads``: fields that a list begins with.

    ``words``: the fields of both halves of every word.
    """

    starts: IntArray
    lengths: IntArray
    heads: Table
    words: Table


def packed_lists(synapses: Table, sources: int, step: int) -> Lists:
    """Return lists of synapses, given in any order: ``source``, ``target``, ``delay``, ``exponent``, ``mantissa``.

    ``step``: bits that tell the way from a target to the next, or 0 where targets are told in full. Lists of an even
    length come first: where a row of memory holds two words, they take no row more than they need.
    """
    target = synapses["target"]
    bank = (np.bitwise_xor.reduce(target >> np.arange(24)[:, None]) ^ synapses["delay"]) & 1
    half = 2 * synapses["source"] + bank
    entries = {**synapses, "target": target >> 1}
    heads = Table()
    if step:
        half, entries, heads = in_steps(half, entries, step, sources)
    order = np.argsort(half, kind="stable")
    entries_of_half = np.bincount(half, minlength=2 * sources)
    lengths = entries_of_half.reshape(-1, 2).max(axis=1)
    even_first = np.argsort(lengths % 2, kind="stable")
    starts = np.empty_like(lengths)
    starts[even_first] = np.cumsum(lengths[even_first]) - lengths[even_first]
    # Synapses of a half follow each other from where their list begins.
    first_entry = np.cumsum(entries_of_half) - entries_of_half
    word_of_first = np.repeat(starts, 2)
    word = np.arange(len(order)) + np.repeat(word_of_first - first_entry, entries_of_half)
    words: Table = {}
    for name, column in entries.items():
        halves = np.full((2, int(lengths.sum())), NO_SYNAPSE.get(name, 0))
        halves[half[order] & 1, word] = column[order]
        words |= {f"{name}{side}": halves[side] for side in BANKS}
    return Lists(starts, lengths, heads, words)
