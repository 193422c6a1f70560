"""The twin of a chip's compartments in float64, with a switch for every deviation of the chip's arithmetic.

With every switch on and the chip's integers as parameters, all values are integers below 2^53, which float64 holds
exactly, so the twin equals the simulator bit for bit. With every switch off, it is the real-valued recursion.
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
"""Matrices with at most this many entries are stacked: a call takes longer than its product, and a copy is small."""


class TwinGroup(Frozen, eq=False):
    """``size`` compartments; every parameter is an array (size,), in units of the registers.

    They take the step of :mod:`hw_model.arithmetic.loihi`, but spike where v >= threshold, and ``keep_u`` and
    ``keep_v`` are shares. What a decay leaves is truncated toward zero only if ``truncates``. Only if ``limited``, q
    and u wrap and v is clipped to ``vmin..vmax``; if not, v has no limit but a ``floor`` (size,). With ``joined_to``,
    compartment i adds its v to compartment i of that group, and neither spikes nor is reset.
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
    """Weights (n_target, n_source), dense or CSR, or (n,) from each neuron onto itself, or onto what is joined to it.

    A spike in step t arrives at step ``t + 1 + delay``.
    """

    source: str
    target: str
    weights: Matrix
    delay: int = 0


class Twin(Frozen, eq=False):
    """The compartments of one phase, children before their parents, and the synapses between them."""

    groups: tuple[TwinGroup, ...]
    synapses: tuple[TwinSynapses, ...]
    registers: Registers


class TwinTrace(Frozen, eq=False):
    """``spikes[name]`` (batch, steps, n) of groups that spike; ``potential[name]`` is v as the threshold saw it."""

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
        # What neurons send to those of the same number is added first: in another order, sums round differently.
        _send_to_itself(onto_itself, sent, step)
        _send_to_others(onto_others, sent, step)
    return _traces(len(twins), spiking, potential)


def _add_charge_of_lines(
    synapses: "Sequence[tuple[int, TwinSynapses]]",
    lines: Mapping[str, ByteArray],
    place_of: "Mapping[_Key, _Place]",
) -> None:
    """Add what the inputs send in all steps, which depends on no neuron, to the charges; twins may share weights."""
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
            # Few lines spike, so their spikes are sparse, whatever the weights are.
            spikes_that_act = sparse_lines[s.source][: batch * (steps - loihi.acts_at(0, s.delay))]
            products = spikes_that_act @ s.weights.T
            charge = products.toarray() if sparse.issparse(products) else products
            charge_of[key] = charge.reshape(-1, batch, s.weights.shape[0])
        target = place_of[number, s.target]
        target.block.charge[loihi.acts_at(0, s.delay) :, :, target.columns] += charge_of[key]


def _weights_onto_itself(
    synapses: "Sequence[tuple[int, TwinSynapses]]", place_of: "Mapping[_Key, _Place]"
) -> "dict[_Block, FloatArray]":
    """Return the weights from neurons onto those of the same number, (delays, 1, columns), by block."""
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
    """Return all other weights, those from one source one after the other."""
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
    """Take the step of all compartments up to the threshold: children first, which add their v to their parents."""
    spiking.joined[:] = 0.0
    for block in joined:
        block.update(step)
        spiking.joined[:, : block.size] += block.v
    spiking.update(step)


def _send_to_itself(weights: "Mapping[_Block, FloatArray]", sent: FloatArray, step: int) -> None:
    """Add the charge of spikes (batch, columns) to neurons of the same number, in the steps in which it acts."""
    for block, by_delay in weights.items():
        first = loihi.acts_at(step, 0)
        later = block.charge[first : first + len(by_delay)]
        later += by_delay[: len(later)] * sent[:, : block.size]


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
            by_twin = spikes.reshape(batch, len(onto.weights), -1).transpose(1, 2, 0)
            charge = (onto.weights @ by_twin).transpose(2, 0, 1).reshape(batch, -1)
        onto.block.charge[acts_at, :, onto.columns] += charge


def _traces(
    twins: int, spiking: "_Block", potential: "Mapping[_Key, FloatArray]"
) -> list[TwinTrace]:
    """Return what each twin did."""
    traces = [TwinTrace({}, {}) for _ in range(twins)]
    for (number, name), columns in spiking.columns.items():
        traces[number].spikes[name] = np.ascontiguousarray(spiking.spikes[:, :, columns])
    for (number, name), by_step in potential.items():
        traces[number].potential[name] = by_step
    return traces


