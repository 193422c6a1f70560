"""The sizes of the open core, as a chip file gives them: what its memories hold, and what they can be made of."""

from typing import Annotated, NamedTuple

from hw_model.errors import InputError
from hw_model.io.records import NOT_NEGATIVE, POSITIVE, Must, between
from hw_model.values import Frozen


class Sizes(Frozen):
    """Parameters of the open core: the words of its memories, its slots (a power of two), and the widths of two sums.

    - ``word``: rows of a recording in a word of the bitmap, a power of two
    - ``join``: bits of the sum of joined voltages; 0 if no compartments are joined
    - ``phase_words``: eight for each phase, a power of two
    - ``one_port``: 1 if the buffer of events is a memory of one port
    - ``later``: bits of slots that few compartments leave: with them, a second phase hears its events when they arrive,
      unless phases share places
    - ``groups``: 1 if rows of a recording may share a source of spikes, where all that they reach is the same
    - ``step``: bits of the step from one target of a list to the next; with 0, a list holds each target in full
    - ``places``: if phases share the memories of states and charges, the compartments of a phase, a power of two; 0 if
      each phase has its own
    - ``sums``: if parents share the words of their sums, how many wait for children at a time, a power of two; 0 if
      each has its own
    """

    axons: Annotated[int, between(2, 1 << 24)]
    synapses: Annotated[int, between(2, 1 << 24)]
    compartments: Annotated[int, between(2, 1 << 20)]
    slots: Annotated[int, between(2, 1 << 16)]
    charge: Annotated[int, between(16, 64)]
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
    """The words of the memories that may be smaller than the parameters of the core would make them.

    - ``weights``: groups that are read out
    - ``states``: compartments, or those of one phase if the core has ``places``
    - ``sums``: a power of two; no two parents that wait for children at a time have numbers that differ by it
    """

    weights: Annotated[int, between(1, 64)]
    phases: Annotated[int, between(8, 512)]
    states: Annotated[int, between(2, 1 << 20)] = 1 << 20
    sums: Annotated[int, between(1, 1 << 20)] = 1 << 20


class MemoryUse(NamedTuple):
    """The words of a memory that a program fills, all of them, and the bits of a word."""

    used_words: int
    words: int
    word_bits: int


class Macro(Frozen):
    """A memory that a process offers: its square micrometres, and the picojoules to read and to write a row.

    The figures hold for at most this many ``banks`` next to each other.
    """

    words: Annotated[int, between(1, 1 << 20)]
    bits: Annotated[int, between(1, 1 << 10)]
    area: Annotated[float, POSITIVE]
    read_pj: Annotated[float, NOT_NEGATIVE]
    write_pj: Annotated[float, NOT_NEGATIVE]
    ports: Annotated[int, between(1, 2)]
    banks: Annotated[int, between(1, 512)] = 512


def check_sizes(core: Sizes, slots: int, where: str) -> None:
    """Refuse fewer slots than the chip's registers need, and sizes that must be powers of two but are not."""
    shared_by = "places" if core.places else "compartments"
    size: int = getattr(core, shared_by)
    if core.slots < slots or (core.slots & core.slots - 1) or (size & size - 1):
        what = f"slots and {shared_by} must be powers of two, and slots at least delay_max and 2"
        raise InputError(
            where,
            what,
            measured=f"{core.slots} slots against {slots}, {size} {shared_by}",
            fix="Correct it.",
        )
    for name in ("sums", "word", "phase_words"):
        if (size := getattr(core, name)) & size - 1:
            raise InputError(
                where, f"{name} must be a power of two", measured=f"got {size}", fix="Correct it."
            )
