"""The twin of a chip's compartments in float64, with a switch for every deviation of the chip's arithmetic.

With every switch on and the chip's integers as parameters, all values are integers below 2^53, which float64 holds
exactly, so the twin equals the simulator bit for bit. With every switch off, it is the real-valued recursion.

The error budget runs about fifteen twins, which differ in their switches and parameters, on the same recordings. They
are run side by side: the compartments of all twins are the columns of a few large arrays (:class:`_Block`), so that a
step is a few calls of numpy for all of them.
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from hw_model.arithmetic import loihi
from hw_model.arithmetic.fixed_point import half_range
from hw_model.arithmetic.loihi import Parameters
from hw_model.arithmetic.neutral import ALWAYS, NOTHING, Always
from hw_model.description.chip import Registers
from hw_model.values import AnyArray, BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.projections import Matrix, sparse_spikes

STACKED_ENTRIES = 1 << 14
"""Matrices with at most this many entries are stacked into one product: for small ones, the call itself takes longer
than the product, and the copy is small. Chosen by hand."""


class TwinGroup(Frozen, eq=False):
    """``size`` compartments; every parameter is an array (size,), in units of the registers.

    They take the step of :mod:`hw_model.arithmetic.loihi`, but spike where v >= threshold, and ``keep_u`` and
    ``keep_v`` are shares 0..1. Two switches: if ``truncates``, u and v are truncated toward zero after they decay. If
    ``limited``, q and u wrap and v is clipped to ``vmin..vmax``; if not, v has no limit except its ``floor`` (size,).
    With ``joined_to``, the group is dendrites: compartment i adds its v to compartment i of that group, and neither
    spikes nor is reset.
    """

    name: str
    size: int
    keep_u: FloatArray
    keep_v: FloatArray
    threshold: FloatArray
    bias: FloatArray
    refractory: IntArray
    vmin: FloatArray
    vmax: FloatArray
    truncates: bool
    limited: bool
    joined_to: str | None = None
    floor: FloatArray | None = None


class TwinSynapses(Frozen, eq=False):
    """Weights (n_target, n_source), dense or CSR, or (n,) from each neuron onto itself or a dendrite of its own.

    A spike in step t arrives at step ``t + 1 + delay``.
    """

    source: str
    target: str
    weights: Matrix
    delay: int = 0


class Twin(Frozen, eq=False):
    """The compartments of one phase, dendrites before their somas, and the synapses onto them."""

    groups: tuple[TwinGroup, ...]
    synapses: tuple[TwinSynapses, ...]
    registers: Registers


class TwinTrace(Frozen, eq=False):
    """What a twin does: ``spikes[name]`` (batch, steps, n) of groups that spike, and potentials that were asked for.

    ``potential[name]`` (batch, steps, n) is v before a reset.
    """

    spikes: dict[str, ByteArray]
    potential: dict[str, FloatArray]


def run_twin(twin: Twin, lines: Mapping[str, ByteArray], **options: Any) -> TwinTrace:
    """Run recordings through a twin: see :func:`run_twins`."""
    return run_twins([twin], lines, **options)[0]


def run_twins(
    twins: Sequence[Twin],
    lines: Mapping[str, ByteArray],
    *,
    forced: Mapping[str, ByteArray] | None = None,
    potentials: tuple[str, ...] = (),
) -> list[TwinTrace]:
    """Run recordings through twins side by side; ``lines[input]`` (batch, steps, lines) are the spikes of the inputs.

    With ``forced`` (batch, steps, n) by group, these spikes are sent and reset their neurons instead of the twin's own,
    so potentials can be compared as if no earlier spike had differed. ``potentials`` names the groups whose potentials
    are kept.
    """
    batch, steps = next(iter(lines.values())).shape[:2]
    *joined, spiking = _blocks(twins, batch, steps, twins[0].registers)
    place_of = {
        key: _Place(block, columns)
        for block in (*joined, spiking)
        for key, columns in block.columns.items()
    }
    # With the number of their twin, and without delays so long that nothing arrives before the end.
    synapses = [
        (number, s)
        for number, twin in enumerate(twins)
        for s in twin.synapses
        if loihi.acts_at(0, s.delay) < steps
    ]
    _add_charge_of_lines(synapses, lines, place_of)
    between_neurons = [(number, s) for number, s in synapses if s.source not in lines]
    onto_itself = _weights_onto_itself(between_neurons, place_of)
    onto_others = _weights_onto_others(between_neurons, place_of, len(twins))
    potential = {
        key: np.empty((batch, steps, place.size))
        for key, place in place_of.items()
        if key[1] in potentials
    }
    for step in range(steps):
        _update(joined, spiking, step)
        for key, by_step in potential.items():
            by_step[:, step] = place_of[key].v
        fired = spiking.fire(step)
        if forced is not None:
            spikes = [forced[name][:, step] for _, name in spiking.columns]
            fired = np.hstack(spikes).astype(np.bool_)
        spiking.reset(fired)
        sent = fired.astype(np.float64)
        # Always in this order: float sums in another order round differently.
        _send_to_itself(onto_itself, sent, step)
        _send_to_others(onto_others, sent, step)
    return _traces(len(twins), spiking, potential)


def _add_charge_of_lines(
    synapses: "Sequence[tuple[int, TwinSynapses]]",
    lines: Mapping[str, ByteArray],
    place_of: "Mapping[_Key, _Place]",
) -> None:
    """Add the charges that the input lines cause in all steps; they do not depend on any neuron.

    Twins that share a matrix of weights share the product.
    """
    batch, steps = next(iter(lines.values())).shape[:2]
    sparse_lines = {}
    for name, played in lines.items():
        by_step = played.transpose(1, 0, 2).reshape(steps * batch, -1)
        sparse_lines[name] = sparse_spikes(by_step, np.float64)
    charge_of: dict[tuple[str, int, int], FloatArray] = {}
    for number, s in synapses:
        if s.source not in lines:
            continue
        key = (s.source, s.delay, id(s.weights))
        if key not in charge_of:
            # Few lines spike, so a sparse product is faster, even with dense weights. Rows are ordered by step, so the
            # spikes that act before the end are the first rows.
            spikes_that_act = sparse_lines[s.source][: batch * (steps - loihi.acts_at(0, s.delay))]
            products = spikes_that_act @ s.weights.T
            charge = products.toarray() if sparse.issparse(products) else products
            charge_of[key] = charge.reshape(-1, batch, s.weights.shape[0])
        target = place_of[number, s.target]
        target.block.charge[loihi.acts_at(0, s.delay) :, :, target.columns] += charge_of[key]


def _weights_onto_itself(
    synapses: "Sequence[tuple[int, TwinSynapses]]", place_of: "Mapping[_Key, _Place]"
) -> "dict[_Block, FloatArray]":
    """Return the weights from neurons onto themselves or their dendrites, (delays, 1, columns), by block.

    All blocks have a neuron and its dendrites in the same column, so these weights multiply column by column.
    """
    onto_itself = [(number, s) for number, s in synapses if s.weights.ndim == 1]
    delays = 1 + max((s.delay for _, s in onto_itself), default=0)
    weights: dict[_Block, FloatArray] = {}
    for number, s in onto_itself:
        target = place_of[number, s.target]
        if target.block not in weights:
            weights[target.block] = np.zeros((delays, 1, target.block.size))
        weights[target.block][s.delay, 0, target.columns] += s.weights
    return weights


def _weights_onto_others(
    synapses: "Sequence[tuple[int, TwinSynapses]]", place_of: "Mapping[_Key, _Place]", twins: int
) -> "list[_Onto]":
    """Return all other weights, in the order of their twins and sources."""
    by_twin: list[dict[str, list[_Onto]]] = [{} for _ in range(twins)]
    for number, s in synapses:
        if s.weights.ndim > 1:
            target = place_of[number, s.target]
            onto = _Onto(
                acts_after=loihi.acts_at(0, s.delay),
                senders=place_of[number, s.source].columns,
                block=target.block,
                columns=target.columns,
                weights=s.weights,
            )
            by_twin[number].setdefault(s.source, []).append(onto)
    return _stacked(by_twin)


def _update(joined: "Sequence[_Block]", spiking: "_Block", step: int) -> None:
    """Take the step of all compartments up to the threshold: dendrites first, which add their v to their somas."""
    spiking.joined[:] = 0.0
    for block in joined:
        block.update(step)
        spiking.joined[:, : block.size] += block.v
    spiking.update(step)


def _send_to_itself(weights: "Mapping[_Block, FloatArray]", sent: FloatArray, step: int) -> None:
    """Add the charge of spikes (batch, columns) onto the neurons' own columns, in the steps in which it acts."""
    for block, by_delay in weights.items():
        first = loihi.acts_at(step, 0)
        charge_of_steps = block.charge[first : first + len(by_delay)]  # a view; shorter at the end
        charge_of_steps += by_delay[: len(charge_of_steps)] * sent[:, : block.size]


