"""Neuron models that a user defines outside the package: checked, printed, evaluated, and compiled or refused.

A model registers how it steps (``steps_of``), its integers on the chip (``integers_of``), and the exact numbers that the
error budget needs (``forms_of``). Each part may be missing.
"""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.network.check import check_network
from locsnn_compile.network.neurons import (
    FRACTION,
    NOT_NEGATIVE,
    POSITIVE,
    Cuba,
    FloatArray,
    Musts,
    Neuron,
)
from locsnn_compile.network.text import network_text
from locsnn_compile.passes.cuba.quantize import quantize_cuba
from locsnn_compile.passes.quantize import integers_of
from locsnn_compile.reference.evaluate import evaluate, steps_of
from locsnn_compile.reference.float_neurons import CubaSteps
from locsnn_compile.verification.error_budget.forms import forms_of
from tests.support.networks import recordings, single


@dataclass(frozen=True, eq=False)
class Adaptive(Neuron):
    """Leaky integrate-and-fire neurons whose threshold a spike raises by ``step``, of which ``fade`` is lost per step.

        a(t) = (1 - fade) * a(t - 1) + step * (1 where it spiked at t - 1)
        v(t) = (1 - decay) * v(t - 1) + weights that arrive

    It spikes where ``v(t) > threshold + a(t)``; then v = 0.
    """

    decay: FloatArray
    threshold: FloatArray
    step: FloatArray
    fade: FloatArray

    musts: ClassVar[Musts] = {
        "decay": FRACTION,
        "threshold": POSITIVE,
        "step": NOT_NEGATIVE,
        "fade": FRACTION,
    }
    needs: ClassVar[str] = "a threshold that rises with each spike"
    way_out: ClassVar[str] = "Train with a constant threshold (Cuba)."

    @property
    def spikes_at(self):
        return self.threshold


class AdaptiveSteps:
    """The state of adaptive neurons for a batch of recordings, advanced as the equations say."""

    def __init__(self, neuron, batch, size, registers=None):
        self.neuron = neuron
        self.v = np.zeros((batch, size))
        self.a = np.zeros((batch, size))
        self.fired = np.zeros((batch, size))

    def step(self, arriving):
        n = self.neuron
        self.a = (1 - n.fade) * self.a + n.step * self.fired
        potential = (1 - n.decay) * self.v + arriving
        self.fired = potential > n.threshold + self.a
        self.v = np.where(self.fired, 0.0, potential)
        return self.fired, potential


steps_of.register(Adaptive, AdaptiveSteps)

NEURON = Adaptive(np.full(2, 0.1), np.array([1.0, 1.5]), np.full(2, 0.5), np.full(2, 0.25))
WEIGHTS = np.array([[0.7, 0.4, -0.2], [0.9, -0.3, 0.6]])


def adaptive(**changes):
    """Return a network of two adaptive neurons, with some parameters changed."""
    return single(replace(NEURON, **changes), WEIGHTS, steps=40)


FAULTS = [
    pytest.param(
        {"threshold": np.array([1.0, 0.0])},
        "population 'n': threshold must be above 0 (0.0). Correct it.",
        id="threshold",
    ),
    pytest.param(
        {"fade": np.full(2, 1.5)},
        "population 'n': fade must be a fraction from 0 to 1 (1.5). Correct it.",
        id="fade",
    ),
    pytest.param(
        {"step": np.full(3, 0.5)},
        "population 'n': step has the wrong shape ((3,) against (2,)). Give one number per neuron.",
        id="shape",
    ),
    pytest.param(
        {"threshold": np.full(2, 1e-200)},
        "population 'n': threshold is too small a number to compute with (1e-200 against 1e-100 to 1e+100). "
        "Give it in other units.",
        id="size",
    ),
]


@pytest.mark.parametrize(("changes", "message"), FAULTS)
def test_parameters_of_the_model_are_checked(changes, message):
    check_network(adaptive())
    with pytest.raises(InputError) as caught:
        check_network(adaptive(**changes))
    assert str(caught.value) == message


def test_the_model_is_printed():
    assert network_text(adaptive()).splitlines()[2] == (
        "  population n: 2 Adaptive neurons along time, decay 0.1, threshold 1.0 1.5, step 0.5, fade 0.25"
    )


