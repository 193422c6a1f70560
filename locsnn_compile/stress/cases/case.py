"""What is put under stress: one population of neurons behind inputs, and the recordings that are played to it.

A case is a network that is lowered and compared with its float self (``stress/measure.py``). The modules next to this
one make groups of cases from the functions here, and :func:`long_runs` yields those of up to a million steps.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hw_model.arithmetic import loihi_inverse
from hw_model.mapping.graph import Readout
from hw_model.texts.templates import yaml_table
from hw_model.values import ArrayLike, ByteArray, FloatArray, Frozen, IntArray
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, Neuron, SrmAlpha
from locsnn_compile.network.projections import ChipProjection, Projection, Signs, matrix
from locsnn_compile.passes.rounding.task import FINE, Rounding
from locsnn_compile.settings import NATIVE, USUAL

POPULATION = "n"
"""The name of the one population of a case."""
TOUCH = "touch"
"""The name of its input."""
# The sizes of a case are chosen by hand: small enough for hundreds of cases in minutes.
NEURONS = 4
CHANNELS = 6
STEPS = 200
SAMPLES = 2
RATE = 0.3
"""Spikes per channel and step of random input."""
THETA = 10.0
"""The published threshold: Kang et al., IJCNN 2022."""
SEED = 0
"""The seed of random weights; random input has the next one."""
QUICK: Mapping[str, Mapping[str, Sequence[str]]] = yaml_table(__package__, "quick.yaml")
"""Names of the cases of a quick run, by group and strategy."""


class Case(Frozen, eq=False):
    """A network, how it is lowered, and recordings (samples, steps, channels) of 0 and 1.

    - ``strategy``: how spike response neurons become compartments; ``native`` for neurons that the chip has
    - ``weight_bits``: None for the chip's widest weights
    - ``rounding``: by default that of ``locsnn-compile``
    - ``x``: the number that the group varies, if it is drawn on an axis
    - ``group``: set by the table of groups
    """

    name: str
    strategy: str
    network: Network
    recordings: ByteArray
    weight_bits: int | None = None
    rounding: Rounding = FINE
    x: float | None = None
    group: str = ""

    @property
    def quick(self) -> bool:
        """Whether it is part of a run with ``--quick``."""
        return self.name in QUICK.get(self.group, {}).get(self.strategy, ())


def srm_cases(
    name: str, neuron: SrmAlpha | None = None, weights: ArrayLike | None = None, **options: Any
) -> Iterator[Case]:
    """Yield a case of spike response neurons for every strategy but those of last resort.

    Defaults are the published neuron, random weights and random input; ``options`` as in :func:`case_of`.
    """
    if weights is None:
        weights = random_weights()
    case = case_of(name, USUAL[0], neuron or srm(), weights, **options)
    for strategy in USUAL:
        yield replace(case, strategy=strategy)


def lif_case(
    name: str, neuron: Cuba | None = None, weights: ArrayLike | None = None, **options: Any
) -> Case:
    """Return a case of integrate-and-fire neurons, by default with random weights and random input.

    They are ``NATIVE``: the chip has such neurons, so no strategy has to lay them out.
    """
    if weights is None:
        weights = random_weights(response="leak")
    return case_of(name, NATIVE, neuron or lif(), weights, **options)


def case_of(
    name: str,
    strategy: str,
    neuron: Neuron,
    weights: ArrayLike,
    recordings: ByteArray | None = None,
    **options: Any,
) -> Case:
    """Return a case of neurons with weights (neurons, channels), by default with random input.

    ``options`` are further fields of the case, and ``delay``, ``exponent`` and ``signs`` of :func:`network_of`.
    """
    if recordings is None:
        recordings = random_input()
    network_options = {
        key: options.pop(key) for key in ("delay", "exponent", "signs") if key in options
    }
    network = network_of(neuron, weights, steps=recordings.shape[1], **network_options)
    return Case(name, strategy, network, recordings, **options)


def network_of(
    neuron: Neuron,
    weights: ArrayLike,
    *,
    steps: int = STEPS,
    delay: int | IntArray = 0,
    exponent: int = 0,
    signs: Signs = "apart",
) -> Network:
    """Return a network of one population behind inputs, one for each column of its weights.

    For neurons on the chip's grid, weights are mantissas with this ``exponent`` and these ``signs``: ``apart`` if
    positive and negative weights have formats of their own, ``mixed`` if one format has a sign bit.
    """
    projection: Projection | ChipProjection
    if isinstance(neuron, ChipNeuron):
        mantissas = matrix(weights, np.int64)
        projection = ChipProjection(
            TOUCH, POPULATION, mantissas, exponent, weight_bits=8, signs=signs, delay=delay
        )
    else:
        projection = Projection(TOUCH, POPULATION, matrix(weights, np.float64), delay)
    size, channels = projection.held.shape
    return Network(
        name="stress",
        channels=channels,
        steps=steps,
        views=(InputView(TOUCH, "time", channels),),
        populations=(Population(POPULATION, "time", size, neuron),),
        projections=(projection,),
        readout=Readout((POPULATION,), (1.0,)),
    )


def srm(**changes: float) -> SrmAlpha:
    """Return the published spike response neuron with some parameters changed."""
    return replace(SrmAlpha(theta=THETA, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0), **changes)


def lif(tau: float = 10.0, size: int = NEURONS, **changes: ArrayLike) -> Cuba:
    """Return leaky integrate-and-fire neurons without a current, with a time constant in steps and other changes."""
    lost_per_step = -np.expm1(-1.0 / tau)  # 1 - exp(-1 / tau), exact for a long tau as well
    return Cuba.of(size, **{"decay_v": lost_per_step, "threshold": THETA, **changes})


def random_weights(
    tau: float = 10.0, *, response: str = "alpha", size: int = NEURONS
) -> FloatArray:
    """Return random weights (size, CHANNELS) with which potentials of any time constant vary around the threshold.

    Let h be the response to a spike. Random input raises a potential by ``w * channels * rate * sum over k of h(k)`` on
    average, with a deviation of ``w * sqrt(channels * rate * sum over k of h(k)^2)``. The sums are about ``e tau`` and
    ``e^2 tau / 4`` for an alpha kernel, and ``tau`` and ``tau / 2`` for a leaky integrator.

    So the mean weight lifts the potential to the threshold on average, and weights differ from it by about one over
    the square root of the second sum. The ones that are added keep both finite for a time constant near 0.
    """
    if response == "alpha":
        sum_of_response = math.e * tau
        sum_of_squares = math.e**2 * tau / 4
    else:
        sum_of_response = tau
        sum_of_squares = tau / 2
    deviation = np.random.default_rng(SEED).normal(0.0, 1.0, (size, CHANNELS))
    deviation -= deviation.mean(axis=1, keepdims=True)  # so that they do not move the mean weight
    mean = 1.0 / (CHANNELS * RATE * (1.0 + sum_of_response))
    weights: FloatArray = THETA * (deviation / np.sqrt(1.0 + sum_of_squares) + mean)
    return weights


def random_input(
    steps: int = STEPS, *, channels: int = CHANNELS, samples: int = SAMPLES, seed: int = SEED + 1
) -> ByteArray:
    """Return recordings (samples, steps, channels) in which every channel spikes at random with ``RATE`` per step."""
    drawn = np.random.default_rng(seed).random((samples, steps, channels)) < RATE
    return drawn.astype(np.uint8)


GROUP = "a million steps"
"""The group of the long runs."""
BLOCK = 1000
"""Steps after which the input repeats, and with it a neuron whose state fades."""
SETTLED = 5
"""Time constants after which a neuron has practically forgotten its start: exp(-5) is 0.7 %."""


class LongRun(Frozen, eq=False):
    """A run of up to a million steps, in which the input ``block``, (steps, channels), repeats.

    ``case`` plays its first blocks, until errors that fade have settled. ``fades`` is False if some error never fades,
    because the neuron has no leak.
    """

    case: Case
    block: ByteArray
    fades: bool = True


def long_runs() -> Iterator[LongRun]:
    """Does rounding add up? If potentials fade, it cannot: errors in the last tenth are those in the first, below a
    bound for all time. Without a leak it does, as fast as derived. Potentials are compared in neurons that do not
    spike; the figures above the long runs are those of their beginnings.
    """
    # Two neurons of each network stay below the threshold, so potentials can be compared to the end.
    block = random_input(BLOCK, samples=1)[0]
    for strategy in USUAL:
        yield _run("tau_sr 10", strategy, srm(), _mostly_quiet(random_weights()), block)
    weights = _mostly_quiet(random_weights(response="leak"))
    yield _run("leak of 10 steps", NATIVE, lif(10.0), weights, block)
    slowest = loihi_inverse.share_lost(1)
    time_constant = 1 / slowest
    weights = _mostly_quiet(random_weights(time_constant, response="leak"))
    # The chip has this decay exactly, so only truncation and weights differ.
    yield _run(
        "leak of 1 in 4096",
        NATIVE,
        lif(decay_v=slowest),
        weights,
        block,
        blocks=int(SETTLED * time_constant) // BLOCK,
    )
    balanced_weights, balanced_block = _balanced()
    integrator = lif(decay_v=0.0)
    yield _run(
        "no leak, balanced input", NATIVE, integrator, balanced_weights, balanced_block, fades=False
    )
    ticking = lif(decay_v=0.0, bias=THETA * np.array([0.3, 0.03, 0.003, 0.0003]))
    no_weights = np.zeros_like(weights)
    yield _run("no leak, bias alone", NATIVE, ticking, no_weights, block, fades=False)


def _mostly_quiet(weights: FloatArray) -> FloatArray:
    """Return weights with which two neurons stay below the threshold: a tenth of theirs."""
    quiet_weights = weights.copy()
    quiet_weights[:2] *= 0.1
    return quiet_weights


def _balanced() -> tuple[FloatArray, ByteArray]:
    """Return weights and input that add up to 0 in float, and almost to 0 with rounded weights.

    61 spikes up, and 77 down with 61/77 of the weight. If the first weight is the largest mantissa, 255, the second
    is 255 * 61 / 77 = 202.013, so rounding it to 202 leaves a little of every spike.
    """
    spikes_up = 61
    spikes_down = 77
    # A few more spikes up than down stay far below the threshold.
    weight_up = THETA / 32
    weight_down = -THETA / 32 * spikes_up / spikes_down
    weights = np.tile([weight_up, weight_down], (NEURONS, 1))
    pattern_steps = 200
    pattern = np.zeros((pattern_steps, 2), dtype=np.uint8)
    rng = np.random.default_rng(SEED)
    pattern[rng.permutation(pattern_steps)[:spikes_up], 0] = 1
    pattern[rng.permutation(pattern_steps)[:spikes_down], 1] = 1
    return weights, np.tile(pattern, (BLOCK // pattern_steps, 1))


def _run(  # noqa: PLR0913 - what earlier steps made, each used once
    name: str,
    strategy: str,
    neuron: Neuron,
    weights: FloatArray,
    block: ByteArray,
    *,
    blocks: int = 2,
    fades: bool = True,
) -> LongRun:
    """Return a long run whose case plays the first ``blocks`` blocks."""
    recordings = np.tile(block, (blocks, 1))[None]
    case = case_of(name, strategy, neuron, weights, recordings, group=GROUP)
    return LongRun(case, block, fades)
