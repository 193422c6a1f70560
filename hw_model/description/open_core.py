"""The sizes of the open core, and the macros of its memories, as a chip file gives them.

The open core is the neuromorphic core of this project, in SystemVerilog (``hw_model/rtl``). One
core runs all cores of a program, phase after phase. Its memories are fixed when it is built, so a
chip file says how large they are.
"""

from typing import Annotated, NamedTuple

from hw_model.errors import InputError
from hw_model.io.records import NOT_NEGATIVE, POSITIVE, Must, between
from hw_model.values import Frozen


class Sizes(Frozen):
    """Parameters of the open core, as ``locsnn_core.sv`` has them.

    - ``axons``: sources of spikes: channels, rows of visits and compartments
    - ``synapses``: two of them are in a word
    - ``compartments``: of all phases together
    - ``slots``: places for the charges of steps to come, a power of two: the longest delay and 2
    - ``charge``: bits of a charge under way, sign included, in units of 64
    - ``join``: bits of a sum of joined voltages, sign included; 0 if no compartments are joined
    - ``bitmap``: words of the buffer of events
    - ``visits``: readings of a channel from the buffer, of all phases together
    - ``entries``: compartments that are read out
    - ``word``: rows (steps) of a recording in a word of the bitmap, a power of two
    - ``phase_words``: eight for each phase, a power of two
    - ``step``: bits in which a list stores a target, as the step from the target before; 0 if it
      stores targets in full
    - ``places``: if phases share the memories of states and charges, the compartments of a phase, a power of two; 0 if
      each phase has its own
    - ``sums``: if parents share the words of their sums, how many wait for children at a time, a power of two; 0 if
      each parent has its own
    - ``one_port``: 1 if the buffer of events is a memory of one port
    - ``later``: with ``later`` bits more for slots, in memory of charges that a program of few
      compartments leaves unused, a second phase hears its events when they arrive; not if phases
      share places
    - ``groups``: 1 if rows of a recording may share a source of spikes, where their synapses are
      the same
    """

    axons: Annotated[int, between(2, 1 << 24)]
    synapses: Annotated[int, between(2, 1 << 24)]
    compartments: Annotated[int, between(2, 1 << 20)]
    slots: Annotated[int, between(2, 1 << 16)]
    charge: Annotated[int, between(16, 64)]
    # A voltage has 24 bits with its sign, and a sum of voltages needs more.
    join: Annotated[int, Must(lambda v: (v == 0) | (v >= 24) & (v <= 64), "0, or from 24 to 64")]
    bitmap: Annotated[int, between(2, 1 << 24)]
    visits: Annotated[int, between(2, 1 << 20)]
    entries: Annotated[int, between(2, 1 << 20)]
    word: Annotated[int, between(2, 128)] = 32
    phase_words: Annotated[int, between(8, 512)] = 512
    step: Annotated[int, between(0, 8)] = 0
    places: Annotated[int, between(0, 1 << 20)] = 0
    sums: Annotated[int, between(0, 1 << 20)] = 0
    one_port: Annotated[int, between(0, 1)] = 0
    later: Annotated[int, between(0, 4)] = 0
    groups: Annotated[int, between(0, 1)] = 0


class MemoryWords(Frozen):
    """The words of memories that may be smaller on a chip than the core's parameters make them.

    - ``weights``: populations that are read out
    - ``phases``: eight for each phase
    - ``states``: compartments, or those of one phase if the core has ``places``
    - ``sums``: a power of two; no two parents that wait for children at a time have numbers that differ by it
    """

    weights: Annotated[int, between(1, 64)]
    phases: Annotated[int, between(8, 512)]
    states: Annotated[int, between(2, 1 << 20)] = 1 << 20
    sums: Annotated[int, between(1, 1 << 20)] = 1 << 20


class MemoryUse(NamedTuple):
    """How full a memory is: words that a program fills, all words, and bits of a word."""

    used_words: int
    words: int
    word_bits: int


class Macro(Frozen):
    """A memory macro that a process offers.

    - ``words``, ``bits``, ``ports``: its size
    - ``area``: square micrometres
    - ``read_pj``, ``write_pj``: picojoules to read and to write a row
    - ``banks``: the figures hold for at most as many of them next to each other
    """

    words: Annotated[int, between(1, 1 << 20)]
    bits: Annotated[int, between(1, 1 << 10)]
    area: Annotated[float, POSITIVE]
    read_pj: Annotated[float, NOT_NEGATIVE]
    write_pj: Annotated[float, NOT_NEGATIVE]
    ports: Annotated[int, between(1, 2)]
    banks: Annotated[int, between(1, 512)] = 512


def check_sizes(core: Sizes, slots: int, where: str) -> None:
    """Refuse fewer slots than the chip's registers need, and sizes that are no powers of two.

    ``slots`` is what the registers need.
    """
    shared_by = "compartments"
    size = core.compartments
    if core.places:
        shared_by = "places"
        size = core.places
    has_too_few_slots = core.slots < slots
    if has_too_few_slots or not _is_power_of_two(core.slots) or not _is_power_of_two(size):
        what = f"slots and {shared_by} must be powers of two, and slots at least delay_max and 2"
        raise InputError(
            where,
            what,
            measured=f"{core.slots} slots against {slots}, {size} {shared_by}",
            fix="Correct it.",
        )
    others = {"sums": core.sums, "word": core.word, "phase_words": core.phase_words}
    for name, words in others.items():
        if not _is_power_of_two(words):
            raise InputError(
                where, f"{name} must be a power of two", measured=f"got {words}", fix="Correct it."
            )


def _is_power_of_two(size: int) -> bool:
    """Return whether a size has at most one bit set: a power of two, or 0 for a size that is left out."""
    return size & (size - 1) == 0