def _send_to_others(weights: "Sequence[_Onto]", sent: FloatArray, step: int) -> None:
    """Add the charge of spikes (batch, columns) to other neurons, in the step in which it acts."""
    batch = len(sent)
    for onto in weights:
        spikes = sent[:, onto.senders]
        acts_at = step + onto.acts_after
        if acts_at >= len(onto.block.charge) or not spikes.any():
            continue
        if sparse.issparse(onto.weights):
            charge = (onto.weights @ spikes.T).T
        else:
            # Weights are stacked, (twins, n_target, n_source): one product for all their twins.
            by_twin = spikes.reshape(batch, len(onto.weights), -1).transpose(1, 2, 0)
            charge = (onto.weights @ by_twin).transpose(2, 0, 1).reshape(batch, -1)
        onto.block.charge[acts_at, :, onto.columns] += charge


def _traces(
    twins: int, spiking: "_Block", potential: "Mapping[_Key, FloatArray]"
) -> list[TwinTrace]:
    """Return the trace of each twin, cut from the columns of the blocks."""
    traces = [TwinTrace({}, {}) for _ in range(twins)]
    for (number, name), columns in spiking.columns.items():
        traces[number].spikes[name] = np.ascontiguousarray(spiking.spikes[:, :, columns])
    for (number, name), by_step in potential.items():
        traces[number].potential[name] = by_step
    return traces


