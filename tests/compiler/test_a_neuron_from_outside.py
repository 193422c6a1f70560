"""Neuron models that are not part of the package: from ``Network`` to the float reference, and to the chip or not."""

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
    def __init__(self, neuron, batch, size, registers=None):
        self.neuron = neuron
        self.v, self.a, self.fired = np.zeros((3, batch, size))

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
    """A network of the neurons of this page, with some parameters changed."""
    return single(replace(NEURON, **changes), WEIGHTS, steps=40)


FAULTS = [
    (
        "threshold",
        {"threshold": np.array([1.0, 0.0])},
        "population 'n': threshold must be above 0 (0.0). Correct it.",
    ),
    (
        "fade",
        {"fade": np.full(2, 1.5)},
        "population 'n': fade must be a fraction from 0 to 1 (1.5). Correct it.",
    ),
    (
        "shape",
        {"step": np.full(3, 0.5)},
        "population 'n': step has the wrong shape ((3,) against (2,)). Give one number per neuron.",
    ),
    (
        "size",
        {"threshold": np.full(2, 1e-200)},
        "population 'n': threshold is too small a number to compute with (1e-200 against 1e-100 to 1e+100). "
        "Give it in other units.",
    ),
]


@pytest.mark.parametrize(
    ("changes", "message"), [row[1:] for row in FAULTS], ids=[row[0] for row in FAULTS]
)
def test_its_parameters_are_checked(changes, message):
    check_network(adaptive())
    with pytest.raises(InputError) as caught:
        check_network(adaptive(**changes))
    assert str(caught.value) == message


def test_it_is_printed():
    assert network_text(adaptive()).splitlines()[2] == (
        "  population n: 2 Adaptive neurons along time, decay 0.1, threshold 1.0 1.5, step 0.5, fade 0.25"
    )


def by_hand(network, played):
    """Return spikes and potentials, neuron by neuron and step by step, as the equations say."""
    n = network.populations[0].neuron
    spikes = np.zeros((len(played), network.steps, 2), dtype=np.uint8)
    potential = np.zeros(spikes.shape)
    for s, events in enumerate(played):
        for i in range(2):
            v = a = fired = 0.0
            for t in range(network.steps):
                a = (1 - n.fade[i]) * a + n.step[i] * fired
                v = (1 - n.decay[i]) * v + (events[t - 1] @ WEIGHTS[i] if t else 0.0)
                potential[s, t, i], fired = v, float(v > n.threshold[i] + a)
                spikes[s, t, i] = fired
                v = 0.0 if fired else v
    return spikes, potential


def test_the_reference_does_what_the_equations_say():
    network = adaptive()
    played = recordings(network, samples=4, rate=0.6)
    found, (spikes, potential) = (
        evaluate(network, played, potentials=True),
        by_hand(network, played),
    )
    assert np.array_equal(found.spikes["n"], spikes)
    np.testing.assert_allclose(found.potential["n"], potential, atol=1e-12)
    without = evaluate(adaptive(step=np.zeros(2)), played).spikes["n"]
    assert 0 < spikes.sum() < without.sum()


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
    """A model of which only the steps are."""


@dataclass(frozen=True, eq=False)
class Integrator(Neuron):
    """Integrate-and-fire neurons: v(t) = v(t - 1) + weights that arrive; a spike where v > threshold, then v = 0."""

    threshold: FloatArray

    musts: ClassVar[Musts] = {"threshold": POSITIVE}

    @property
    def spikes_at(self):
        return self.threshold


class Explained(Integrator):
    """The same, of which the exact numbers of the error budget are known."""


def as_cuba(neuron, size):
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
    (
        Unknown(),
        InputError,
        "neuron Unknown: nothing says how it steps. Register its state with locsnn_compile.reference.evaluate.steps_of.",
    ),
    (
        Stepping(),
        TargetError,
        "population 'n': loihi-sim does not have Stepping neurons. Use neurons that the chip has: SrmAlpha, Cuba or SoftCuba.",
    ),
]


@pytest.mark.parametrize(
    ("neuron", "error", "message"), UNREGISTERED, ids=["no steps", "no integers"]
)
def test_what_is_not_registered_is_named(neuron, error, message):
    network = single(neuron, WEIGHTS)
    with pytest.raises(error) as caught:
        lc.compile(network, events=recordings(network))
    assert str(caught.value) == message


@pytest.mark.parametrize(("model", "unexplained"), [(Integrator, True), (Explained, False)])
def test_a_chip_plays_a_model_that_says_its_integers(model, unexplained):
    drawn = np.random.default_rng(3).normal(0.05, 0.5, (8, 6))
    network = single(model(np.ones(8)), drawn, steps=200)
    compiled = lc.compile(network, events=recordings(network, samples=6, rate=0.5))
    assert compiled.levels.quantized.strategy == "native"
    assert 0.9 < compiled.match.spikes.agreement < 1
    # Spikes that differ are put down to stages only where exact numbers are registered.
    assert (compiled.report["error_budget"]["unexplained_spikes"] > 0) == unexplained