def _blocks(twins: Sequence[Twin], batch: int, steps: int, registers: Registers) -> "list[_Block]":
    """Return blocks of the groups that are joined to others, and as the last block the others, which spike.

    The first block has the first child of every group that has any, the next block the second ones. Groups with more
    children come first, so all blocks have a group and what is joined to it in the same columns. Apart from that the
    twins' groups of one name are neighbours.
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
    ranks = [
        [children[key][k] for key in ordered if k < len(children[key])]
        for k in range(len(children[ordered[0]]))
    ]
    return [
        _Block({key: groups[key] for key in keys}, batch, steps, registers)
        for keys in (*ranks, ordered)
    ]


def _stacked(by_twin: "Sequence[Mapping[str, Sequence[_Onto]]]") -> "list[_Onto]":
    """Stack small dense weights of neighbouring twins, (twins, n_target, n_source), and keep the order of each twin."""
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
    """Tell whether weights are like those of a stack, from and onto the columns next to them."""
    is_neighbour = (stack.senders.stop, stack.columns.stop) == (
        layer.senders.start,
        layer.columns.start,
    )
    is_alike = (stack.acts_after, stack.block) == (layer.acts_after, layer.block)
    return is_neighbour and is_alike and stack.weights.shape[1:] == layer.weights.shape[1:]


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
    """Where the registers of a group lie."""

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
    """The operations of a step in float64; every one that the chip rounds or limits can be switched off by column.

    Charges are in the unit of u.
    """

    def __init__(self, truncates: BoolArray, limited: BoolArray, registers: Registers) -> None:
        self._truncates = truncates
        self._limited = limited
        self._charge_bits = registers.charge_bits
        self._current_bits = registers.current_bits
        self._current: FloatArray | None = None
        """What was last within the register of u."""

    def wrap_charge(self, q: FloatArray) -> FloatArray:
        """Return q within its register."""
        return self._wrapped(q, self._charge_bits)

    def wrap_current(self, u: FloatArray) -> FloatArray:
        """Return u, or u + bias, within the register of u; without a bias u comes a second time, and is within."""
        if u is not self._current:
            self._current = self._wrapped(u, self._current_bits)
        return self._current

    def charged(self, q: FloatArray) -> FloatArray:
        """Return q itself."""
        return q

    def kept(self, x: FloatArray, keep: FloatArray) -> FloatArray:
        """Return keep x; ``keep`` is a share here, and not one of 4096 parts."""
        left = x * keep
        np.trunc(left, out=left, where=self._truncates)
        return left

    def clip(self, v: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return v within low..high, in half the time of np.clip."""
        raised = np.maximum(v, low)
        return np.minimum(raised, high, out=raised)

    def select(self, condition: BoolArray | Always, chosen: Any, otherwise: Any) -> Any:
        """Return one where the condition holds, and the other where not."""
        if condition is ALWAYS:
            return chosen
        if isinstance(otherwise, np.ndarray):
            selected = otherwise.copy()
        else:
            selected = np.full_like(chosen, otherwise)
        np.copyto(selected, chosen, where=condition)  # in a third of the time of np.where
        return selected

    def _wrapped(self, x: FloatArray, bits: int) -> FloatArray:
        """Return ``x``, wrapped where limited to ``bits`` bits plus sign in two's complement; fractions are kept."""
        half = float(half_range(bits))
        if x.max() < half and x.min() >= -half:
            return x  # nearly always, and np.mod is slow
        wraps = self._limited & ((x >= half) | (x < -half))
        wrapped: FloatArray = np.where(wraps, np.mod(x + half, 2 * half) - half, x)
        return wrapped


class _Block:
    """Registers of groups side by side: arrays (batch, n); ``charge`` (steps, batch, n)."""

    def __init__(
        self, by_key: Mapping[_Key, TwinGroup], batch: int, steps: int, registers: Registers
    ) -> None:
        groups = list(by_key.values())
        ends = np.cumsum([0, *(group.size for group in groups)]).tolist()
        self.columns = {key: slice(*ends[i : i + 2]) for i, key in enumerate(by_key)}
        self.size = ends[-1]
        self._spiking = groups[0].joined_to is None

        def by_column(values: Sequence[AnyArray]) -> AnyArray:
            return np.tile(np.concatenate(values), (batch, 1))

        limited = by_column([np.full(group.size, group.limited) for group in groups])
        truncates = by_column([np.full(group.size, group.truncates) for group in groups])
        bias = by_column([group.bias for group in groups])
        endless = [np.full(group.size, -np.inf) for group in groups]
        floor = by_column(
            [
                none if group.floor is None else group.floor
                for group, none in zip(groups, endless, strict=True)
            ]
        )
        self._arithmetic = _OnFloats(truncates, limited, registers)
        self._parameters = Parameters(
            keep_u=by_column([group.keep_u for group in groups]),
            keep_v=by_column([group.keep_v for group in groups]),
            bias=bias if bias.any() else NOTHING,
            # A spike where v > this is one where v >= the threshold of the group.
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
        """Accumulate, decay and join; afterwards v is what the threshold sees."""
        ops, parameters = self._arithmetic, self._parameters
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