def _blocks(twins: Sequence[Twin], batch: int, steps: int, registers: Registers) -> "list[_Block]":
    """Divide the groups of all twins into blocks; the last block has those that spike, the others have dendrites.

    The first block has the first dendrites of every group that has any, the next block the second ones, and so on.
    Groups with more dendrites come first, so a group and its dendrites are in the same columns of their blocks. Apart
    from that, the groups of one name in all twins are neighbours, so that their weights can be stacked.
    """
    groups = {(i, group.name): group for i, twin in enumerate(twins) for group in twin.groups}
    children: dict[_Key, list[_Key]] = {
        key: [] for key, group in groups.items() if not group.joined_to
    }
    for (i, name), group in groups.items():
        if group.joined_to:
            children[i, group.joined_to].append((i, name))
    names = list(dict.fromkeys(name for _, name in groups))
    ordered = sorted(children, key=lambda key: (-len(children[key]), names.index(key[1])))
    most_children = len(children[ordered[0]])
    keys_of_blocks = [
        [children[key][k] for key in ordered if k < len(children[key])]
        for k in range(most_children)
    ]
    keys_of_blocks.append(ordered)
    return [
        _Block({key: groups[key] for key in keys}, batch, steps, registers)
        for keys in keys_of_blocks
    ]


def _stacked(by_twin: "Sequence[Mapping[str, Sequence[_Onto]]]") -> "list[_Onto]":
    """Stack small dense weights of neighbouring twins, (twins, n_target, n_source), and keep the order of each twin.

    Sorted by their number within the twin, then by column, the same weights of all twins follow each other.
    """
    numbered = [
        item for by_source in by_twin for item in enumerate(chain.from_iterable(by_source.values()))
    ]
    stacked: list[_Onto] = []
    for _, onto in sorted(numbered, key=lambda item: (item[0], item[1].senders.start)):
        if sparse.issparse(onto.weights):
            stacked.append(onto)
            continue
        layer = onto._replace(weights=onto.weights[None])
        if stacked and onto.weights.size <= STACKED_ENTRIES and _fits_behind(stacked[-1], layer):
            stacked[-1] = _behind(stacked[-1], layer)
        else:
            stacked.append(layer)
    return stacked


