"""The tables of a phase as the compiled loops of the fast engine read them, and the words for their parts.

column
    A compartment of the phase, by its number.
node
    An input, or a group of compartments. A group is cut into chunks, and starts a new chunk on
    every core.
chunk
    :data:`LANES` compartments that are updated together, in vectors; each of them is a *lane*. The
    entries of a chunk in the array of charges are its *slots*.
bundle
    Chunks that add their voltages into one another (dendrites and their soma), children first.
block
    Groups that reach each other in a circle of synapses, or one group alone. Blocks are run one
    after the other, each over all steps of a *tile*, a run of consecutive steps; only a block that
    feeds itself is run step by step.
link
    The synapses from one node to one group, stored as a matrix of weights or as lists.
echo
    Synapses from the compartments of a group to their own children, as in neurons that are made
    refractory by a dendrite. They belong to no link, and are added as vectors.

:mod:`hw_model.engine.lay_out` fills the tables. The named tuples below are records: a compiled loop
is passed the address of a record, which :class:`hw_model.engine.packed.Packed` lays out in memory.
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
"""An array with one number per lane, 32 or 64 bits."""

LANES = 16
"""Compartments of a chunk. Their 32-bit numbers fill one vector register of AVX-512, or two of AVX2."""
FIELDS = 15
"""Numbers that a chunk has for each lane. Field f of a chunk is a vector of LANES numbers."""
# Fields with parameters of the compartments.
KEEP_U, KEEP_V, THRESHOLD, BIAS, REFRACTORY, VMIN, VMAX = range(7)
# Fields with their state and, in JOINED, the sum of what their children pass in the current step.
U, V, POTENTIAL, BLOCKED, JOINED = range(7, 12)
# Fields with counts of events.
CHARGE_WRAPS, CURRENT_WRAPS, VOLTAGE_CLIPS = range(12, FIELDS)
KEPT_FIELDS = BLOCKED + 1 - U
"""The number of fields of a compartment's state, U to BLOCKED, which lie side by side."""
CACHE_LINE = 64
"""Bytes of a line of the processor's cache."""

FACTOR_BITS = 16
"""Bits, with sign, of the factors of a product in 32-bit lanes: processors multiply 16-bit factors faster."""

MATRIX, LIST, WIDE_LIST = range(3)
"""Kinds of links. Each synapse of a list is a word of 32 bits, or of 64 in a link where one does not fit 32."""


def aligned(shape: tuple[int, ...], dtype: npt.DTypeLike) -> AnyArray:
    """Return zeros that begin at a cache line: a vector that lies across two lines loads at half speed."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    # numpy aligns to 16 bytes only: take more, and start at the first cache line in it.
    room = np.zeros(size + CACHE_LINE, dtype=np.uint8)
    start = -room.ctypes.data % CACHE_LINE
    return room[start : start + size].view(dtype).reshape(shape)


class Widths(NamedTuple):
    """Where registers wrap: q, in units of 64, and u lie within ``-half..half - 1``."""

    half_charge: int
    half_current: int


USUAL_WIDTHS = Widths(loihi.charge_span(21), half_range(23))
"""The widths of all chip files in the package, 21 and 23 bits: loops in 32 bits have them as constants."""


class Chunks(NamedTuple):
    """The chunks of a phase, and the bundles and blocks that they form.

    Chunk k has the slots ``LANES * k`` to ``LANES * (k + 1) - 1``, and

    - ``node[k]`` and ``piece[k]``: where it is; a piece is a group on one core
      (:class:`hw_model.program.pieces.Pieces`)
    - ``parent[k]``: the chunk to which its voltages are added, or -1
    - ``first_column[k]`` and ``width[k]``: its columns
    - ``plain[k]``: whether nothing in it has a bias, is refractory, has children or can wrap
    - ``registers[k]`` (FIELDS, LANES): its parameters, with a state of 0; 32 bits, or 64 if a sum might not fit 32

    Bundle i consists of the chunks ``member[bundle[i]:bundle[i + 1]]``:

    - ``begins[j]``: whether ``member[j]`` is the first of its bundle
    - ``pair[j]``: whether ``member[j]`` begins a bundle of two children and a chunk that is only their sum: it keeps
      nothing from step to step

    Block b consists of the bundles ``of_block[b]`` to ``of_block[b + 1] - 1``:

    - ``feeds_itself[b]``: whether synapses lead from its groups to its groups
    - ``spiking_node[of_node[b]:of_node[b + 1]]``: its nodes that can spike

    Echoes: a spike in chunk k adds ``echo`` (delays x slots,) lane by lane to the charges of chunk ``echo_to[k]``, a
    child of k, from the next step on; ``echo_to[k]`` is -1 if k has no echo.
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
    """The synapses between nodes, one row per link. Weights are in units of 64.

    Link l leads from node ``source[l]`` to node ``target_node[l]``, whose slots begin at ``target[l]``. ``delay[l]`` is
    its shortest delay. A spike of number s within the source node adds

    - if ``kind[l]`` is MATRIX: ``matrix[offset[l] + s * width[l] + j]`` to slot ``target[l] + j``, for j in
      0..``width[l]`` - 1, with the delay ``delay[l]``
    - else: the synapses ``word[k]`` (or ``wide_word[k]``) for k from ``list_start[offset[l] + s]`` to the next entry.
      A word holds, from its lowest bit on, ``slot_bits[l]`` bits of the slot, counted from ``target[l]``;
      ``late_bits[l]`` bits of the delay, beyond ``delay[l]``; and the weight, in units of 2^``weight_shift[l]``

    The loops mark which chunks are *touched*, so that others can be skipped. For lists, ``width[l]`` is the number of
    rows (steps) in which a spike marks all chunks of the target, or 0 if each synapse marks its own chunk.

    Links into block b from other blocks and inputs are rows ``into_block[b]`` to ``into_block[b + 1] - 1``; links from
    node n into its own block are rows ``from_node[n]`` to ``from_node[n + 1] - 1``. ``due_late`` is
    :func:`hw_model.engine.trace.due_late`: the synapses of each source by delay, for counts.
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
    """Inputs, then groups: node n has ``size[n]`` lines or columns from ``first[n]`` on.

    The node of a group has the chunks ``chunk[n]`` to ``chunk[n + 1] - 1``.
    """

    first: IntArray
    size: IntArray
    chunk: IntArray


class Tables(NamedTuple):
    """A phase as the compiled loops read it. No loop writes to it, so threads share it."""

    nodes: Nodes
    chunks: Chunks
    links: Links


class FastLayout(Frozen, eq=False):
    """A phase as the fast engine runs it: its tables, of which the first ``inputs`` nodes are inputs.

    ``pieces`` is the number of pieces, and ``slot`` (columns,) the slot of every column.
    """

    inputs: int
    pieces: int
    tables: Tables
    slot: IntArray

    @cached_property
    def packed_tables(self) -> packed.Packed[Tables]:
        """The tables as they are passed to compiled loops."""
        return packed.pack(self.tables)

    @property
    def columns(self) -> int:
        """The number of compartments of the phase."""
        return len(self.slot)
