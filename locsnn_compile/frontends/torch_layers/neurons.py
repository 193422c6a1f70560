"""The neurons of frameworks that a description may list: one class each, with the options of their constructors.

The docstring of each class has the framework's step, with v the potential and x the input of the step. They become NIR
neurons whose time constants are counted in steps. With ``r = tau``, Euler's method then adds the whole input. A
``Reading`` says how a spike resets, and whether a potential at the threshold spikes.
"""

from typing import Annotated, ClassVar

import numpy as np

from hw_model.io.records import POSITIVE, between
from hw_model.values import FloatArray, Frozen
from locsnn_compile.errors import InputError, check_known
from locsnn_compile.frontends.nir.graph import NirNode
from locsnn_compile.frontends.nir.neurons import Reading, Reset
from locsnn_compile.frontends.torch_layers.chain import DT_SECONDS, Chain
from locsnn_compile.frontends.torch_layers.layers import Layer

SNNTORCH_RESETS = ("subtract", "zero", "none")
"""The reset mechanisms of snnTorch, in the order of their numbers in a state dict."""
Share = Annotated[float | None, between(0, 1)]
"""A decay as the share that is kept; None if the option is not given."""
Positive = Annotated[float | None, POSITIVE]
"""A number above 0; None if the option is not given."""


def _parameter(
    chain: Chain, name: str, key: str, option: float | None, usual: float | None = None
) -> FloatArray:
    """Return a parameter of neurons: from the state dict if it has it, else the option, else the default ``usual``.

    Raises ``InputError`` if both have different values, or if nothing has a value.
    """
    place = chain.place(name)
    stored = chain.optional(name, key)
    if stored is None:
        value = usual if option is None else option
        if value is None:
            raise InputError(f"{place}, {key}", "it is missing", fix="Add it.")
        return np.array(value, dtype=np.float64)
    if option is not None and not np.allclose(stored, option, rtol=1e-6):
        measured = f"{option:g} against {stored.reshape(-1)[0]:g}"
        what = "the state dict has another value"
        raise InputError(f"{place}, {key}", what, measured=measured, fix="Leave it out.")
    return stored


def _time_constant(kept: FloatArray) -> FloatArray:
    """Return the time constant, in steps, of a state of which the share ``kept`` remains after a step.

    Euler's method loses 1 / tau per step; a share of 1 has an infinite time constant.
    """
    with np.errstate(divide="ignore"):
        return np.asarray(1 / (1 - np.clip(kept, 0, 1)))


class SnntorchNeurons(Layer, Frozen):
    """Base of snnTorch's neurons: they spike above the threshold, and by default reset one step later."""

    beta: Share = None
    threshold: Positive = None
    reset_mechanism: str | None = None
    reset_delay: bool = True

    late_zero: ClassVar[bool]
    """Whether a reset to zero also holds in the next step, with ``reset_delay``."""

    def reading(self, chain: Chain, name: str) -> Reading:
        """Return how a spike resets, from the state dict or else the option.

        Raises ``InputError`` if both have different values.
        """
        mechanism = self.reset_mechanism
        stored = chain.optional(name, "reset_mechanism_val")
        if stored is not None:
            number = int(np.clip(stored.reshape(-1)[0], 0, len(SNNTORCH_RESETS) - 1))
            mechanism = SNNTORCH_RESETS[number]
            if self.reset_mechanism not in (None, mechanism):
                what = "the state dict has another reset_mechanism"
                measured = f"{self.reset_mechanism} against {mechanism}"
                raise InputError(chain.place(name), what, measured=measured, fix="Leave it out.")
        check_known(
            f"{chain.place(name)}, reset_mechanism",
            f"{mechanism!r} is not known",
            mechanism,
            SNNTORCH_RESETS,
        )
        reset = self._reset(mechanism or "subtract")
        return Reading(dt=DT_SECONDS, discretisation="euler", reset=reset)

    def _reset(self, mechanism: str) -> Reset:
        """Return the name that a ``Reading`` has for a mechanism of snnTorch."""
        if mechanism == "none":
            return "none"
        if mechanism == "zero":
            return "late-zero" if self.reset_delay and self.late_zero else "zero"
        return "late-subtract" if self.reset_delay else "subtract"


