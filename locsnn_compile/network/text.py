"""The two levels of networks as stable text, for people to read and for golden tests to compare.

``levels.txt`` says how a level reads.
"""

from functools import singledispatch
from typing import Any

import numpy as np

from hw_model.mapping.graph import Axis
from hw_model.program.text import array_text
from hw_model.texts.pieces import Pieces
from hw_model.values import FloatArray, IntArray
from locsnn_compile.errors import counted
from locsnn_compile.network.chip_neurons import ChipCuba, ChipNeuron, ChipSrm, Refractory
from locsnn_compile.network.network import InputView, Network
from locsnn_compile.network.neurons import Cuba, Leaky, Neuron, SoftCuba, SrmAlpha
from locsnn_compile.network.projections import Matrix, values_of
from locsnn_compile.network.quantized import QuantizedNetwork, QuantizedPopulation


def network_text(network: Network) -> str:
    """Return the text of a Network."""
    views = [_view(view, network) for view in network.views]
    populations = [vars(p) | {"text": neuron_text(p.neuron, p.axis)} for p in network.populations]
    return _LEVELS.piece("network", network, views=views, populations=populations)


def quantized_text(quantized: QuantizedNetwork) -> str:
    """Return the text of a QuantizedNetwork."""
    return _LEVELS.piece(
        "quantized", quantized, populations=[_integers(q) for q in quantized.populations]
    )


def _view(view: InputView, network: Network) -> dict[str, Any]:
    together = None if view.together == 1 else view.together
    return vars(view) | {"steps": network.steps_of(view.phase), "together": together}


def _integers(q: QuantizedPopulation) -> dict[str, Any]:
    text = neuron_text(q.neuron, q.population.axis)
    fit = q.fit and {
        "strategy": q.strategy,
        "own": None if q.fit.refractory_max is None else q.fit,
        **vars(q.fit),
    }
    return {"name": q.population.name, "text": text, "scale": q.scale, "fit": fit}


@singledispatch
def neuron_text(n: Neuron, axis: Axis) -> str:
    """Return the text of neurons along an axis; for a model without its own text, its name and numbers."""
    rows = (f"{name} {_number_text(values)}" for name, values, *_ in n.parameters(1))
    return f"{type(n).__name__} neurons along {axis}, {', '.join(rows)}"


def _own_text(n: Neuron, axis: Axis) -> str:
    """Return the text of a model of this package, the piece of its name; of what is as usual, nothing is said."""
    unusual = {
        "cut": n != n.whole(),
        "bias": n.biased.any(),
        "dendrites": n.dendrites != 1,
        "floor": n.has_floor,
    }
    said: dict[str, Any] = {name: n if told else None for name, told in unusual.items()}
    return _LEVELS.piece(type(n).__name__, n, axis=axis, **said)


for _model in (SrmAlpha, Cuba, SoftCuba, ChipCuba, ChipSrm):
    neuron_text.register(_model, _own_text)


def _decays_text(n: Leaky | ChipNeuron) -> str:
    return f"decay_u {_number_text(n.decay_u)}, decay_v {_number_text(n.decay_v)}"


def _refractory_text(part: Refractory) -> str:
    taps = zip(part.delay.tolist(), part.mantissa, part.exponent.tolist(), strict=True)
    weights = [
        (f"{array_text(mantissa)} * 2^{exponent}", delay) for delay, mantissa, exponent in taps
    ]
    if part.decay is not None:
        return f"refractory dendrite of decay {array_text(part.decay)} and weight {weights[0][0]}"
    after = [f"{weight} after {delay}" for weight, delay in weights]
    return f"{len(weights)} refractory taps: {', '.join(after) or 'none'}"


def _matrix_text(m: Matrix) -> str:
    values = values_of(m)
    return (
        f"{counted(len(values), 'entry', 'entries')} " if values.ndim == 1 else ""
    ) + array_text(values)


def _delay_text(delay: int | IntArray) -> str:
    return f", delay {array_text(np.asarray(delay))}" if np.any(delay) else ""


def _number_text(values: FloatArray | IntArray) -> str:
    low, high = values.min(), values.max()
    return f"{low:g}" if low == high else array_text(values)


_LEVELS = Pieces(
    __package__,
    "levels.txt",
    str,
    array=array_text,
    number=_number_text,
    matrix=_matrix_text,
    delay=_delay_text,
    decays=_decays_text,
    own_spikes=_refractory_text,
)
