"""What is put under stress: one population behind some inputs, and what is played to it."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from hw_model.mapping.graph import Readout
from hw_model.values import ArrayLike, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, Neuron, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection, Signs, matrix
from locsnn_compile.passes.rounding.task import FINE, Rounding
from locsnn_compile.strategies import NATIVE, USUAL

POPULATION, TOUCH = "n", "touch"
NEURONS, CHANNELS, STEPS, SAMPLES, RATE = 4, 6, 200, 2, 0.3
"""Of a case that asks for nothing else; the rate is that of a random input, spikes a step."""
THETA = 10.0
"""Published threshold."""
SEED = 0


class Case(Frozen, eq=False):
    """One row of the table: a network, how it is lowered, and recordings (samples, steps, channels) of 0 and 1.

    It is rounded as `locsnn-compile` rounds, unless ``rounding`` says otherwise. ``x`` is the number that the group of
    cases varies, where it has a place on an axis. ``quick`` cases are part of every run. The table of groups names the
    ``group``.
    """

    name: str
    strategy: str
    network: Network
    recordings: ByteArray
    weight_bits: int = 8
    rounding: Rounding = FINE
    x: float | None = None
    quick: bool = False
    group: str = ""


def srm_cases(
    name: str,
    neuron: SrmAlpha | None = None,
    given: ArrayLike | None = None,
    played: ByteArray | None = None,
    *,
    quick: bool = False,
    quick_as: tuple[str, ...] = ("dendrite",),
    **more: Any,
) -> Iterator[Case]:
    """Yield a network of spike response neurons by every strategy; of ``quick`` ones ``quick_as`` are in every run.

    The published neuron, random weights and random input where nothing else is given; ``more`` as in :func:`case_of`.
    """
    made = case_of(name, USUAL[0], neuron or srm(), weights() if given is None else given, played, **more)
    for strategy in USUAL:
        yield replace(made, strategy=strategy, quick=quick and strategy in quick_as)


def lif_case(
    name: str,
    neuron: Cuba | None = None,
    given: ArrayLike | None = None,
    played: ByteArray | None = None,
    **more: Any,
) -> Case:
    """Return a network of integrate-and-fire neurons, with the usual ones where nothing else is given."""
    return case_of(name, NATIVE, neuron or lif(), weights(response="leak") if given is None else given, played, **more)


def case_of(
    name: str,
    strategy: str,
    neuron: Neuron,
    given: ArrayLike,
    played: ByteArray | None = None,
    *,
    delay: int | IntArray = 0,
    exponent: int = 0,
    signs: Signs = "apart",
    **more: Any,
) -> Case:
    """Return neurons with weights, a random input played to them by default; ``more`` fields of the case."""
    recordings = random_input() if played is None else played
    steps = recordings.shape[1]
    network = network_of(neuron, given, steps=steps, delay=delay, exponent=exponent, signs=signs)
    return Case(name, strategy, network, recordings, **more)


def network_of(
    neuron: Neuron,
    given: ArrayLike,
    *,
    steps: int = STEPS,
    delay: int | IntArray = 0,
    exponent: int = 0,
    signs: Signs = "apart",
) -> Network:
    """Return one population behind inputs, one for each column of its weights.

    Weights of neurons on the chip's grid are mantissas, of an ``exponent`` and with ``signs`` as given.
    """
    if isinstance(neuron, ChipNeuron):
        held = matrix(given, np.int64)
        projection: Projection | ChipProjection = ChipProjection(TOUCH, POPULATION, held, exponent, 8, signs, delay)
    else:
        held = matrix(given, np.float64)
        projection = Projection(TOUCH, POPULATION, held, delay)
    size, channels = held.shape
    return Network(
        name="stress",
        channels=channels,
        steps=steps,
        step_seconds=None,
        views=(InputView(TOUCH, "time", channels),),
        populations=(Population(POPULATION, "time", size, neuron),),
        projections=(projection,),
        readout=Readout((POPULATION,), (1.0,)),
        sha256="0" * 64,
    )


def srm(**changes: float) -> SrmAlpha:
    """Return the published spike response neuron, with changes."""
    return replace(SrmAlpha(theta=THETA, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0), **changes)


def lif(tau: float = 10.0, size: int = NEURONS, **changes: ArrayLike) -> Cuba:
    """Return leaky integrate-and-fire neurons without a current, of a time constant in steps, with changes."""
    return Cuba.of(size, **{"decay_v": -np.expm1(-1.0 / tau), "threshold": THETA, **changes})


def weights(tau: float = 10.0, *, response: str = "alpha", size: int = NEURONS, channels: int = CHANNELS) -> FloatArray:
    """Return random weights (size, channels) under which potentials of any time constant stray about the threshold.

    Let h be the response to a spike. Random input lifts a potential by ``w * channels * rate * sum over k of h(k)`` on
    average, and moves it by ``w * sqrt(channels * rate * sum over k of h(k)^2)`` about there. The sums are about
    ``e tau`` and ``e^2 tau / 4`` of an alpha kernel, ``tau`` and ``tau / 2`` of a leaky integrator.
    """
    lift, energy = (math.e * tau, math.e**2 * tau / 4) if response == "alpha" else (tau, tau / 2)
    drawn = np.random.default_rng(SEED).normal(0.0, 1.0, (size, channels))
    drawn -= drawn.mean(axis=1, keepdims=True)
    found: FloatArray = THETA * (drawn / np.sqrt(1.0 + energy) + 1.0 / (channels * RATE * (1.0 + lift)))
    return found


def random_input(
    steps: int = STEPS, *, channels: int = CHANNELS, rate: float = RATE, samples: int = SAMPLES, seed: int = SEED + 1
) -> ByteArray:
    """Return recordings (samples, steps, channels) in which every channel spikes at random, at a rate a step."""
    drawn = np.random.default_rng(seed).random((samples, steps, channels)) < rate
    return drawn.astype(np.uint8)
