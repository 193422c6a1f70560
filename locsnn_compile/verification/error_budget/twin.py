"""The twin of a chip's compartments in float64, with a switch for every deviation of the chip's arithmetic.

With every switch on and the chip's integers as parameters, all values are integers below 2^53, which float64 holds
exactly, so the twin equals the simulator bit for bit. With every switch off, it is the real-valued recursion.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import sparse

from hw_model.description.chip import Registers
from hw_model.values import BoolArray, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.projections import Matrix, sparse_spikes


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
    """Weights (n_target, n_source), dense or CSR, or (n,) if each source reaches only the target with its own number.

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
    blocks = _blocks(twins, batch, steps)
    home = {key: (block, columns) for block in blocks for key, columns in block.columns.items()}
    joins = [
        (*home[i, group.name], home[i, group.joined_to][1])
        for i, twin in enumerate(twins)
        for group in twin.groups
        if group.joined_to
    ]
    *_, spiking = blocks
    early = {name: played.transpose(1, 0, 2).reshape(steps * batch, -1) for name, played in lines.items()}
    sparse_lines = {name: sparse_spikes(spikes, np.float64) for name, spikes in early.items()}
    synapses = [(i, s) for i, twin in enumerate(twins) for s in twin.synapses if s.delay + 1 < steps]
    onto: dict[tuple[int, _Key], list[tuple[int, _Block, slice, Matrix]]] = {}
    for i, s in synapses:
        target, to_columns = home[i, s.target]
        if s.source in lines:
            # Few lines spike, so their spikes are sparse, whatever the weights are.
            found = sparse_lines[s.source][: batch * (steps - 1 - s.delay)] @ s.weights.T
            charge = found.toarray() if sparse.issparse(found) else found
            target.charge[1 + s.delay :, :, to_columns] += charge.reshape(-1, batch, s.weights.shape[0])
        else:
            onto.setdefault((s.weights.ndim, (i, s.source)), []).append((1 + s.delay, target, to_columns, s.weights))
    watched = {key: columns for key, (_, columns) in home.items() if key[1] in potentials}
    potential = {key: np.empty((batch, steps, here.stop - here.start)) for key, here in watched.items()}
    # What neurons send to those of the same number is added first: in another order, sums round differently.
    sending = sorted(onto.items(), key=lambda item: item[0][0])
    for step in range(steps):
        for block in blocks[:-1]:
            block.update(step, registers)
        spiking.joined[:] = 0.0
        for child, from_columns, to_columns in joins:
            spiking.joined[:, to_columns] += child.v[:, from_columns]
        spiking.update(step, registers)
        for key, kept in potential.items():
            block, columns = home[key]
            kept[:, step] = block.v[:, columns]
        fired = spiking.fire(step)
        if forced is not None:
            fired = np.hstack([forced[name][:, step] for _, name in spiking.columns]).astype(np.bool_)
        spiking.reset(fired)
        for (_, key), synapses_of in sending:
            sent = fired[:, home[key][1]]
            for late, target, to_columns, weights in synapses_of if sent.any() else ():
                if step + late < steps:
                    charge = sent * weights if weights.ndim == 1 else (weights @ sent.T.astype(np.float64)).T
                    target.charge[step + late, :, to_columns] += charge
    traces = [TwinTrace({}, {}) for _ in twins]
    for (i, name), columns in spiking.columns.items():
        traces[i].spikes[name] = np.ascontiguousarray(spiking.spikes[:, :, columns])
    for (i, name), kept in potential.items():
        traces[i].potential[name] = kept
    return traces


def _blocks(twins: Sequence[Twin], batch: int, steps: int) -> "list[_Block]":
    """Return a block of the groups that are joined to others, and as the last block the others, which spike."""
    groups = {(i, group.name): group for i, twin in enumerate(twins) for group in twin.groups}
    joined = {key: group for key, group in groups.items() if group.joined_to}
    spiking = {key: group for key, group in groups.items() if not group.joined_to}
    return [_Block(held, batch, steps) for held in (joined, spiking) if held]


_Key = tuple[int, str]
"""The number of a twin and the name of one of its groups."""


class _Block:
    """Registers of groups side by side: arrays (batch, n); ``charge`` (steps, batch, n)."""

    def __init__(self, by_key: Mapping[_Key, TwinGroup], batch: int, steps: int) -> None:
        groups = list(by_key.values())
        ends = np.cumsum([0, *(group.size for group in groups)]).tolist()
        self.columns, self.size = {key: slice(*ends[i : i + 2]) for i, key in enumerate(by_key)}, ends[-1]
        self._spiking = groups[0].joined_to is None
        self._keep_u, self._keep_v, self._threshold, self._bias, self._refractory, vmin, vmax = (
            np.concatenate([getattr(group, key) for group in groups])
            for key in ("keep_u", "keep_v", "threshold", "bias", "refractory", "vmin", "vmax")
        )
        self._truncates, self._limited = (
            np.repeat([getattr(group, key) for group in groups], np.diff(ends)) for key in ("truncates", "limited")
        )
        self._vmin, self._vmax = np.where(self._limited, vmin, -np.inf), np.where(self._limited, vmax, np.inf)
        self._biased, self._blocks = bool(self._bias.any()), bool((self._refractory > 1).any())
        self.charge = np.zeros((steps, batch, self.size))
        self._u, self.v, self.joined = np.zeros((3, batch, self.size))
        self._blocked = np.zeros((batch, self.size), dtype=np.int64)
        self.spikes = np.zeros((batch, steps, self.size if self._spiking else 0), dtype=np.uint8)

    def update(self, step: int, registers: Registers) -> None:
        """Accumulate, decay and join; afterwards v is what the threshold sees."""
        arrived = self._wrapped(self.charge[step], registers.charge_bits)
        self._u = self._wrapped(self._kept(self._u, self._keep_u) + arrived, registers.current_bits)
        drive = self._wrapped(self._u + self._bias, registers.current_bits) if self._biased else self._u
        self.v = self._kept(self.v, self._keep_v) + drive
        if self._spiking:
            self.v += self.joined
        np.minimum(np.maximum(self.v, self._vmin, out=self.v), self._vmax, out=self.v)  # twice as fast as np.clip
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

    def _kept(self, x: FloatArray, keep: FloatArray) -> FloatArray:
        kept: FloatArray = x * keep
        return np.trunc(kept, out=kept, where=self._truncates)

    def _wrapped(self, x: FloatArray, bits: int) -> FloatArray:
        """Return ``x``, wrapped where limited to ``bits`` bits plus sign in two's complement; fractions are kept."""
        half = float(1 << bits)
        if x.max() < half and x.min() >= -half:
            return x  # nearly always, and np.mod is slow
        wraps = self._limited & ((x >= half) | (x < -half))
        wrapped: FloatArray = np.where(wraps, np.mod(x + half, 2 * half) - half, x)
        return wrapped
