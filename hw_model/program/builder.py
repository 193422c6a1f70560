"""Write a program for a chip by hand: add inputs and compartments, connect them, build.

For users who have no trained network, and for tests. The builder collects a graph of compartments and sends it through
the same checks, placement and routing as the compiler does.
"""

import math
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import SignMode
from hw_model.arithmetic.whole import LARGEST
from hw_model.description.chip import Chip
from hw_model.errors import InputError, TargetError, check_most
from hw_model.io.arguments import checked
from hw_model.mapping.arrangement import arrange_cores
from hw_model.mapping.check_graph import check_graph
from hw_model.mapping.graph import (
    MAX_LINES,
    CompartmentGraph,
    Compartments,
    Input,
    Phase,
    Readout,
    Synapses,
    read_only,
)
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble
from hw_model.program.chip_program import ChipProgram
from hw_model.values import ArrayLike, Frozen, IntArray

Ints = int | ArrayLike


class Node(Frozen):
    """An input or a group of compartments in a builder. ``add_...`` returns it; ``connect`` takes two of them."""

    name: str
    size: int


class ProgramBuilder:
    """Collects the parts of a program with one time phase.

    >>> import hw_model as hw
    >>> b = hw.ProgramBuilder(hw.chip("loihi-sim"))
    >>> x = b.add_input("touch", 2)
    >>> h = b.add_compartments("hidden", 1, decay_u=4096, decay_v=0, threshold=10)
    >>> b.connect(x, h, [[20, -4]])
    >>> hw.simulate(b.build(), [[1, 0], [0, 0]]).spikes["hidden"].ravel().tolist()
    [0, 1]
    """

    @checked
    def __init__(self, chip: Chip, name: str = "program") -> None:
        self._chip = chip
        self._name = name
        self._inputs: list[Input] = []
        self._groups: list[Compartments] = []
        self._synapses: list[Synapses] = []
        self._readout: Readout | None = None
        self._pruned = 0

    @checked
    def add_input(self, name: str, size: int) -> Node:
        """Add ``size`` input lines; line i spikes at step t where column i of the played array does."""
        node = _node(name, size)
        self._inputs.append(Input(name, node.size, "time", name))
        return node

    @checked
    def add_compartments(  # noqa: PLR0913 - public: each is an option of its own
        self,
        name: str,
        size: int,
        *,
        decay_u: Ints = 0,
        decay_v: Ints = 0,
        threshold: Ints,
        bias: Ints = 0,
        refractory: Ints = 1,
        vmin: Ints | None = None,
        vmax: Ints | None = None,
        joined_to: Node | None = None,
        join: str = "ADD",
    ) -> Node:
        """Add compartments; every parameter is one integer for all, or an array (size,).

        - ``decay_u``, ``decay_v``: effective decays 0..4096; ``threshold``: mantissa
        - ``bias``: its value, which must be a 13-bit mantissa times a power of two up to 2^7
        - ``refractory`` k: no spike in the k - 1 steps after a spike
        - ``vmin``, ``vmax``: values that the chip can be set to; None: the ends of the voltage register
        - ``joined_to``: compartment i adds its v to compartment i of that group in the same step, and neither spikes
          nor is reset. ``join`` names the operation; only ADD is modelled.
        """
        node = _node(name, size)
        if join != "ADD":
            what = f"the join operation {join!r} is not modelled: no public source gives its integer timing"
            raise TargetError(f"compartments {name!r}", what, fix="Join with ADD.")

        def parameter(key: str, value: Ints) -> IntArray:
            return _whole_numbers(f"compartments {name!r}", key, value, (node.size,))

        registers = self._chip.registers
        lowest = -registers.voltage_max if vmin is None else vmin
        highest = registers.voltage_max if vmax is None else vmax
        parameters = {
            "decay_u": parameter("decay_u", decay_u),
            "decay_v": parameter("decay_v", decay_v),
            "threshold": parameter("threshold", threshold),
            "refractory": parameter("refractory", refractory),
            "vmin": loihi.held_minimum(parameter("vmin", lowest), registers),
            "vmax": parameter("vmax", highest),
        }
        bias_mantissa, bias_exponent = _bias(name, parameter("bias", bias), self._chip)
        group = Compartments(
            name,
            phase="time",
            size=node.size,
            **parameters,
            bias_mantissa=bias_mantissa,
            bias_exponent=bias_exponent,
            joined_to=None if joined_to is None else joined_to.name,
        )
        self._groups.append(group)
        return node

    @checked
    def connect(  # noqa: PLR0913 - public: each is an option of its own
        self,
        source: Node,
        target: Node,
        weights: Any,
        *,
        exponent: int = 0,
        delay: Any = 0,
        weight_bits: int | None = None,
        sign_mode: SignMode = "mixed",
    ) -> None:
        """Connect by weight mantissas (n_target, n_source), a dense array or scipy sparse.

        A mantissa of 0 makes no synapse; the program counts it as pruned. Mantissas must be on the grid of the format.
        ``weight_bits`` defaults to the chip's widest weights. ``delay`` is in steps: one for all, or an array of the
        shape of the weights.
        """
        where = f"synapses {source.name!r} -> {target.name!r}"
        shape = (target.size, source.size)
        if sparse.issparse(weights) and weights.shape != shape:
            raise _wrong_shape(where, "weights", weights.shape, shape)
        is_sparse = sparse.issparse(weights)
        matrix = weights if is_sparse else _whole_numbers(where, "weights", weights, shape)
        entries = sparse.coo_array(matrix)
        # A sparse matrix may list an entry more than once; its value is the sum.
        entries.sum_duplicates()
        is_synapse = entries.data != 0
        targets = entries.row.astype(np.int64)[is_synapse]
        sources = entries.col.astype(np.int64)[is_synapse]
        mantissa = _whole_numbers(where, "weights", entries.data[is_synapse], targets.shape)
        # Every entry of a dense array counts as given, but only the stored entries of a sparse one.
        given_entries = entries.nnz if is_sparse else math.prod(shape)
        self._pruned += given_entries - len(targets)
        delays = _delays(where, delay, shape, targets, sources)
        # The order of `Synapses`: by source, then target.
        order = np.lexsort((targets, sources))
        widest_bits = self._chip.registers.weight_bits[-1]
        synapses = Synapses(
            source=source.name,
            target=target.name,
            source_index=sources[order],
            target_index=targets[order],
            mantissa=mantissa[order],
            delay=delays[order],
            exponent=int(_whole_numbers(where, "exponent", exponent, ())),
            weight_bits=widest_bits if weight_bits is None else int(weight_bits),
            sign_mode=sign_mode,
        )
        self._synapses.append(synapses)

    def read_out(self, *populations: Node) -> None:
        """Use the sum of the spike counts of these populations as class scores."""
        self._readout = Readout(tuple(node.name for node in populations), (1.0,) * len(populations))

    def graph(self) -> CompartmentGraph:
        """Return everything added so far as a checked graph, not yet placed on cores."""
        if not self._inputs or not self._groups:
            fix = "Call add_input and add_compartments first."
            raise InputError(f"program {self._name!r}", "has no input or no compartments", fix=fix)
        graph = CompartmentGraph(
            name=self._name,
            phases=(Phase("time", "time", steps=None),),
            inputs=tuple(self._inputs),
            groups=tuple(self._groups),
            synapses=tuple(self._synapses),
            readout=self._readout,
            synapses_pruned=self._pruned,
        )
        check_graph(graph, self._chip)
        return graph

    def build(self) -> ChipProgram:
        """Check, place, arrange, route and assemble.

        Raises ``TargetError`` if a limit of the chip is exceeded; it says what would fit.
        """
        placed = place_cores(self.graph(), self._chip)
        routed = route_axons(arrange_cores(placed))
        return assemble(routed)


