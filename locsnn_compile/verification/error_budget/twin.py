"""The twin of a chip's compartments in float64, with a switch for every deviation of the chip's arithmetic.

With every switch on and the chip's integers as parameters, all values are integers below 2^53, which float64 holds
exactly, so the twin equals the simulator bit for bit. With every switch off, it is the real-valued recursion.
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.description.chip import Registers
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.projections import Matrix, sparse_spikes

STACKED_ENTRIES = 1 << 14
"""Matrices with at most this many entries are stacked: a call takes longer than its product, and a copy is small."""


class TwinGroup(Frozen, eq=False):
    """``size`` compartments; every parameter is an array (size,), in units of the registers.

        u = kept(u, keep_u) + q
        v = kept(v, keep_v) + u + bias + the v of joined children
        a spike where v >= threshold; then v = 0, and no spike for ``refractory - 1`` steps

    ``q`` is the arriving charge; ``kept(x, k)`` is k x, truncated toward zero if ``truncates``. If ``limited``, q and u
    wrap and v is clipped. With ``joined_to``, compartment i adds its v to compartment i of that group, and neither
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

    With ``forced`` (batch, steps, n) by group, these spikes are sent and reset their neurons instead of the twin's own,
    so potentials can be compared as if no earlier spike had differed. ``potentials`` names the groups whose potentials
    are kept.
    """
    batch, steps = next(iter(lines.values())).shape[:2]
    registers = twins[0].registers
    *joined, spiking = _blocks(twins, batch, steps)
    home = {
        key: (block, columns)
        for block in (*joined, spiking)
        for key, columns in block.columns.items()
    }
    early = {
        name: played.transpose(1, 0, 2).reshape(steps * batch, -1) for name, played in lines.items()
    }
    sparse_lines = {name: sparse_spikes(spikes, np.float64) for name, spikes in early.items()}
    synapses = [
        (i, s) for i, twin in enumerate(twins) for s in twin.synapses if s.delay + 1 < steps
    ]
    longest = 1 + max((s.delay for _, s in synapses if s.weights.ndim == 1), default=0)
    arrived: dict[tuple[str, int, int], FloatArray] = {}
    own: dict[_Block, FloatArray] = {}
    others: list[dict[str, list[_Onto]]] = [{} for _ in twins]
    for i, s in synapses:
        target, to_columns = home[i, s.target]
        if s.source in lines:
            if (same := (s.source, s.delay, id(s.weights))) not in arrived:
                # Few lines spike, so their spikes are sparse, whatever the weights are.
                found = sparse_lines[s.source][: batch * (steps - 1 - s.delay)] @ s.weights.T
                charge = found.toarray() if sparse.issparse(found) else found
                arrived[same] = charge.reshape(-1, batch, s.weights.shape[0])
            target.charge[1 + s.delay :, :, to_columns] += arrived[same]
        elif s.weights.ndim == 1:
            if target not in own:
                own[target] = np.zeros((longest, 1, target.size))
            own[target][s.delay, 0, to_columns] += s.weights
        else:
            reach = (1 + s.delay, home[i, s.source][1], target, to_columns, s.weights)
            others[i].setdefault(s.source, []).append(reach)
    onto = _stacked(others)
    watched = {key: columns for key, (_, columns) in home.items() if key[1] in potentials}
    potential = {
        key: np.empty((batch, steps, here.stop - here.start)) for key, here in watched.items()
    }
    for step in range(steps):
        spiking.joined[:] = 0.0
        for block in joined:
            block.update(step, registers)
            spiking.joined[:, : block.size] += block.v
        spiking.update(step, registers)
        for key, kept in potential.items():
            block, columns = home[key]
            kept[:, step] = block.v[:, columns]
        fired = spiking.fire(step)
        if forced is not None:
            fired = np.hstack([forced[name][:, step] for _, name in spiking.columns]).astype(
                np.bool_
            )
        spiking.reset(fired)
        sent = fired.astype(np.float64)
        # What neurons send to those of the same number is added first: in another order, sums round differently.
        for target, weights in own.items():
            later = target.charge[step + 1 : step + 1 + longest]
            later += weights[: len(later)] * sent[:, : target.size]
        for late, columns, target, to_columns, weights in onto:
            here = sent[:, columns]
            if step + late < steps and here.any():
                if sparse.issparse(weights):
                    charge = (weights @ here.T).T
                else:
                    by_twin = here.reshape(batch, len(weights), -1).transpose(1, 2, 0)
                    charge = (weights @ by_twin).transpose(2, 0, 1).reshape(batch, -1)
                target.charge[step + late, :, to_columns] += charge
    traces = [TwinTrace({}, {}) for _ in twins]
    for (i, name), columns in spiking.columns.items():
        traces[i].spikes[name] = np.ascontiguousarray(spiking.spikes[:, :, columns])
    for (i, name), kept in potential.items():
        traces[i].potential[name] = kept
    return traces


def _blocks(twins: Sequence[Twin], batch: int, steps: int) -> "list[_Block]":
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
    return [_Block({key: groups[key] for key in keys}, batch, steps) for keys in (*ranks, ordered)]


def _stacked(others: "Sequence[Mapping[str, Sequence[_Onto]]]") -> "list[_Onto]":
    """Stack small dense weights of neighbouring twins, (twins, n_target, n_source), and keep the order of each twin."""
    numbered = [
        item for by_source in others for item in enumerate(chain.from_iterable(by_source.values()))
    ]
    found: list[_Onto] = []
    for _, (late, columns, target, to_columns, weights) in sorted(
        numbered, key=lambda item: (item[0], item[1][1].start)
    ):
        held = weights if sparse.issparse(weights) else weights[None]
        if found and held.ndim == 3 and weights.size <= STACKED_ENTRIES:
            late_before, before, target_before, to_before, held_before = found[-1]
            neighbours = (before.stop, to_before.stop) == (columns.start, to_columns.start)
            if neighbours and (late, target, *weights.shape) == (
                late_before,
                target_before,
                *held_before.shape[1:],
            ):
                columns, to_columns = (
                    slice(before.start, columns.stop),
                    slice(to_before.start, to_columns.stop),
                )
                held = np.concatenate([found.pop()[-1], held])
        found.append((late, columns, target, to_columns, held))
    return found


_Key = tuple[int, str]
"""The number of a twin and the name of one of its groups."""
_Onto = tuple[int, slice, "_Block", slice, Matrix]
"""Steps until spikes arrive, the columns that send them, the block and its columns that they reach, and the weights."""


class _Block:
    """Registers of groups side by side: arrays (batch, n); ``charge`` (steps, batch, n)."""

    def __init__(self, by_key: Mapping[_Key, TwinGroup], batch: int, steps: int) -> None:
        groups = list(by_key.values())
        ends = np.cumsum([0, *(group.size for group in groups)]).tolist()
        self.columns, self.size = (
            {key: slice(*ends[i : i + 2]) for i, key in enumerate(by_key)},
            ends[-1],
        )
        self._spiking = groups[0].joined_to is None
        self._keep_u, self._keep_v, self._threshold, self._bias, self._refractory, vmin, vmax = (
            np.tile(np.concatenate([getattr(group, key) for group in groups]), (batch, 1))
            for key in ("keep_u", "keep_v", "threshold", "bias", "refractory", "vmin", "vmax")
        )
        self._truncates, self._limited = (
            np.tile(np.repeat([getattr(group, key) for group in groups], np.diff(ends)), (batch, 1))
            for key in ("truncates", "limited")
        )
        self._vmin, self._vmax = (
            np.where(self._limited, vmin, -np.inf),
            np.where(self._limited, vmax, np.inf),
        )
        self._biased, self._blocks = bool(self._bias.any()), bool((self._refractory > 1).any())
        self.charge = np.zeros((steps, batch, self.size))
        self._u, self.v, self.joined = np.zeros((3, batch, self.size))
        self._blocked = np.zeros((batch, self.size), dtype=np.int64)
        self.spikes = np.zeros((batch, steps, self.size if self._spiking else 0), dtype=np.uint8)

    def update(self, step: int, registers: Registers) -> None:
        """Accumulate, decay and join; afterwards v is what the threshold sees."""
        self._decay(self._u, self._keep_u)
        self._u += self._wrapped(self.charge[step], registers.charge_bits)
        self._u = self._wrapped(self._u, registers.current_bits)
        self._decay(self.v, self._keep_v)
        self.v += (
            self._wrapped(self._u + self._bias, registers.current_bits) if self._biased else self._u
        )
        if self._spiking:
            self.v += self.joined
        np.minimum(
            np.maximum(self.v, self._vmin, out=self.v), self._vmax, out=self.v
        )  # twice as fast as np.clip
        if self._blocks:
            self.v[self._blocked > 0] = 0.0

    def fire(self, step: int) -> BoolArray:
        """Record and return which compartments reach their threshold."""
        fired: BoolArray = self.v >= self._threshold
        if self._blocks:
            fired &= self._blocked == 0
        self.spikes[:, step] = fired
        return fired

    def reset(self, spikes: BoolArray) -> None:
        """Reset the compartments that spiked, and count refractory steps."""
        self.v[spikes] = 0.0
        if self._blocks:
            self._blocked = np.where(spikes, self._refractory - 1, np.maximum(self._blocked - 1, 0))

    def _decay(self, x: FloatArray, keep: FloatArray) -> None:
        x *= keep
        np.trunc(x, out=x, where=self._truncates)

    def _wrapped(self, x: FloatArray, bits: int) -> FloatArray:
        """Return ``x``, wrapped where limited to ``bits`` bits plus sign in two's complement; fractions are kept."""
        half = float(1 << bits)
        if x.max() < half and x.min() >= -half:
            return x  # nearly always, and np.mod is slow
        wraps = self._limited & ((x >= half) | (x < -half))
        wrapped: FloatArray = np.where(wraps, np.mod(x + half, 2 * half) - half, x)
        return wrapped
