"""Pack the synapses of a program into lists, one for each source of spikes.

A word of a list holds two synapses, one for each of the two banks in which the core adds up
charges; half of a word is empty where a list has more synapses for the other bank. delivery.sv
walks the lists.
"""

import numpy as np

from hw_model.rtl.steps import in_steps
from hw_model.values import Frozen, IntArray

BANKS = (0, 1)
"""The banks of charges, and the halves of a word. Bank and half are the same in every other step:
delivery.sv says when."""
NO_SYNAPSE = {"exponent": 7}
"""The fields of a half without a synapse that are not 0. A synapse whose weight is 0 has exponent
0."""
Table = dict[str, IntArray]
"""The fields of a memory's words, by name, each (words,)."""


class Lists(Frozen, eq=False):
    """The lists of all sources.

    - ``starts``, ``lengths`` (sources,): the first word of each list, and its number of words
    - ``heads``: fields that belong to a list as a whole, (sources,) each; none unless targets are
      stored as steps
    - ``words``: the fields of both halves of every word, such as ``target0`` and ``target1``
    """

    starts: IntArray
    lengths: IntArray
    heads: Table
    words: Table


def packed_lists(synapses: Table, sources: int, step: int) -> Lists:
    """Return the lists of synapses that are given in any order.

    ``synapses`` has the fields ``source``, ``target``, ``delay``, ``exponent``, ``mantissa``, each
    (synapses,). ``step`` is the number of bits in which a target is stored as a step from the
    target before, or 0 to store targets in full.

    Lists of an even length come first: where a row of memory holds two words, they take no row more
    than they need.
    """
    target = synapses["target"]
    # The bank is the parity of the target's bits and of the delay: the lowest bit of a slot is that
    # of the step plus delay.
    parity_of_target = np.bitwise_xor.reduce(target >> np.arange(24)[:, None])
    bank = (parity_of_target ^ synapses["delay"]) & 1
    # The half of a list that a synapse goes to, as one number. The bank gives the lowest bit of the
    # target.
    half = 2 * synapses["source"] + bank
    entries = {**synapses, "target": target >> 1}
    heads = Table()
    if step:
        half, entries, heads = in_steps(half, entries, step, sources)
    order = np.argsort(half, kind="stable")
    # A list is as long as the longer of its halves.
    entries_of_half = np.bincount(half, minlength=2 * sources)
    lengths = entries_of_half.reshape(-1, 2).max(axis=1)
    even_first = np.argsort(lengths % 2, kind="stable")
    starts = np.empty_like(lengths)
    starts[even_first] = np.cumsum(lengths[even_first]) - lengths[even_first]
    # The entries of a half lie in successive words from the start of their list: the word of an
    # entry is its place in the half, added to the start.
    first_entry = np.cumsum(entries_of_half) - entries_of_half
    word_of_first = np.repeat(starts, 2)
    word = np.arange(len(order)) + np.repeat(word_of_first - first_entry, entries_of_half)
    words: Table = {}
    for name, column in entries.items():
        halves = np.full((2, int(lengths.sum())), NO_SYNAPSE.get(name, 0))
        halves[half[order] & 1, word] = column[order]
        words |= {f"{name}{side}": halves[side] for side in BANKS}
    return Lists(starts, lengths, heads, words)
