"""The steps of each neuron model: float neurons in ``float_neurons``, on-grid neurons in ``integer_neurons``."""

from functools import singledispatch
from typing import Any, Protocol

from hw_model.description.chip import Registers
from hw_model.values import AnyArray, BoolArray
from locsnn_compile.errors import InputError
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.neurons import Cuba, Neuron, SoftCuba, SrmAlpha
from locsnn_compile.reference.float_neurons import CubaSteps, SoftCubaSteps, SrmSteps
from locsnn_compile.reference.integer_neurons import ChipCubaSteps, ChipSrmSteps


class NeuronSteps(Protocol):
    """The state of a population's neurons, (batch, n)."""

    def step(self, arriving: Any) -> tuple[BoolArray, AnyArray]:
        """Take the weights that arrive; return the spikes, and the potential that decided them."""


@singledispatch
def steps_of(neuron: Neuron, batch: int, size: int, registers: Registers | None = None) -> NeuronSteps:
    """Return neurons at rest, as registered for their model; on-grid neurons wrap and clip in ``registers``."""
    fix = "Register its state with locsnn_compile.reference.evaluate.steps_of."
    raise InputError(f"neuron {type(neuron).__name__}", "nothing says how it steps", fix=fix)


steps_of.register(SrmAlpha, SrmSteps)
steps_of.register(Cuba, CubaSteps)
steps_of.register(SoftCuba, SoftCubaSteps)
steps_of.register(ChipCuba, ChipCubaSteps)
steps_of.register(ChipSrm, ChipSrmSteps)
