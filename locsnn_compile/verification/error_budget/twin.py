"""The twin of a chip's compartments in float64, every deviation of the chip's arithmetic a switch of its own.

With every switch on, and the chip's integers as parameters, all values are integers below 2^53, which float64 holds
exactly: the twin then equals the simulator bit for bit. With every switch off it is the real-valued recursion.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.description.chip import Registers
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.projections import Matrix


class TwinGroup(Frozen, eq=False):
    """``size`` compartments; every parameter is an array (size,), in units of the registers.

        u = kept(u, keep_u) + q
        v = kept(v, keep_v) + u + bias + the v of joined children
        a spike where v >= threshold; then v = 0, and no spike for ``refractory - 1`` steps

    ``q`` is the charge that arrives, ``kept(x, k)`` is k x, cut to an integer toward zero where ``truncates``. Where
    ``limited``, q and u wrap and v is clipped. With ``joined_to`` compartment i adds its v to compartment i of that
    group, and neither spikes nor is reset.
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


class TwinSynapses(Frozen, eq=False):
    """Weights (n_target, n_source), dense or CSR, or (n,) where each source reaches the target of its own number only.

    A spike of step t arrives at step ``t + 1 + delay``.
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
    """``spikes[name]`` (batch, steps, n) of groups that spike; ``potential[name]`` (v as the threshold saw it)."""

    spikes: dict[str, ByteArray]
    potential: dict[str, FloatArray]


def run_twin(twin: Twin, lines: Mapping[str, ByteArray], **kept: Any) -> TwinTrace:
    """Run recordings through a twin: see :func:`run_twins`."""
    return run_twins([twin], lines, **kept)[0]


def run_twins(
    twins: Sequence[Twin],
    lines: Mapping[str, ByteArray],
    *,
    forced: Mapping[str, ByteArray] | None = None,
    potentials: tuple[str, ...] = (),
) -> list[TwinTrace]:
    """Run recordings through twins side by side; ``lines[input]`` (batch, steps, lines) are the spikes of the inputs.

    With ``forced`` (batch, steps, n) by group, these spikes are sent, and reset their neurons, in place of the twin's
    own, so that potentials can be compared as if no earlier spike had differed. ``potentials`` names the groups whose
    potentials are kept.
    """
    batch, steps = next(iter(lines.values())).shape[:2]
    blocks = _blocks(twins, batch, steps)
    spiking = [block for block in blocks if block.spiking]
    home = {key: (block, columns) for block in blocks for key, columns in block.columns.items()}
    joins = [
        (*home[i, group.name], *home[i, group.joined_to])
        for i, twin in enumerate(twins)
        for group in twin.groups
        if group.joined_to
    ]
    early = {name: played.transpose(1, 0, 2).reshape(steps * batch, -1) for name, played in lines.items()}
    sparse_lines = {name: sparse.csr_array(spikes, dtype=np.float64) for name, spikes in early.items()}
    synapses = [(i, s) for i, twin in enumerate(twins) for s in twin.synapses if s.delay + 1 < steps]
    own: dict[_Block, dict[tuple[_Block, str], _OwnCharges]] = {block: {} for block in spiking}
    others: dict[_Key, list[tuple[int, _Block, slice, Matrix]]] = {key: [] for key in home}
    for i, s in synapses:
        target, to_columns = home[i, s.target]
        if s.source in lines:
            # Few spikes among many: sparse, whatever the weights are.
            found = sparse_lines[s.source][: batch * (steps - 1 - s.delay)] @ s.weights.T
            charge = found.toarray() if sparse.issparse(found) else found
            target.charge[1 + s.delay :, :, to_columns] += charge.reshape(-1, batch, s.weights.shape[0])
        elif s.weights.ndim == 2:
            others[i, s.source].append((1 + s.delay, target, to_columns, s.weights))
        else:
            block, columns = home[i, s.source]
            _, to, weights = own[block].setdefault((target, s.target), _own_charges(block, target, synapses))
            to[columns] = np.arange(to_columns.start, to_columns.stop)
            weights[s.delay, columns] += s.weights
    watched = {key: columns for key, (_, columns) in home.items() if key[1] in potentials}
    potential = {key: np.empty((batch, steps, here.stop - here.start)) for key, here in watched.items()}
    for step in range(steps):
        for block in blocks:
            if block.spiking:
                block.joined[:] = 0.0
                for child, from_columns, parent, to_columns in joins:
                    if parent is block:
                        block.joined[:, to_columns] += child.v[:, from_columns]
            block.update(step, twins[0].registers)
        for key, kept in potential.items():
            block, columns = home[key]
            kept[:, step] = block.v[:, columns]
        for block in spiking:
            fired = block.fire(step)
            if forced is not None:
                fired = np.hstack([forced[name][:, step] for _, name in block.columns]).astype(np.bool_)
            block.reset(fired)
            recording, column = np.nonzero(fired)
            for target, to, weights in own[block].values():
                here = to[column] >= 0
                later = target.charge[step + 1 : step + 1 + len(weights)]
                later[:, recording[here], to[column[here]]] += weights[: len(later), column[here]]
            for key, columns in block.columns.items():
                sent = fired[:, columns]
                for late, target, to_columns, weights in others[key] if sent.any() else ():
                    if step + late < steps:
                        target.charge[step + late, :, to_columns] += (weights @ sent.T.astype(np.float64)).T
    traces = [TwinTrace({}, {}) for _ in twins]
    for block in spiking:
        for (i, name), columns in block.columns.items():
            traces[i].spikes[name] = np.ascontiguousarray(block.spikes[:, :, columns])
    for (i, name), kept in potential.items():
        traces[i].potential[name] = kept
    return traces


def _blocks(twins: Sequence[Twin], batch: int, steps: int) -> "list[_Block]":
    """Return the groups in blocks of one arithmetic each, those that are joined to others first."""
    kinds: dict[tuple[bool, bool, bool], dict[_Key, TwinGroup]] = {}
    for i, twin in enumerate(twins):
        for group in twin.groups:
            kinds.setdefault((group.joined_to is None, group.truncates, group.limited), {})[i, group.name] = group
    return [_Block(kinds[kind], batch, steps) for kind in sorted(kinds)]


_Key = tuple[int, str]
"""The number of a twin, and the name of a group of it."""
_OwnCharges = tuple["_Block", IntArray, FloatArray]
"""What the few spikes of a step bring to neurons of the same number: to a block, to which of its columns from each that
spikes, or -1, and weights (delays, columns)."""


def _own_charges(block: "_Block", target: "_Block", synapses: Sequence[tuple[int, TwinSynapses]]) -> _OwnCharges:
    delays = 1 + max(s.delay for _, s in synapses if s.weights.ndim == 1)
    return target, np.full(block.v.shape[1], -1), np.zeros((delays, block.v.shape[1]))


class _Block:
    """Registers of groups of one arithmetic, side by side: arrays (batch, n); ``charge`` (steps, batch, n)."""

    def __init__(self, by_key: Mapping[_Key, TwinGroup], batch: int, steps: int) -> None:
        groups = list(by_key.values())
        ends = np.cumsum([0, *(group.size for group in groups)]).tolist()
        self.columns = {key: slice(*ends[i : i + 2]) for i, key in enumerate(by_key)}
        self.spiking = groups[0].joined_to is None
        self._truncates, self._limited = groups[0].truncates, groups[0].limited
        self._keep_u, self._keep_v, self._threshold, self._bias, self._refractory, self._vmin, self._vmax = (
            np.concatenate([getattr(group, key) for group in groups])
            for key in ("keep_u", "keep_v", "threshold", "bias", "refractory", "vmin", "vmax")
        )
        self._biased, self._blocks = bool(self._bias.any()), bool((self._refractory > 1).any())
        self.charge = np.zeros((steps, batch, ends[-1]))
        self._u, self.v, self.joined = np.zeros((3, batch, ends[-1]))
        self._blocked = np.zeros((batch, ends[-1]), dtype=np.int64)
        self.spikes = np.zeros((batch, steps, ends[-1] if self.spiking else 0), dtype=np.uint8)

    def update(self, step: int, registers: Registers) -> None:
        """Accumulate, decay and join; v is then what the threshold sees."""
        arrived = self.charge[step]
        if self._limited:
            arrived = _wrap(arrived, registers.charge_bits)
        self._u = self._kept(self._u, self._keep_u) + arrived
        if self._limited:
            self._u = _wrap(self._u, registers.current_bits)
        drive = self._u
        if self._biased:
            drive = _wrap(drive + self._bias, registers.current_bits) if self._limited else drive + self._bias
        self.v = self._kept(self.v, self._keep_v) + drive
        if self.spiking:
            self.v += self.joined
        if self._limited:
            np.clip(self.v, self._vmin, self._vmax, out=self.v)
        if self._blocks:
            self.v[self._blocked > 0] = 0.0

    def fire(self, step: int) -> BoolArray:
        """Keep and return which compartments reach their threshold."""
        fired: BoolArray = self.v >= self._threshold
        if self._blocks:
            fired &= self._blocked == 0
        self.spikes[:, step] = fired
        return fired

    def reset(self, spikes: BoolArray) -> None:
        """Reset what spiked, and count its refractory steps."""
        self.v = np.where(spikes, 0.0, self.v)
        if self._blocks:
            self._blocked = np.where(spikes, self._refractory - 1, np.maximum(self._blocked - 1, 0))

    def _kept(self, x: FloatArray, keep: FloatArray) -> FloatArray:
        kept: FloatArray = x * keep
        return np.trunc(kept, out=kept) if self._truncates else kept


def _wrap(x: FloatArray, bits: int) -> FloatArray:
    """Return ``x`` in two's complement of ``bits`` bits plus sign, its fraction kept."""
    half = float(1 << bits)
    if x.max() < half and x.min() >= -half:
        return x  # nearly always, and a remainder takes long
    wrapped: FloatArray = np.where((x < half) & (x >= -half), x, np.mod(x + half, 2 * half) - half)
    return wrapped