def _delays(
    where: str, delay: Any, shape: tuple[int, int], targets: IntArray, sources: IntArray
) -> IntArray:
    """Return the delay of every synapse (synapses,), given one for all, or a dense or sparse array of ``shape``."""
    if sparse.issparse(delay) and delay.shape == shape:
        of_synapses = sparse.csr_array(delay)[targets, sources]
    elif np.ndim(delay):
        # A sparse array of a wrong shape comes here, too, for the message about its shape.
        dense = delay.toarray() if sparse.issparse(delay) else delay
        of_synapses = _whole_numbers(where, "delay", dense, shape)[targets, sources]
    else:
        # One delay for all is not expanded to all pairs: there may be many more pairs than synapses.
        of_synapses = delay
    checked_delays = _whole_numbers(where, "delay", of_synapses, targets.shape)
    return np.broadcast_to(checked_delays, targets.shape)


def _node(name: str, size: int) -> Node:
    """Return a node of a size that is checked to be possible."""
    if size < 1:
        raise InputError(f"{name!r}", "it is empty", measured=f"size {size}", fix="Give it a size.")
    check_most(size, MAX_LINES, repr(name), "no chip holds so many", fix="Give a smaller size.")
    return Node(name, int(size))


def _whole_numbers(where: str, key: str, value: Any, shape: tuple[int, ...]) -> IntArray:
    """Return integers of this shape; one value stands for all. Raises ``InputError`` for anything else."""
    array = np.asarray(value)
    # Booleans, signed and unsigned integers and floats are numbers; NaN is not equal to itself.
    is_number = array.dtype.kind in "biuf"
    if not is_number or not np.array_equal(array, np.round(array)):
        raise InputError(
            where, f"{key} has values that are not whole numbers", fix="Quantise them first."
        )
    too_large = array[(array < -LARGEST) | (array > LARGEST)]
    if too_large.size:
        fix = "Quantise them first."
        raise InputError(
            where,
            f"{key} has values that no register holds",
            measured=f"{too_large.flat[0]:g}",
            fix=fix,
        )
    if array.shape not in ((), shape):
        raise _wrong_shape(where, key, array.shape, shape)
    return read_only(np.broadcast_to(array, shape))