class SnntorchLeaky(SnntorchNeurons, Frozen):
    """``snntorch.Leaky``: v = beta v + x."""

    late_zero = False

    def add_to(self, chain: Chain, name: str) -> None:
        """Add an LIF to which spikes add their weights."""
        tau = _time_constant(_parameter(chain, name, "beta", self.beta))
        threshold = _parameter(chain, name, "threshold", self.threshold, usual=1.0)
        parameters = {"tau": tau, "r": tau, "v_leak": np.array(0.0), "v_reset": np.array(0.0)}
        node = NirNode("LIF", {**parameters, "v_threshold": threshold})
        chain.add_neurons(name, node, self.reading(chain, name))


class SnntorchSynaptic(SnntorchNeurons, Frozen):
    """``snntorch.Synaptic``: i = alpha i + x, then v = beta v + i."""

    alpha: Share = None

    late_zero = True

    def add_to(self, chain: Chain, name: str) -> None:
        """Add a CubaLIF: spikes add their weights to the current, and the current is added to the potential."""
        tau_syn = _time_constant(_parameter(chain, name, "alpha", self.alpha))
        tau_mem = _time_constant(_parameter(chain, name, "beta", self.beta))
        threshold = _parameter(chain, name, "threshold", self.threshold, usual=1.0)
        parameters = {
            "tau_syn": tau_syn,
            "tau_mem": tau_mem,
            "r": tau_mem,
            "w_in": tau_syn,
            "v_leak": np.array(0.0),
            "v_reset": np.array(0.0),
            "v_threshold": threshold,
        }
        chain.add_neurons(name, NirNode("CubaLIF", parameters), self.reading(chain, name))


class SpikingjellyNeurons(Layer, Frozen):
    """Base of spikingjelly's neurons: they spike at the threshold. If ``v_reset`` is None, it is subtracted."""

    v_threshold: Annotated[float, POSITIVE] = 1.0
    v_reset: float | None = 0.0

    def parameters(self) -> dict[str, FloatArray]:
        """Return the parameters of a node for the threshold and the reset."""
        reset_to = 0.0 if self.v_reset is None else self.v_reset
        return {"v_threshold": np.array(self.v_threshold), "v_reset": np.array(reset_to)}

    def reading(self) -> Reading:
        """Return how a spike resets."""
        reset: Reset = "subtract" if self.v_reset is None else "zero"
        return Reading(dt=DT_SECONDS, discretisation="euler", reset=reset, rule=">=")


class SpikingjellyIF(SpikingjellyNeurons, Frozen):
    """``spikingjelly.activation_based.neuron.IFNode``: v = v + x."""

    def add_to(self, chain: Chain, name: str) -> None:
        """Add an IF."""
        node = NirNode("IF", {"r": np.array(1.0), **self.parameters()})
        chain.add_neurons(name, node, self.reading())


class SpikingjellyLIF(SpikingjellyNeurons, Frozen):
    """``LIFNode``: v = v + (x - (v - v_reset)) / tau, or x undivided without ``decay_input``."""

    tau: Annotated[float, POSITIVE] = 2.0
    decay_input: bool = True

    def add_to(self, chain: Chain, name: str) -> None:
        """Add an LIF."""
        self.add_leaky(chain, name, self.tau)

    def add_leaky(self, chain: Chain, name: str, tau: float) -> None:
        """Add an LIF of a time constant in steps."""
        parameters = self.parameters()
        parameters["v_leak"] = parameters["v_reset"]
        parameters["tau"] = np.array(tau)
        parameters["r"] = np.array(1.0 if self.decay_input else tau)
        chain.add_neurons(name, NirNode("LIF", parameters), self.reading())


class SpikingjellyParametricLIF(SpikingjellyLIF, Frozen):
    """``ParametricLIFNode``: an LIFNode whose 1 / tau is the sigmoid of the state dict's ``w``."""

    def add_to(self, chain: Chain, name: str) -> None:
        """Add an LIF."""
        w = float(chain.tensor(name, "w").reshape(-1)[0])
        tau = 1 + float(np.exp(-w))  # 1 / sigmoid(w)
        self.add_leaky(chain, name, tau)


