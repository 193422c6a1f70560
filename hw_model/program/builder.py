"""Programs written by hand: name inputs and compartments, connect them, build."""

import math
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import SignMode
from hw_model.arithmetic.whole import LARGEST
from hw_model.description.chip import Chip
from hw_model.errors import InputError, TargetError, check_most
from hw_model.io.given import checked
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
    """An input or a group of compartments in a builder, as an end of connections."""

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
        self._chip, self._name = chip, name
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
        - ``vmin``, ``vmax``: values that the chip can be set to
        - ``joined_to``: compartment i adds its v to compartment i of that group in the same step, and neither spikes
          nor is reset. ``join`` names the operation; only ADD is modelled.
        """
        node = _node(name, size)
        if join != "ADD":
            what = f"the join operation {join!r} is not modelled: no public source gives its integer timing"
            raise TargetError(f"compartments {name!r}", what, fix="Join with ADD.")

        def column(key: str, value: Ints) -> IntArray:
            return _whole(f"compartments {name!r}", key, value, (node.size,))

        last = self._chip.registers.voltage_max
        joined = None if joined_to is None else joined_to.name
        given = {
            "decay_u": decay_u,
            "decay_v": decay_v,
            "threshold": threshold,
            "refractory": refractory,
        }
        given |= {"vmin": -last if vmin is None else vmin, "vmax": last if vmax is None else vmax}
        columns = {key: column(key, value) for key, value in given.items()}
        columns["vmin"] = loihi.held_minimum(columns["vmin"], self._chip.registers)
        columns["bias_mantissa"], columns["bias_exponent"] = _bias(
            name, column("bias", bias), self._chip
        )
        self._groups.append(Compartments(name, "time", node.size, **columns, joined_to=joined))
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
        """Connect by mantissas (n_target, n_source), dense or scipy sparse; zeros make no synapse and are counted.

        Mantissas must be on the grid of the format. ``weight_bits`` default to the chip's most. ``delay`` is in steps:
        one for all, or an array of the shape of the weights.
        """
        where = f"synapses {source.name!r} -> {target.name!r}"
        shape = (target.size, source.size)
        if sparse.issparse(weights) and weights.shape != shape:
            raise _wrong_shape(where, "weights", weights.shape, shape)
        entries = sparse.coo_array(
            weights if sparse.issparse(weights) else _whole(where, "weights", weights, shape)
        )
        entries.sum_duplicates()
        keep = entries.data != 0
        rows, columns = (index.astype(np.int64)[keep] for index in (entries.row, entries.col))
        mantissa = _whole(where, "weights", entries.data[keep], rows.shape)
        self._pruned += (entries.nnz if sparse.issparse(weights) else math.prod(shape)) - len(rows)
        # One delay for all is not spread over all pairs, since there may be many more pairs than synapses.
        if sparse.issparse(delay) and delay.shape == shape:
            delay = _whole(where, "delay", sparse.csr_array(delay)[rows, columns], rows.shape)
        elif np.ndim(delay):
            delay = _whole(
                where, "delay", delay.toarray() if sparse.issparse(delay) else delay, shape
            )[rows, columns]
        delays = np.broadcast_to(_whole(where, "delay", delay, rows.shape), rows.shape)
        order = np.lexsort((rows, columns))
        number = int(_whole(where, "exponent", exponent, ()))
        bits = self._chip.registers.weight_bits[-1] if weight_bits is None else int(weight_bits)
        arrays = columns[order], rows[order], mantissa[order], delays[order]
        self._synapses.append(Synapses(source.name, target.name, *arrays, number, bits, sign_mode))

    def read_out(self, *populations: Node) -> None:
        """Use the sum of the spike counts of these populations as class scores."""
        self._readout = Readout(tuple(node.name for node in populations), (1.0,) * len(populations))

    def graph(self) -> CompartmentGraph:
        """Return what was collected so far as a checked graph, not yet placed on cores."""
        if not self._inputs or not self._groups:
            fix = "Call add_input and add_compartments first."
            raise InputError(f"program {self._name!r}", "has no input or no compartments", fix=fix)
        parts = tuple(self._inputs), tuple(self._groups), tuple(self._synapses)
        graph = CompartmentGraph(
            self._name, (Phase("time", "time", None),), *parts, self._readout, self._pruned
        )
        check_graph(graph, self._chip)
        return graph

    def build(self) -> ChipProgram:
        """Check, place, arrange, route and assemble; ``TargetError`` for a broken limit, saying what would fit."""
        return assemble(route_axons(arrange_cores(place_cores(self.graph(), self._chip))))


def _node(name: str, size: int) -> Node:
    if size < 1:
        raise InputError(f"{name!r}", "it is empty", measured=f"size {size}", fix="Give it a size.")
    check_most(size, MAX_LINES, repr(name), "no chip holds so many", fix="Give a smaller size.")
    return Node(name, int(size))


def _whole(where: str, key: str, value: Any, shape: tuple[int, ...]) -> IntArray:
    """Return integers of this shape; one value stands for all. Raises ``InputError`` for anything else."""
    array = np.asarray(value)
    if array.dtype.kind not in "biuf" or not np.array_equal(array, np.round(array)):
        raise InputError(
            where, f"{key} has values that are not whole numbers", fix="Quantise them first."
        )
    beyond = array[(array < -LARGEST) | (array > LARGEST)]
    if beyond.size:
        fix = "Quantise them first."
        raise InputError(
            where,
            f"{key} has values that no register holds",
            measured=f"{beyond.flat[0]:g}",
            fix=fix,
        )
    if array.shape not in ((), shape):
        raise _wrong_shape(where, key, array.shape, shape)
    return read_only(np.broadcast_to(array, shape))


def _wrong_shape(
    where: str, key: str, given: tuple[int, ...], shape: tuple[int, ...]
) -> InputError:
    order = "n_target rows and n_source columns" if len(shape) == 2 else "one value per compartment"
    return InputError(
        where,
        f"{key} has the wrong shape",
        measured=f"{given} against {shape}",
        fix=f"Give {order}.",
    )


def _bias(name: str, values: IntArray, chip: Chip) -> tuple[IntArray, IntArray]:
    """Split bias values into mantissa and the smallest exponent that holds them."""
    domains = loihi.domains(chip.registers)
    most = domains["bias_exponent"].high
    exponents = np.arange(most + 1)[:, None]
    low, high = domains["bias_mantissa"]
    mantissas = np.clip(np.rint(values / 2.0**exponents), low, high).astype(np.int64)
    exponent = np.abs(loihi.bias_of(mantissas, exponents) - values).argmin(axis=0)
    mantissa = mantissas[exponent, np.arange(len(values))]
    nearest = loihi.bias_of(mantissa, exponent)
    bad = np.flatnonzero(nearest != values)
    if len(bad):
        what = (
            f"bias {values[bad[0]]} of compartment {bad[0]} is not a mantissa times a power of two"
        )
        measured = f"mantissa {low}..{high}, exponent 0..{most}"
        raise TargetError(
            f"compartments {name!r}",
            what,
            measured=measured,
            fix=f"The nearest is {nearest[bad[0]]}.",
        )
    return mantissa, exponent
