"""How the fast engine sees a phase. Its parts have five names:

node
    An input, or a group of compartments. A group fills the chunks of its node, and starts a new
    chunk on every core.
chunk
    :data:`LANES` compartments that are updated together, in vectors: each is a *lane*. Their places
    among the charges of a step are the chunk's *slots*.
bundle
    Chunks that add their voltages into one another, children first.
block
    Groups that reach each other in a circle, or one group alone. Blocks are run one after the
    other, each over all steps of a *tile*; only a block that feeds itself is run step by step.
link
    The synapses from one node to one group: a matrix of weights where that is quicker, else lists.

The named tuples below are records. Compiled loops are given the address of one, where
:class:`hw_model.engine.packed.Packed` lays it out.
"""

from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import half_range
from hw_model.engine import packed
from hw_model.values import AnyArray, BoolArray, ByteArray, Frozen, Int32Array, IntArray

Lanes = Int32Array | IntArray

LANES = 16
"""Compartments of a chunk: 32-bit numbers of one or two vector registers."""
FIELDS = 15
KEEP_U, KEEP_V, THRESHOLD, BIAS, REFRACTORY, VMIN, VMAX = range(7)
U, V, POTENTIAL, BLOCKED, JOINED = range(7, 12)
CHARGE_WRAPS, CURRENT_WRAPS, VOLTAGE_CLIPS = range(12, FIELDS)
"""Registers of a compartment: seven parameters, the state with what its children add, and a count of each event."""
KEPT_FIELDS = BLOCKED + 1 - U
"""Registers of a compartment's state, which lie side by side, without what its children add."""
CACHE_LINE = 64
"""Bytes."""

FACTOR_BITS = 16
"""With sign, of both factors of a product in 32-bit lanes, which processors multiply faster than wide ones."""

MATRIX, LIST, WIDE_LIST = range(3)
"""Ways to hold a link: synapses of lists are words of 32 bits or, where one does not fit, of 64."""


def aligned(shape: tuple[int, ...], dtype: npt.DTypeLike) -> AnyArray:
    """Return zeros that begin where a cache line does: a vector that lies across two lines is loaded at half speed."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.zeros(size + CACHE_LINE, dtype=np.uint8)
    start = -room.ctypes.data % CACHE_LINE
    return room[start : start + size].view(dtype).reshape(shape)


class Widths(NamedTuple):
    """Where registers wrap: q, in units, and u lie within ``-half..half - 1``."""

    half_charge: int
    half_current: int


USUAL_WIDTHS = Widths(loihi.charge_span(21), half_range(23))
"""Those of the chips that ship: loops in 32 bits know no others."""


class Chunks(NamedTuple):
    """Chunk k holds columns ``first_column[k]`` on, ``width[k]`` of them; its slots are ``LANES * k`` on.

    ``node`` and ``piece`` (of :class:`hw_model.program.pieces.Pieces`) say where it is; ``parent``: the chunk that its
    voltages are added to, or -1; ``plain``: nothing in it has a bias, is refractory, has children or can wrap.
    ``registers`` (chunks, FIELDS, LANES) are its parameters, with a state of 0, in 32 bits, or in 64 where a sum might
    need them. Bundle i is ``member[bundle[i]:bundle[i + 1]]``, and ``begins`` marks the first member of each, ``pair``
    that of two chunks and one that is their sum, which keeps nothing from step to step. Block k is bundles
    ``of_block[k]`` to the next; it feeds itself where ``feeds_itself[k]``, and the nodes in it that can spike are
    ``spiking_node[of_node[k]:of_node[k + 1]]``. Spikes of chunk k add ``echo`` (delays x slots,) to the charges of a
    child, chunk ``echo_to[k]`` if not -1, lane by lane, from the next step on.
    """

    node: IntArray
    piece: IntArray
    parent: IntArray
    first_column: IntArray
    width: IntArray
    plain: ByteArray
    registers: Lanes
    member: IntArray
    begins: BoolArray
    pair: BoolArray
    bundle: IntArray
    of_block: IntArray
    feeds_itself: ByteArray
    spiking_node: IntArray
    of_node: IntArray
    echo_to: IntArray
    echo: Lanes
    widths: Widths


class Links(NamedTuple):
    """Synapses between nodes. Weights are in units.

    Link l of source s adds, if ``kind[l]`` is a matrix, ``matrix[offset[l] + s * width[l] + j]`` to slot ``target[l] +
    j``, ``delay[l]`` steps late; else what ``word[k]``, or ``wide_word[k]``, says, for k from ``list_start[offset[l] +
    s]`` to the next: from the lowest bit on ``slot_bits`` of the slot, from ``target[l]`` on; ``late_bits`` of the
    delay, beyond ``delay[l]``; and the weight, in units of 2^``weight_shift``. A spike of lists touches all chunks of
    its target in ``width[l]`` rows; where that is 0, it touches those of its synapses. Links into block k from other
    nodes are rows ``into_block[k]`` to the next; those from node n into its own block are rows ``from_node[n]`` to the
    next. ``due_late`` counts them by delay.
    """

    source: IntArray
    target_node: IntArray
    kind: IntArray
    offset: IntArray
    width: IntArray
    target: IntArray
    delay: IntArray
    slot_bits: IntArray
    late_bits: IntArray
    weight_shift: IntArray
    matrix: npt.NDArray[np.int16]
    word: Int32Array
    wide_word: IntArray
    list_start: IntArray
    into_block: IntArray
    from_node: IntArray
    due_late: IntArray


class Nodes(NamedTuple):
    """Inputs, then groups: node n has ``size[n]`` sources from ``first[n]`` on, lines or columns.

    A group's node has the chunks ``chunk[n]`` to the next.
    """

    first: IntArray
    size: IntArray
    chunk: IntArray


class Tables(NamedTuple):
    """A phase as the compiled loops read it; they write into none of it."""

    nodes: Nodes
    chunks: Chunks
    links: Links


class FastLayout(Frozen, eq=False):
    """A phase, of which the first ``inputs`` nodes are inputs.

    ``slot`` (columns,) tells the slot of every column.
    """

    inputs: int
    pieces: int
    tables: Tables
    slot: IntArray

    @cached_property
    def packed_tables(self) -> packed.Packed[Tables]:
        """The tables, as compiled loops are given them."""
        return packed.pack(self.tables)

    @property
    def columns(self) -> int:
        """Compartments of the phase."""
        return len(self.slot)