def _fits_behind(stack: "_Onto", layer: "_Onto") -> bool:
    """Return whether weights continue a stack: same delay, block and shape, and the columns right after it."""
    follows = (
        stack.senders.stop == layer.senders.start and stack.columns.stop == layer.columns.start
    )
    is_alike = stack.acts_after == layer.acts_after and stack.block == layer.block
    return follows and is_alike and stack.weights.shape[1:] == layer.weights.shape[1:]


def _behind(stack: "_Onto", layer: "_Onto") -> "_Onto":
    """Return a stack with one more layer of weights."""
    return stack._replace(
        senders=slice(stack.senders.start, layer.senders.stop),
        columns=slice(stack.columns.start, layer.columns.stop),
        weights=np.concatenate([stack.weights, layer.weights]),
    )


_Key = tuple[int, str]
"""The number of a twin and the name of one of its groups."""


class _Place(NamedTuple):
    """Where the registers of a group are: in some ``columns`` of a block."""

    block: "_Block"
    columns: slice

    @property
    def size(self) -> int:
        """Number of compartments."""
        return int(self.columns.stop - self.columns.start)

    @property
    def v(self) -> FloatArray:
        """Voltages, (batch, size)."""
        return self.block.v[:, self.columns]


class _Onto(NamedTuple):
    """Weights from one group onto another, or stacked ones of several twins.

    - ``acts_after``: steps until a spike acts
    - ``senders``: the columns that send, of the block of groups that spike
    - ``block`` and its ``columns``: those that the spikes reach
    """

    acts_after: int
    senders: slice
    block: "_Block"
    columns: slice
    weights: Matrix