def by_hand(network, played):
    """Return spikes and potentials of :class:`Adaptive`, neuron by neuron and step by step, from its equations."""
    neuron = network.populations[0].neuron
    spikes = np.zeros((len(played), network.steps, 2), dtype=np.uint8)
    potential = np.zeros(spikes.shape)
    for s, events in enumerate(played):
        for i in range(2):
            v = a = fired = 0.0
            for t in range(network.steps):
                arriving = events[t - 1] @ WEIGHTS[i] if t > 0 else 0.0
                a = (1 - neuron.fade[i]) * a + neuron.step[i] * fired
                v = (1 - neuron.decay[i]) * v + arriving
                fired = float(v > neuron.threshold[i] + a)
                potential[s, t, i] = v
                spikes[s, t, i] = fired
                v = 0.0 if fired else v
    return spikes, potential


def test_the_reference_does_what_the_equations_say():
    network = adaptive()
    played = recordings(network, samples=4, rate=0.6)
    reference = evaluate(network, played, potentials=True)
    spikes, potential = by_hand(network, played)
    assert np.array_equal(reference.spikes["n"], spikes)
    np.testing.assert_allclose(reference.potential["n"], potential, atol=1e-12)
    # The rising threshold matters: with a constant one there are more spikes.
    spikes_without_adaptation = evaluate(adaptive(step=np.zeros(2)), played).spikes["n"]
    assert 0 < spikes.sum() < spikes_without_adaptation.sum()


@pytest.mark.parametrize("strategy", ["auto", "reset"])
def test_a_chip_that_cannot_hold_it_says_what_it_lacks(strategy):
    network = adaptive()
    with pytest.raises(TargetError) as caught:
        lc.compile(network, events=recordings(network), strategy=strategy)
    assert str(caught.value) == (
        "population 'n': loihi-sim does not have a threshold that rises with each spike. "
        "Train with a constant threshold (Cuba)."
    )


@dataclass(frozen=True, eq=False)
class Unknown(Neuron):
    """A model of which nothing is registered."""

    @property
    def spikes_at(self):
        return 1.0


class Stepping(Unknown):
    """A model of which only the steps are registered."""


@dataclass(frozen=True, eq=False)
class Integrator(Neuron):
    """Integrate-and-fire neurons: v(t) = v(t - 1) + weights that arrive; a spike where v > threshold, then v = 0."""

    threshold: FloatArray

    musts: ClassVar[Musts] = {"threshold": POSITIVE}

    @property
    def spikes_at(self):
        return self.threshold


class Explained(Integrator):
    """An integrator of which the exact numbers for the error budget are registered as well."""


def as_cuba(neuron, size):
    """Return the package's own neurons that do the same."""
    return Cuba.of(size, decay_v=0.0, threshold=neuron.spikes_at)


for model in (Stepping, Integrator):
    steps_of.register(
        model, lambda n, batch, size, registers=None: CubaSteps(as_cuba(n, size), batch, size)
    )
integers_of.register(
    Integrator, lambda n, task: quantize_cuba(as_cuba(n, task.population.size), task)
)
forms_of.register(
    Explained, lambda n, levels, q: forms_of(as_cuba(n, q.population.size), levels, q)
)


UNREGISTERED = [
    pytest.param(
        Unknown(),
        InputError,
        "neuron Unknown: nothing says how it steps. "
        "Register its state with locsnn_compile.reference.evaluate.steps_of.",
        id="no steps",
    ),
    pytest.param(
        Stepping(),
        TargetError,
        "population 'n': loihi-sim does not have Stepping neurons. "
        "Use neurons that the chip has: SrmAlpha, Cuba or SoftCuba.",
        id="no integers",
    ),
]


@pytest.mark.parametrize(("neuron", "error", "message"), UNREGISTERED)
def test_an_error_names_the_part_that_is_not_registered(neuron, error, message):
    network = single(neuron, WEIGHTS)
    with pytest.raises(error) as caught:
        lc.compile(network, events=recordings(network))
    assert str(caught.value) == message


@pytest.mark.parametrize(("model", "unexplained"), [(Integrator, True), (Explained, False)])
def test_a_model_with_registered_integers_runs_on_the_chip(model, unexplained):
    weights = np.random.default_rng(3).normal(0.05, 0.5, (8, 6))
    network = single(model(np.ones(8)), weights, steps=200)
    compiled = lc.compile(network, events=recordings(network, samples=6, rate=0.5))
    assert compiled.levels.quantized.strategy == "native"
    assert 0.9 < compiled.match.spikes.agreement < 1
    # Only with exact numbers registered can differing spikes be attributed to stages of rounding.
    assert (compiled.report["error_budget"]["unexplained_spikes"] > 0) == unexplained
