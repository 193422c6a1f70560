"""The twin of a chip's compartments in float64, every deviation of the chip's arithmetic a switch of its own.

With every switch on, and the chip's integers as parameters, all values are integers below 2^53, which float64 holds
exactly: the twin then equals the simulator bit for bit. With every switch off it is the real-valued recursion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy import sparse

from hw_model.description.chip import Registers
from hw_model.engine.trace import ByteArray
from locsnn_compile.network.neurons import FloatArray
from locsnn_compile.network.projections import Matrix


@dataclass(frozen=True, eq=False)
class TwinGroup:
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
    refractory: npt.NDArray[np.int64]
    vmin: FloatArray
    vmax: FloatArray
    truncates: bool
    limited: bool
    joined_to: str | None = None


@dataclass(frozen=True, eq=False)
class TwinSynapses:
    """Weights (n_target, n_source), dense or CSR, or (n,) where each source reaches the target of its own number only.

    A spike of step t arrives at step ``t + 1 + delay``.
    """

    source: str
    target: str
    weights: Matrix
    delay: int = 0


@dataclass(frozen=True, eq=False)
class Twin:
    """The compartments of one phase, children before their parents, and the synapses between them."""

    groups: tuple[TwinGroup, ...]
    synapses: tuple[TwinSynapses, ...]
    registers: Registers


@dataclass(frozen=True, eq=False)
class TwinTrace:
    """``spikes[name]`` (batch, steps, n) of groups that spike; ``potential[name]`` (v as the threshold saw it)."""

    spikes: dict[str, ByteArray]
    potential: dict[str, FloatArray]


def run_twin(
    twin: Twin,
    lines: Mapping[str, ByteArray],
    *,
    forced: Mapping[str, ByteArray] | None = None,
    potentials: tuple[str, ...] = (),
) -> TwinTrace:
    """Run recordings through a twin; ``lines[input]`` (batch, steps, lines) are the spikes of the phase's inputs.

    With ``forced`` (batch, steps, n) by group, these spikes are sent, and reset their neurons, in place of the twin's
    own, so that potentials can be compared as if no earlier spike had differed. ``potentials`` names the groups whose
    potentials are kept.
    """
    batch, steps = next(iter(lines.values())).shape[:2]
    blocks = _blocks(twin, batch, steps)
    home = {name: (block, columns) for block in blocks for name, columns in block.columns.items()}
    joins = [(*home[group.name], *home[group.joined_to]) for group in twin.groups if group.joined_to]
    sent_from = {
        group.name: [s for s in twin.synapses if s.source == group.name] for group in twin.groups if not group.joined_to
    }
    for s in twin.synapses:
        if s.source in lines:
            block, columns = home[s.target]
            early = lines[s.source][:, : max(0, steps - 1 - s.delay)].transpose(1, 0, 2)
            block.charge[1 + s.delay :, :, columns] += _deliver_all(s, early)
    spikes = {name: np.zeros((batch, steps, home[name][0].width(name)), dtype=np.uint8) for name in sent_from}
    potential = {name: np.empty((batch, steps, home[name][0].width(name))) for name in potentials}
    for step in range(steps):
        for block in blocks:
            if block.spiking:
                block.joined[:] = 0.0
                for child, from_columns, parent, to_columns in joins:
                    if parent is block:
                        block.joined[:, to_columns] += child.v[:, from_columns]
            block.update(step, twin.registers)
        for name in potential:
            block, columns = home[name]
            potential[name][:, step] = block.v[:, columns]
        for block in blocks:
            if block.spiking:
                fired = block.fire()
                for name, columns in block.columns.items():
                    spikes[name][:, step] = fired[:, columns]
                    if forced is not None:
                        fired[:, columns] = forced[name][:, step]
                block.reset(fired)
                for name, columns in block.columns.items():
                    for s in sent_from[name]:
                        if step + 1 + s.delay < steps:
                            target, to_columns = home[s.target]
                            target.charge[step + 1 + s.delay, :, to_columns] += _deliver(s, fired[:, columns])
    return TwinTrace(spikes, potential)


def _blocks(twin: Twin, batch: int, steps: int) -> list[_Block]:
    """Return the groups in blocks of one arithmetic each, those that are joined to others first."""
    kinds: dict[tuple[bool, bool, bool], list[TwinGroup]] = {}
    for group in twin.groups:
        kinds.setdefault((group.joined_to is None, group.truncates, group.limited), []).append(group)
    return [_Block(kinds[kind], batch, steps) for kind in sorted(kinds)]


def _deliver(synapses: TwinSynapses, spikes: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the charge (batch, n_target) that the spikes (batch, n_source) of one step bring."""
    sent, weights = spikes.astype(np.float64), synapses.weights
    charge: FloatArray = sent * weights if weights.ndim == 1 else (weights @ sent.T).T
    return charge


def _deliver_all(synapses: TwinSynapses, spikes: ByteArray) -> FloatArray:
    """Return the charge (steps, batch, n_target) that few spikes among many (steps, batch, n_source) bring."""
    sent = sparse.csr_array(spikes.reshape(-1, spikes.shape[2]), dtype=np.float64)
    found = sent @ synapses.weights.T
    charge: FloatArray = found.toarray() if sparse.issparse(found) else found
    return charge.reshape(*spikes.shape[:2], synapses.weights.shape[0])


class _Block:
    """Registers of groups of one arithmetic, side by side: arrays (batch, n); ``charge`` (steps, batch, n)."""

    def __init__(self, groups: list[TwinGroup], batch: int, steps: int) -> None:
        ends = np.cumsum([0, *(group.size for group in groups)]).tolist()
        self.columns = {group.name: slice(*ends[i : i + 2]) for i, group in enumerate(groups)}
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

    def width(self, name: str) -> int:
        """Return the size of a group."""
        columns = self.columns[name]
        return int(columns.stop - columns.start)

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

    def fire(self) -> npt.NDArray[np.bool_]:
        """Return which compartments reach their threshold."""
        fired: npt.NDArray[np.bool_] = self.v >= self._threshold
        return fired & (self._blocked == 0) if self._blocks else fired

    def reset(self, spikes: npt.NDArray[np.bool_]) -> None:
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
    wrapped: FloatArray = np.mod(x + half, 2 * half) - half
    return wrapped