class _OnFloats:
    """The operations of a step in float64 (:class:`hw_model.arithmetic.loihi.Operations`).

    Truncation and wrapping can be switched off by column: ``truncates`` and ``limited`` (batch, n). Charges are in the
    unit of u.
    """

    def __init__(self, truncates: BoolArray, limited: BoolArray, registers: Registers) -> None:
        self._truncates = truncates
        self._limited = limited
        self._charge_bits = registers.charge_bits
        self._current_bits = registers.current_bits
        self._current: FloatArray | None = None
        """The last current after wrapping, to recognise it."""

    def wrap_charge(self, q: FloatArray) -> FloatArray:
        """Return q within its register."""
        return self._wrapped(q, self._charge_bits)

    def wrap_current(self, u: FloatArray) -> FloatArray:
        """Return u, or u + bias, within the register of u.

        Without a bias, the step calls this a second time with the same array, which is already wrapped.
        """
        if u is not self._current:
            self._current = self._wrapped(u, self._current_bits)
        return self._current

    def charged(self, q: FloatArray) -> FloatArray:
        """Return q itself: charges are in the unit of u already."""
        return q

    def kept(self, x: FloatArray, keep: FloatArray) -> FloatArray:
        """Return ``keep * x``; ``keep`` is a share 0..1 here, not a number of 4096ths as on the chip."""
        remaining = x * keep
        np.trunc(remaining, out=remaining, where=self._truncates)
        return remaining

    def clip(self, v: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return v within low..high, in half the time of np.clip."""
        raised = np.maximum(v, low)
        return np.minimum(raised, high, out=raised)

    def select(self, condition: BoolArray | Always, chosen: Any, otherwise: Any) -> Any:
        """Return ``chosen`` where the condition holds, and ``otherwise`` elsewhere."""
        if condition is ALWAYS:
            return chosen
        if isinstance(otherwise, np.ndarray):
            selected = otherwise.copy()
        else:
            selected = np.full_like(chosen, otherwise)
        np.copyto(selected, chosen, where=condition)  # in a third of the time of np.where
        return selected

    def _wrapped(self, x: FloatArray, bits: int) -> FloatArray:
        """Return ``x``, wrapped to ``bits`` bits plus sign in two's complement where limited; fractions are kept."""
        half = float(half_range(bits))
        if x.max() < half and x.min() >= -half:
            return x  # nearly always, and np.mod is slow
        wraps = self._limited & ((x >= half) | (x < -half))
        wrapped: FloatArray = np.where(wraps, np.mod(x + half, 2 * half) - half, x)
        return wrapped


class _Block:
    """The registers of groups side by side: arrays (batch, n), in which each group has its ``columns``.

    ``charge`` (steps, batch, n) are the charges that arrive in each step. ``joined`` is what dendrites add to v.
    """

    def __init__(
        self, by_key: Mapping[_Key, TwinGroup], batch: int, steps: int, registers: Registers
    ) -> None:
        groups = list(by_key.values())
        ends = np.cumsum([0, *(group.size for group in groups)]).tolist()
        self.columns = {key: slice(*ends[i : i + 2]) for i, key in enumerate(by_key)}
        self.size = ends[-1]
        self._spiking = groups[0].joined_to is None

        def by_column(values: Sequence[AnyArray]) -> AnyArray:
            """Return values of groups, (size,) each, side by side, and repeated for every recording."""
            return np.tile(np.concatenate(values), (batch, 1))

        limited = by_column([np.full(group.size, group.limited) for group in groups])
        truncates = by_column([np.full(group.size, group.truncates) for group in groups])
        bias = by_column([group.bias for group in groups])
        floors: list[FloatArray] = []
        for group in groups:
            no_floor = np.full(group.size, -np.inf)
            floors.append(no_floor if group.floor is None else group.floor)
        floor = by_column(floors)
        self._arithmetic = _OnFloats(truncates, limited, registers)
        self._parameters = Parameters(
            keep_u=by_column([group.keep_u for group in groups]),
            keep_v=by_column([group.keep_v for group in groups]),
            bias=bias if bias.any() else NOTHING,
            # The step spikes where v > threshold, a twin where v >= threshold: take the next float below.
            threshold=np.nextafter(by_column([group.threshold for group in groups]), -np.inf),
            refractory=by_column([group.refractory for group in groups]),
            vmin=np.where(limited, by_column([group.vmin for group in groups]), floor),
            vmax=np.where(limited, by_column([group.vmax for group in groups]), np.inf),
        )
        self.charge = np.zeros((steps, batch, self.size))
        self.joined: Any = np.zeros((batch, self.size)) if self._spiking else NOTHING
        self.spikes = np.zeros((batch, steps, self.size if self._spiking else 0), dtype=np.uint8)
        self.v = np.zeros((batch, self.size))
        self._u = np.zeros((batch, self.size))
        self._blocks = bool((self._parameters.refractory > 1).any())
        self._blocked = np.zeros((batch, self.size), dtype=np.int64) if self._blocks else NOTHING
        self._fired = np.zeros((batch, self.size), dtype=np.bool_)

    def update(self, step: int) -> None:
        """Take the step up to the threshold: decay, charge and dendrites; afterwards v is what the threshold sees."""
        ops = self._arithmetic
        parameters = self._parameters
        response = loihi.respond(ops, parameters, self._u, self.v, self.charge[step], self.joined)
        self._u = response.u
        self.v = response.v
        if self._spiking:
            _, self.v, self._fired = loihi.threshold(ops, parameters, self._blocked, self.v)

    def fire(self, step: int) -> BoolArray:
        """Record and return which compartments reach their threshold."""
        self.spikes[:, step] = self._fired
        return self._fired

    def reset(self, spikes: BoolArray) -> None:
        """Reset the compartments that spiked, and count refractory steps."""
        self.v = loihi.reset(self._arithmetic, self.v, spikes)
        if self._blocks:
            self._blocked = loihi.count_down(
                self._arithmetic, self._parameters, self._blocked, spikes
            )
