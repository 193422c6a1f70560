"""Choose a scale for every population and round: weights, decays and thresholds.

Before: a Network in float64.
After:  a QuantizedNetwork. The threshold is exact, rule included (``u >= theta`` holds where ``v > 64 * threshold``
        does); weights and decays are rounded, and the gain of the alpha kernel makes up for its rounded decay.
"""

from __future__ import annotations

import math

import numpy as np

from hw_model.chip_description import Chip
from hw_model.fixed_point import DECAY_ONE
from hw_model.weights import WEIGHT_EXPONENTS, WeightGrid, weight_grid
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.network import Network, Population
from locsnn_compile.quantized import QuantizedNetwork, QuantizedProjection, QuantizedSrm

HEADROOM = 16
"""The voltage register holds at least this many thresholds: potentials of trained networks go that far."""
SCALE_SLACK = 0.99
"""A scale may be up to one percent below the largest, if the refractory weight rounds better there."""
REFRACTORY_BITS = 8
"""Bits of the self-synapse, one weight a population: nothing would be saved with fewer."""


def quantize(network: Network, chip: Chip, weight_bits: int = 8) -> QuantizedNetwork:
    """Quantise every population by itself; a network that no scale fits is a ``TargetError``."""
    grid = weight_grid(weight_bits, "excitatory")
    populations, projections = [], []
    for population in network.populations:
        decay, gain, error = alpha_kernel(population.neuron.tau_sr, f"population {population.name!r}: tau_sr")
        incoming = network.into(population.name)
        largest = max((float(np.abs(p.weights).max(initial=0.0)) for p in incoming), default=0.0) * gain
        exponent, threshold_max = _scale(population, largest, grid, chip)
        quantized = _quantize_neuron(population, decay, error, threshold_max)
        populations.append(quantized)
        for p in incoming:
            mantissa = np.sign(p.weights).astype(np.int64) * grid.round(
                np.abs(p.weights) * (gain * quantized.scale / (64 * 2**exponent))
            )
            mantissa.setflags(write=False)
            projections.append(
                QuantizedProjection(p.source, p.target, mantissa, exponent, weight_bits, grid.step, grid.high)
            )
    result = QuantizedNetwork(network, tuple(populations), tuple(projections))
    check_quantized(result, chip)
    return result


def check_quantized(quantized: QuantizedNetwork, chip: Chip) -> None:
    """Every number is one that the chip holds; the structure is the network's."""
    names = [q.population.name for q in quantized.populations]
    assert names == [p.name for p in quantized.network.populations]
    for q in quantized.populations:
        assert 1 <= q.threshold <= chip.registers.threshold_mantissa_max
        assert 0 < q.decay <= DECAY_ONE
        assert 0 < q.refractory_decay <= DECAY_ONE
        assert -255 <= q.refractory_mantissa <= 0
    for p in quantized.projections:
        assert (np.abs(p.mantissa) <= p.mantissa_max).all()
        assert (p.mantissa % p.step == 0).all()
        assert p.exponent in WEIGHT_EXPONENTS


def alpha_kernel(tau: float, where: str) -> tuple[int, float, float]:
    """Return the effective decay nearest to exp(-1 / tau), the gain that fits best with it, and the error left.

    The chip answers a spike with ``gain * k * b^(k-1)``, where ``b = (4096 - decay) / 4096``; the kernel is
    ``c * k * a^(k-1)``, where ``a = exp(-1 / tau)`` and ``c = e * a / tau``. The gain is the least-squares one. The
    error is the root of the squared difference over the squared kernel, both summed over all k.
    """
    a = math.exp(-1.0 / tau)
    decay = round(DECAY_ONE * (1.0 - a))
    if decay == 0:
        raise TargetError(
            where,
            "the decay rounds to nothing, so the potential would never fade",
            measured=f"{tau:g} steps against at most {2 * DECAY_ONE - 1}",
            fix="Use a shorter time constant or a longer step.",
        )
    b = (DECAY_ONE - decay) / DECAY_ONE
    c = math.e * a / tau
    own, cross, kernel = _energy(b * b), c * _energy(a * b), c * c * _energy(a * a)
    gain = cross / own
    return decay, gain, math.sqrt(max(0.0, 1.0 - cross * cross / (own * kernel)))


def _energy(r: float) -> float:
    """Return the sum over k = 1, 2, ... of k^2 r^(k-1), which is (1 + r) / (1 - r)^3."""
    return (1.0 + r) / (1.0 - r) ** 3


def _scale(population: Population, largest: float, grid: WeightGrid, chip: Chip) -> tuple[int, int]:
    """Return weight exponent and largest threshold mantissa: all weight bits in use, then most of the register."""
    neuron = population.neuron
    cap = chip.registers.voltage_max // (64 * HEADROOM)
    _, gain, _ = alpha_kernel(neuron.tau_ref, f"population {population.name!r}: tau_ref")
    heaviest = 255 * 2.0 ** WEIGHT_EXPONENTS[-1]
    if neuron.scale_ref > 0:
        cap = min(cap, int(heaviest / (neuron.scale_ref * gain)) - 1)
    fits = [grid.high * 2**e * neuron.theta / largest - 1 / 64 if largest else math.inf for e in range(8)]
    exponent = max((e for e, most in enumerate(fits) if most <= cap), default=0)
    threshold = int(min(fits[exponent], cap))
    if threshold < 1:
        raise TargetError(
            f"population {population.name!r}",
            "no scale holds both the threshold and the largest weight",
            measured=f"one weight reaches {largest / neuron.theta:.3g} thresholds against {heaviest:.0f}",
            fix="Train with smaller weights, or a higher threshold.",
        )
    return exponent, threshold


def _quantize_neuron(population: Population, decay: int, kernel_error: float, threshold_max: int) -> QuantizedSrm:
    """Take the threshold, at or just below the largest, whose refractory weight rounds best."""
    neuron = population.neuron
    refractory_decay, gain, _ = alpha_kernel(neuron.tau_ref, f"population {population.name!r}: tau_ref")
    grid = weight_grid(REFRACTORY_BITS, "inhibitory")

    def rounded(threshold: int) -> tuple[float, int, int]:
        # v > 64 * threshold is v >= 64 * threshold + 1 for integers: this value stands for theta.
        wanted = -neuron.scale_ref * gain * (64 * threshold + 1) / 64
        exponent = max(0, math.ceil(math.log2(-wanted / 255))) if wanted < 0 else 0
        mantissa = int(grid.round(np.array([wanted / 2**exponent]))[0])
        error = abs(mantissa * 2**exponent - wanted) / -wanted if wanted < 0 else 0.0
        return error, mantissa, exponent

    candidates = range(threshold_max, max(1, math.ceil(SCALE_SLACK * threshold_max)) - 1, -1)
    threshold = min(candidates, key=lambda t: rounded(t)[0])
    error, mantissa, exponent = rounded(threshold)
    return QuantizedSrm(
        population=population,
        scale=(64 * threshold + 1) / neuron.theta,
        decay=decay,
        refractory_decay=refractory_decay,
        threshold=threshold,
        refractory_mantissa=mantissa,
        refractory_exponent=exponent,
        kernel_error=kernel_error,
        refractory_error=error,
    )


def check_weight_bits(weight_bits: int) -> None:
    """Refuse a width that no synapse format has."""
    try:
        weight_grid(weight_bits, "excitatory")
    except InputError as error:
        raise InputError("--weight-bits", error.what, fix=error.fix) from None
