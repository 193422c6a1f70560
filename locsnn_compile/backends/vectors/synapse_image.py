"""Pack the synapses of a core into the words of its memory, for a test bench.

An input axon points to lists, a list consists of runs, and a run of a header and some synapses. Public sources on the
chip do not say how bits lie in its memory. The chip's description says how many bits a run takes, and this layout takes
exactly as many:

    run      header (format, synapses minus one), then the synapses, padded to a whole word
    synapse  weight, delay, index, each as wide as its format says; low bits first

``format`` is the number of the synapse's format, a row of a table of the core. A dense list has no indices: its
synapses end on compartments ``base``, ``base + 1``, ...
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
    """Tables of a core as bits, one word per row.

    ``axons`` point into ``lists``, and these into ``words``, the synapse memory. ``formats`` are those of synapses.
    """

    axons: BitArray
    lists: BitArray
    words: BitArray
    formats: BitArray


def synapse_layouts(chip: Chip) -> dict[str, Layout]:
    """Return the layouts of the words that lead to synapses, with fields as wide as the limits of a chip ask for.

    Raise InputError for a chip whose run header has no room for format and length.
    """
    limits = chip.limits
    memory = chip.synapse_memory
    word_bits = bits_for(limits.synapse_words_per_core)
    compartment_bits = bits_for(limits.compartments_per_core - 1)
    header = {
        "format": bits_for(limits.synapse_formats_per_core - 1),
        "synapses_less_1": bits_for(memory.run_length - 1),
    }
    header_bits = sum(header.values())
    spare_bits = memory.run_header_bits - header_bits
    if spare_bits < 0:
        what = "the header of a run has no room for a format and a length"
        measured = f"run_header_bits {memory.run_header_bits} against {header_bits}"
        raise InputError(
            f"chip {chip.name}", what, measured=measured, fix="Leave out --emit vectors."
        )
    if spare_bits:
        header["spare"] = spare_bits
    return {
        "axon": Layout.of(first_list=word_bits, lists=word_bits),
        "list": Layout.of(first_word=word_bits, words=word_bits, base=compartment_bits),
        "run_header": Layout.of(**header),
        # The first argument names the signed field. Weights have up to 8 bits, and exponents are -8..7.
        "format": Layout.of(
            "exponent",
            weight_bits=bits_for(8),
            sign_mode=bits_for(len(SIGN_MODES) - 1),
            exponent=4,
            delay_bits=bits_for(bits_for(chip.registers.delay_max)),
            index_bits=bits_for(compartment_bits),
        ),
    }


def synapse_image(core: Core, chip: Chip) -> SynapseImage:
    """Pack the axons and synapses of a core.

    Raise InputError if they take another number of words than the program says.
    """
    layouts = synapse_layouts(chip)
    axons = core.axons
    slice_ends = np.array([core_slice.offset + core_slice.size for core_slice in core.slices])
    lists = synapse_lists(
        axons.list_start,
        axons.target,
        axons.format_index,
        axons.formats,
        slice_ends,
        chip.synapse_memory,
    )
    words = int(lists.words.sum())
    what = "its synapse lists take a different number of words than the program says"
    check_same(
        words, axons.synapse_words, f"core {core.number}", what, fix="Compile the program again."
    )
    first_word = np.cumsum(lists.words) - lists.words
    # Lists are sorted by axon. The last entry is the number of lists, so that differences give each axon's number.
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
    """Return mantissas as a format stores them: in steps of its grid, without the sign if the format is inhibitory.

    Raise InputError if a mantissa is not on the grid.
    """
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
    """Return the synapse memory, (words, bits of a word), with bit 0 first.

    Runs have different lengths, so each is written bit by bit to where it begins in one long row of bits.
    """
    axons = core.axons
    memory = chip.synapse_memory
    bits = np.zeros(int(lists.words.sum()) * memory.word_bits, dtype=np.uint8)
    # The words of a run with the most synapses, for each list. All runs of a list but the last are of this kind.
    words_of_full_run = memory.words(np.full(len(lists.width), memory.run_length), lists.width)

    # For each synapse, in the order of lists: its list, its place in the list, its run, and its place in the run.
    list_number = np.repeat(np.arange(len(lists.start)), lists.length)
    place_in_list = np.arange(len(lists.order)) - lists.start[list_number]
    run = place_in_list // memory.run_length
    place_in_run = place_in_list % memory.run_length
    run_word = first_word[list_number] + run * words_of_full_run[list_number]
    run_bit = run_word * memory.word_bits
    synapse_bit = run_bit + memory.run_header_bits + place_in_run * lists.width[list_number]
    format_index = axons.format_index[lists.order]
    target = axons.target[lists.order]
    mantissa = axons.mantissa[lists.order]
    delay = axons.delay[lists.order]

    first_of_run = np.flatnonzero(place_in_run == 0)
    synapses_from_here = lists.length[list_number[first_of_run]] - place_in_list[first_of_run]
    header = {
        "format": format_index[first_of_run],
        "synapses_less_1": np.minimum(synapses_from_here, memory.run_length) - 1,
    }
    if layout.fields[-1].name == "spare":
        header["spare"] = np.zeros(len(first_of_run), dtype=np.int64)
    _write_rows(bits, run_bit[first_of_run], layout.pack(header))

    for number, form in enumerate(axons.formats):
        has_format = format_index == number
        weights = stored_weights(form, mantissa[has_format], f"core {core.number}")
        # A dense list has no indices: a field of no bits holds no value but 0.
        index = target[has_format] if form.index_bits else np.zeros_like(weights)
        fields = {
            Field("weight", form.weight_bits, signed=form.sign_mode == "mixed"): weights,
            Field("delay", form.delay_bits): delay[has_format],
            Field("index", form.index_bits): index,
        }
        synapses = np.concatenate(
            [bits_of(values, field) for field, values in fields.items()], axis=1
        )
        _write_rows(bits, synapse_bit[has_format], synapses)
    return bits.reshape(-1, memory.word_bits)


def _write_rows(bits: BitArray, first_bits: IntArray, rows: BitArray) -> None:
    """Write each of ``rows`` into ``bits``, from its entry of ``first_bits`` on."""
    bits[first_bits[:, None] + np.arange(rows.shape[1])] = rows
