"""The twin of a chip's compartments in float64, every deviation of the chip's arithmetic a switch of its own.

With every switch on, and the chip's integers as parameters, all values are integers below 2^53, which float64 holds
exactly: the twin then equals the simulator bit for bit. With every switch off it is the real-valued recursion.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hw_model.chip_description import Registers
from hw_model.trace import ByteArray
from locsnn_compile.matrices import Matrix
from locsnn_compile.neurons import FloatArray


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
    charge = _charges(twin, lines, batch, steps)
    sent_from = {
        group.name: [s for s in twin.synapses if s.source == group.name] for group in twin.groups if not group.joined_to
    }
    states = {group.name: _State(group, batch) for group in twin.groups}
    spikes = {name: np.zeros((batch, steps, states[name].group.size), dtype=np.uint8) for name in sent_from}
    potential = {name: np.empty((batch, steps, states[name].group.size)) for name in potentials}
    for step in range(steps):
        joined: dict[str, FloatArray] = {}
        for name, state in states.items():
            arrived = charge[name][:, step] if name in charge else 0.0
            state.update(arrived, joined.pop(name, 0.0), twin.registers)
            if name in potential:
                potential[name][:, step] = state.v
            parent = state.group.joined_to
            if parent is not None:
                joined[parent] = joined[parent] + state.v if parent in joined else state.v
        for name, synapses in sent_from.items():
            fired = states[name].fire()
            spikes[name][:, step] = fired
            acts = fired if forced is None else forced[name][:, step].astype(np.bool_)
            states[name].reset(acts)
            for s in synapses:
                due = step + 1 + s.delay
                if due < steps:
                    charge[s.target][:, due] += _deliver(s, acts)
    return TwinTrace(spikes, potential)


def _charges(twin: Twin, lines: Mapping[str, ByteArray], batch: int, steps: int) -> dict[str, FloatArray]:
    """Return the charge of every step, (batch, steps, n) by target, with what the input lines bring already in it."""
    size = {group.name: group.size for group in twin.groups}
    charge = {name: np.zeros((batch, steps, size[name])) for name in {s.target for s in twin.synapses}}
    for s in twin.synapses:
        if s.source in lines:
            early = lines[s.source][:, : max(0, steps - 1 - s.delay)]
            charge[s.target][:, 1 + s.delay :] += _deliver(s, early)
    return charge


def _deliver(synapses: TwinSynapses, spikes: npt.NDArray[np.bool_] | ByteArray) -> FloatArray:
    """Return the charge (..., n_target) that spikes (..., n_source) bring."""
    weights = synapses.weights
    sent = spikes.reshape(-1, spikes.shape[-1]).astype(np.float64)
    charge: FloatArray = sent * weights if weights.ndim == 1 else (weights @ sent.T).T
    return charge.reshape(*spikes.shape[:-1], weights.shape[0])


class _State:
    """Registers of one group, arrays (batch, size)."""

    def __init__(self, group: TwinGroup, batch: int) -> None:
        self.group = group
        self.u, self.v = np.zeros((2, batch, group.size))
        self.blocked = np.zeros((batch, group.size), dtype=np.int64)
        self.blocks = bool((group.refractory > 1).any())

    def update(self, arrived: FloatArray | float, joined: FloatArray | float, registers: Registers) -> None:
        """Accumulate, decay and join; v is then what the threshold sees."""
        group = self.group
        if group.limited:
            arrived = _wrap(arrived, registers.charge_bits)
        self.u = self._kept(self.u, group.keep_u) + arrived
        if group.limited:
            self.u = _wrap(self.u, registers.current_bits)
        drive = self.u + group.bias
        if group.limited:
            drive = _wrap(drive, registers.current_bits)
        self.v = self._kept(self.v, group.keep_v) + drive + joined
        if group.limited:
            self.v = np.clip(self.v, group.vmin, group.vmax)
        if self.blocks:
            self.v[self.blocked > 0] = 0.0

    def fire(self) -> npt.NDArray[np.bool_]:
        """Return which compartments reach their threshold."""
        fired: npt.NDArray[np.bool_] = self.v >= self.group.threshold
        return fired & (self.blocked == 0) if self.blocks else fired

    def reset(self, spikes: npt.NDArray[np.bool_]) -> None:
        """Reset what spiked, and count its refractory steps."""
        self.v = np.where(spikes, 0.0, self.v)
        if self.blocks:
            self.blocked = np.where(spikes, self.group.refractory - 1, np.maximum(self.blocked - 1, 0))

    def _kept(self, x: FloatArray, keep: FloatArray) -> FloatArray:
        return np.trunc(x * keep) if self.group.truncates else x * keep


def _wrap(x: FloatArray | float, bits: int) -> FloatArray:
    """Return ``x`` in two's complement of ``bits`` bits plus sign, its fraction kept."""
    half = float(1 << bits)
    values = np.asarray(x)
    if values.max(initial=0.0) < half and values.min(initial=0.0) >= -half:
        return values  # nearly always, and a remainder takes long
    wrapped: FloatArray = np.mod(values + half, 2 * half) - half
    return wrapped