def _wrong_shape(
    where: str, key: str, given: tuple[int, ...], shape: tuple[int, ...]
) -> InputError:
    """Return the error for an array of a wrong shape; ``shape`` is the right one."""
    order = "n_target rows and n_source columns" if len(shape) == 2 else "one value per compartment"
    return InputError(
        where,
        f"{key} has the wrong shape",
        measured=f"{given} against {shape}",
        fix=f"Give {order}.",
    )


def _bias(name: str, values: IntArray, chip: Chip) -> tuple[IntArray, IntArray]:
    """Return the mantissa and the smallest exponent of each bias value, both (n,).

    Raises ``TargetError``, which names the nearest possible value, if a bias is no mantissa times a power of two.
    """
    domains = loihi.domains(chip.registers)
    largest_exponent = domains["bias_exponent"].high
    # Try all exponents at once, in rows; the nearest mantissa for each.
    exponents = np.arange(largest_exponent + 1)[:, None]
    low, high = domains["bias_mantissa"]
    mantissas = np.clip(np.rint(values / 2.0**exponents), low, high).astype(np.int64)
    # The first minimum has the smallest exponent of those that are equally near.
    exponent = np.abs(loihi.bias_of(mantissas, exponents) - values).argmin(axis=0)
    mantissa = mantissas[exponent, np.arange(len(values))]
    nearest = loihi.bias_of(mantissa, exponent)
    bad = np.flatnonzero(nearest != values)
    if len(bad):
        what = (
            f"bias {values[bad[0]]} of compartment {bad[0]} is not a mantissa times a power of two"
        )
        measured = f"mantissa {low}..{high}, exponent 0..{largest_exponent}"
        raise TargetError(
            f"compartments {name!r}",
            what,
            measured=measured,
            fix=f"The nearest is {nearest[bad[0]]}.",
        )
    return mantissa, exponent