class NorseLIFBox(Layer, Frozen):
    """``norse.torch.LIFBoxCell``: v = v + dt tau_mem_inv (v_leak - v + x); it spikes above v_th."""

    tau_mem_inv: Annotated[float, POSITIVE] = 100.0
    v_th: float = 1.0
    v_leak: float = 0.0
    v_reset: float = 0.0
    dt: Annotated[float, POSITIVE] = 1e-3

    def add_to(self, chain: Chain, name: str) -> None:
        """Add an LIF."""
        parameters = {
            "tau": np.array(1 / (self.dt * self.tau_mem_inv)),
            "r": np.array(1.0),
            "v_leak": np.array(self.v_leak),
            "v_threshold": np.array(self.v_th),
            "v_reset": np.array(self.v_reset),
        }
        reading = Reading(dt=DT_SECONDS, discretisation="euler", reset="zero")
        chain.add_neurons(name, NirNode("LIF", parameters), reading)


class SinabsNeurons(Layer, Frozen):
    """Base of sinabs' neurons with ``spike_fn`` SingleSpike: they spike at the threshold.

    ``reset_fn`` is MembraneSubtract, or MembraneReset, which resets to 0. ``min_v_mem`` is the floor of the potential.
    """

    spike_threshold: Positive = None
    min_v_mem: float | None = None
    reset_fn: str = "MembraneSubtract"

    def reading(self, chain: Chain, name: str) -> Reading:
        """Return how a spike resets, and the floor of the potential."""
        resets: dict[str, Reset] = {"MembraneSubtract": "subtract", "MembraneReset": "zero"}
        place = f"{chain.place(name)}, reset_fn"
        check_known(place, f"{self.reset_fn!r} is not known", self.reset_fn, resets)
        stored = chain.optional(name, "min_v_mem")
        floor = self.min_v_mem if stored is None else float(stored.reshape(-1)[0])
        return Reading(
            dt=DT_SECONDS,
            discretisation="hold",
            reset=resets[self.reset_fn],
            floor=floor,
            rule=">=",
        )

    def ends(self, chain: Chain, name: str) -> dict[str, FloatArray]:
        """Return the parameters of a node for the threshold and the reset."""
        threshold = _parameter(chain, name, "spike_threshold", self.spike_threshold, usual=1.0)
        return {"v_threshold": threshold, "v_reset": np.array(0.0)}


class SinabsIAF(SinabsNeurons, Frozen):
    """``sinabs.layers.IAF``: v = v + x."""

    def add_to(self, chain: Chain, name: str) -> None:
        """Add an IF."""
        node = NirNode("IF", {"r": np.array(1.0), **self.ends(chain, name)})
        chain.add_neurons(name, node, self.reading(chain, name))


class SinabsLIF(SinabsNeurons, Frozen):
    """``sinabs.layers.LIF``: v = a v + (1 - a) x with a = exp(-1 / tau_mem), or + x without ``norm_input``."""

    tau_mem: Positive = None
    norm_input: bool = True

    def add_to(self, chain: Chain, name: str) -> None:
        """Add an LIF whose input is held during a step."""
        tau = _parameter(chain, name, "tau_mem", self.tau_mem)
        r = np.ones_like(tau)
        if not self.norm_input:
            # Holding the input multiplies it by 1 - a, which is undone here.
            r = 1 / -np.expm1(-1 / tau)
        parameters = {"tau": tau, "r": r, "v_leak": np.array(0.0), **self.ends(chain, name)}
        chain.add_neurons(name, NirNode("LIF", parameters), self.reading(chain, name))


NEURON_TYPES: dict[str, type[Layer]] = {
    "snntorch.Leaky": SnntorchLeaky,
    "snntorch.Synaptic": SnntorchSynaptic,
    "spikingjelly.IFNode": SpikingjellyIF,
    "spikingjelly.LIFNode": SpikingjellyLIF,
    "spikingjelly.ParametricLIFNode": SpikingjellyParametricLIF,
    "norse.LIFBoxCell": NorseLIFBox,
    "sinabs.IAF": SinabsIAF,
    "sinabs.LIF": SinabsLIF,
}
"""The classes of neurons, by the type that a description states."""
