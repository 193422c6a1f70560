"""A stand-in for the parts of Lava that an emitted script uses, written from the formulas of Lava's fixed-point models.

No line is copied from Lava. In each step of a connected network, due charges arrive, neurons are updated, and the spikes
of neurons and sources become due in the steps in which they act.
"""

from __future__ import annotations

from enum import Enum

import numpy as np

CURRENT_TOP = 2**23
"""Currents wrap and voltages are clipped at this magnitude."""


class SignMode(Enum):
    MIXED = "mixed"
    EXCITATORY = "excitatory"
    INHIBITORY = "inhibitory"


class Port:
    """An end of connections; ``partners`` are the processes at their other ends."""

    def __init__(self, process, shape):
        self.process = process
        self.shape = shape
        self.partners = []

    def connect(self, other):
        self.partners.append(other.process)
        other.partners.append(self.process)


class Var:
    """A value of a process that the script reads with ``get``."""

    def __init__(self, value):
        self.value = value

    def get(self):
        return self.value


class Source:
    """Plays spikes ``data`` (n, steps)."""

    def __init__(self, *, data):
        self.data = data
        self.s_out = Port(self, data.shape[:-1])
        self.ports = (self.s_out,)

    def spikes_of(self, step):
        return self.data[:, step]


class Sink:
    """Records the spikes of its sender (n, steps)."""

    def __init__(self, *, shape, buffer):
        self.data = Var(np.zeros((*shape, buffer)))
        self.a_in = Port(self, shape)
        self.ports = (self.a_in,)


class DelayDense:
    """Synapses (targets, sources) with delays; ``due[step]`` is the charge of each target in a step."""

    def __init__(self, *, weights, delays, weight_exp, num_weight_bits, sign_mode):
        self.weights = stored(weights, num_weight_bits, SignMode[sign_mode.name])
        self.delays = np.broadcast_to(delays, weights.shape)
        self.weight_exp = weight_exp
        self.s_in = Port(self, weights.shape[1:])
        self.a_out = Port(self, weights.shape[:1])
        self.ports = (self.s_in, self.a_out)
        self.due = {}

    def put_off(self, step, spikes):
        """Add the weights of spikes to the charges of the steps in which they act."""
        for delay in np.unique(self.delays):
            mantissas = np.where(self.delays == delay, self.weights, 0)[:, spikes != 0].sum(axis=1)
            acts = step + 1 + int(delay)
            self.due[acts] = self.due.get(acts, 0) + (mantissas << self.weight_exp)


class Dense(DelayDense):
    def __init__(self, *, weights, **settings):
        super().__init__(weights=weights, delays=0, **settings)


class LIF:
    """Neurons with a current u and a voltage v; running one runs the whole network."""

    def __init__(self, *, shape, du, dv, vth, bias_mant, bias_exp):
        self.u = Var(np.zeros(shape, dtype=np.int64))
        self.v = Var(np.zeros(shape, dtype=np.int64))
        self.decay_u = du + 1
        self.decay_v = dv
        self.threshold = vth << 6
        self.bias = bias_mant << bias_exp
        self.a_in = Port(self, shape)
        self.s_out = Port(self, shape)
        self.ports = (self.a_in, self.s_out)
        self.spikes = np.zeros(shape, dtype=np.int64)

    def update(self, step):
        charge = sum(dense.due.pop(step, 0) for dense in self.a_in.partners)
        u = kept(self.u.value, self.decay_u) + (charge << 6)
        u = np.where(u > CURRENT_TOP, u - 2 * CURRENT_TOP, u)
        u = np.where(u <= -CURRENT_TOP, u + 2 * CURRENT_TOP, u)
        v = kept(self.v.value, self.decay_v) + u + self.bias
        v = np.clip(v, 1 - CURRENT_TOP, CURRENT_TOP - 1)
        self.spikes = (v > self.threshold).astype(np.int64)
        self.u.value = u
        self.v.value = np.where(self.spikes, 0, v)

    def spikes_of(self, step):
        del step
        return self.spikes

    def run(self, condition, run_cfg):
        assert run_cfg == "fixed_pt"
        network = connected(self)
        neurons = [process for process in network if isinstance(process, LIF)]
        for step in range(condition):
            for process in neurons:
                process.update(step)
            for process in network:
                if isinstance(process, DelayDense):
                    (sender,) = process.s_in.partners
                    process.put_off(step, sender.spikes_of(step))
                if isinstance(process, Sink):
                    (sender,) = process.a_in.partners
                    process.data.value[:, step] = sender.spikes_of(step)

    def stop(self):
        pass


def RunSteps(num_steps):  # noqa: N802
    return num_steps


def Loihi2SimCfg(select_tag):  # noqa: N802
    return select_tag


def stored(weights, num_weight_bits, sign_mode):
    """Return weights as a format holds them: clipped, and without the low bits that it does not store."""
    if sign_mode is SignMode.INHIBITORY:
        return -stored(-weights, num_weight_bits, SignMode.EXCITATORY)
    mixed = sign_mode is SignMode.MIXED
    step = 2 ** (8 - num_weight_bits + mixed)
    return np.clip(weights, -256 if mixed else 0, 255) // step * step


def kept(values, decay):
    """Return values * (4096 - decay) / 4096, truncated toward zero."""
    product = values * (4096 - decay)
    return np.sign(product) * (np.abs(product) >> 12)


def connected(first):
    """Return all processes that are connected to a process, directly or through others."""
    processes = [first]
    for process in processes:  # the list grows while it is read
        for port in process.ports:
            processes += [partner for partner in port.partners if partner not in processes]
    return processes
