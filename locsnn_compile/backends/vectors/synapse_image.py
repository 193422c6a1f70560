"""The synapse memory of a core as words: axons point to lists, lists consist of runs, runs of a header and synapses.

The chip description says what a run costs; this layout takes exactly that:

    run      header (format, synapses minus one), then the synapses, padded to a whole word
    synapse  weight, delay, index, each as wide as its format says; low bits first

A dense list has no indices: its synapses end on compartments ``base``, ``base + 1``, ...
"""

import numpy as np

from hw_model.arithmetic.fixed_point import SIGN_MODES, weight_grid
from hw_model.description.chip import Chip
from hw_model.mapping.fan_in import SynapseFormat
from hw_model.mapping.synapse_lists import SynapseLists, synapse_lists
from hw_model.program.chip_program import Core
from hw_model.rtl.memory_words import BitArray, Field, Layout, bits_for, bits_of
from hw_model.values import Frozen, IntArray
from locsnn_compile.errors import InputError, check_same


class SynapseImage(Frozen, eq=False):
    """Tables of a core as bits, one word per row: ``axons`` point into ``lists``, and these into ``words``."""

    axons: BitArray
    lists: BitArray
    words: BitArray
    formats: BitArray


def synapse_layouts(chip: Chip) -> dict[str, Layout]:
    """Return the layouts of the words that lead to synapses, from the limits of a chip.

    Raises ``InputError`` for a chip whose run header has no room for format and length.
    """
    limits, memory = chip.limits, chip.synapse_memory
    words, compartment = (
        bits_for(limits.synapse_words_per_core),
        bits_for(limits.compartments_per_core - 1),
    )
    header = {
        "format": bits_for(limits.synapse_formats_per_core - 1),
        "synapses_less_1": bits_for(memory.run_length - 1),
    }
    spare = memory.run_header_bits - sum(header.values())
    if spare < 0:
        what = "the header of a run has no room for a format and a length"
        measured = f"run_header_bits {memory.run_header_bits} against {sum(header.values())}"
        raise InputError(
            f"chip {chip.name}", what, measured=measured, fix="Leave out --emit vectors."
        )
    return {
        "axon": Layout.of(first_list=words, lists=words),
        "list": Layout.of(first_word=words, words=words, base=compartment),
        "run_header": Layout.of(**header, **({"spare": spare} if spare else {})),
        "format": Layout.of(
            "exponent",
            weight_bits=bits_for(8),
            sign_mode=bits_for(len(SIGN_MODES) - 1),
            exponent=4,
            delay_bits=bits_for(bits_for(chip.registers.delay_max)),
            index_bits=bits_for(compartment),
        ),
    }


def synapse_image(core: Core, chip: Chip) -> SynapseImage:
    """Pack the axons and synapses of a core; ``InputError`` if they take other words than placement counted."""
    layouts, axons = synapse_layouts(chip), core.axons
    ends = np.array([piece.offset + piece.size for piece in core.slices])
    lists = synapse_lists(
        axons.list_start, axons.target, axons.format_index, axons.formats, ends, chip.synapse_memory
    )
    words = int(lists.words.sum())
    what = "its synapse lists take a different number of words than the program says"
    check_same(
        words, axons.synapse_words, f"core {core.number}", what, fix="Compile the program again."
    )
    first_word = np.cumsum(lists.words) - lists.words
    first_list = np.searchsorted(lists.axon, np.arange(axons.input_axons + 1))
    first_target = axons.target[lists.order[lists.start]]
    return SynapseImage(
        axons=layouts["axon"].pack({"first_list": first_list[:-1], "lists": np.diff(first_list)}),
        lists=layouts["list"].pack(
            {
                "first_word": first_word,
                "words": lists.words,
                "base": np.where(lists.dense, first_target, 0),
            }
        ),
        words=_words(core, chip, layouts["run_header"], lists, first_word),
        formats=layouts["format"].pack_rows(
            [
                {**vars(form), "sign_mode": SIGN_MODES.index(form.sign_mode)}
                for form in axons.formats
            ]
        ),
    )


def stored_weights(form: SynapseFormat, mantissa: IntArray, where: str) -> IntArray:
    """Return mantissas in steps of their grid, as a format stores them; magnitudes if the format is inhibitory."""
    grid = weight_grid(form.weight_bits, form.sign_mode)
    if grid.off_grid(mantissa).any():
        raise InputError(
            where, "a weight is not on the grid of its format", fix="Compile the program again."
        )
    stored: IntArray = mantissa // grid.step
    return np.abs(stored) if form.sign_mode == "inhibitory" else stored


def _words(
    core: Core, chip: Chip, layout: Layout, lists: SynapseLists, first_word: IntArray
) -> BitArray:
    """Return the memory, (words, bits of a word)."""
    axons, memory, rows = core.axons, chip.synapse_memory, lists.order
    bits = np.zeros(int(lists.words.sum()) * memory.word_bits, dtype=np.uint8)
    full_run = memory.words(np.full(len(lists.width), memory.run_length), lists.width)

    # The place of each synapse: its list, its place in the list, and its run.
    of_list = np.repeat(np.arange(len(lists.start)), lists.length)
    place = np.arange(len(rows)) - lists.start[of_list]
    run, in_run = place // memory.run_length, place % memory.run_length
    run_at = (first_word[of_list] + run * full_run[of_list]) * memory.word_bits
    synapse_at = run_at + memory.run_header_bits + in_run * lists.width[of_list]
    format_index, target, mantissa, delay = (
        column[rows] for column in (axons.format_index, axons.target, axons.mantissa, axons.delay)
    )

    heads = np.flatnonzero(in_run == 0)
    left = lists.length[of_list[heads]] - place[heads]
    header = {
        "format": format_index[heads],
        "synapses_less_1": np.minimum(left, memory.run_length) - 1,
    }
    if layout.fields[-1].name == "spare":
        header["spare"] = np.zeros(len(heads), dtype=np.int64)
    _put(bits, run_at[heads], layout.pack(header))

    for number, form in enumerate(axons.formats):
        mine = format_index == number
        weights = stored_weights(form, mantissa[mine], f"core {core.number}")
        fields = {
            Field("weight", form.weight_bits, signed=form.sign_mode == "mixed"): weights,
            Field("delay", form.delay_bits): delay[mine],
            Field("index", form.index_bits): target[mine]
            if form.index_bits
            else np.zeros_like(weights),
        }
        packed = np.concatenate(
            [bits_of(values, field) for field, values in fields.items()], axis=1
        )
        _put(bits, synapse_at[mine], packed)
    return bits.reshape(-1, memory.word_bits)


def _put(bits: BitArray, at: IntArray, rows: BitArray) -> None:
    bits[at[:, None] + np.arange(rows.shape[1])] = rows
