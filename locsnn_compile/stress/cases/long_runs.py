"""Runs of a million steps: whether errors add up."""

from collections.abc import Iterator

import numpy as np

from hw_model.values import ByteArray, FloatArray, Frozen
from locsnn_compile.network.neurons import Cuba, SrmAlpha
from locsnn_compile.strategies import NATIVE, USUAL
from locsnn_compile.stress.cases.case import NEURONS, SEED, THETA, Case, case_of, lif, random_input, srm, weights

GROUP = "a million steps"
BLOCK = 1000
"""Steps after which the input repeats: what a fading neuron does then repeats as well."""
SETTLED = 5
"""Time constants after which a neuron has all but forgotten how it began."""


class LongRun(Frozen, eq=False):
    """``case`` plays the first blocks, until errors that fade have settled; then ``block`` goes on and on.

    ``block`` is (steps, channels). ``fades`` is False where some error never does.
    """

    case: Case
    block: ByteArray
    fades: bool = True


def long_runs() -> Iterator[LongRun]:
    """Does rounding add up? Where potentials fade it cannot: errors of the last tenth are those of the first, below a
    bound for all time. Without a leak it does, as fast as derived. Potentials are compared in neurons that do not
    spike; the figures above the long runs are of their beginnings.
    """
    # Two neurons of each network stay below the threshold, so that potentials can be compared for ever.
    block = random_input(BLOCK, samples=1)[0]
    for strategy in USUAL:
        yield _run("tau_sr 10", strategy, srm(), _mostly_quiet(weights()), block, 2, quick=strategy == "dendrite")
    given = _mostly_quiet(weights(response="leak"))
    yield _run("leak of 10 steps", NATIVE, lif(10.0), given, block, 2, quick=True)
    given = _mostly_quiet(weights(4096.0, response="leak"))
    # A decay that the chip has: nothing but truncation and weights is left.
    yield _run("leak of 1 in 4096", NATIVE, lif(decay_v=1 / 4096), given, block, SETTLED * 4096 // BLOCK)
    yield _run("no leak, balanced input", NATIVE, lif(decay_v=0.0), *_balanced(), 2, fades=False)
    ticking = lif(decay_v=0.0, bias=THETA * np.array([0.3, 0.03, 0.003, 0.0003]))
    yield _run("no leak, bias alone", NATIVE, ticking, np.zeros_like(given), block, 2, fades=False)


def _mostly_quiet(given: FloatArray) -> FloatArray:
    """Return weights under which two neurons stay below the threshold."""
    quiet = given.copy()
    quiet[:2] *= 0.1
    return quiet


def _balanced() -> tuple[FloatArray, ByteArray]:
    """Return weights and input that add up to nothing in float, and to nearly nothing in rounded weights.

    61 spikes up and 77 down, of 61/77 the weight: in mantissas 255 and 202.013.
    """
    up, down = 61, 77
    given = np.tile([THETA / 32, -THETA / 32 * up / down], (NEURONS, 1))
    pattern = np.zeros((200, 2), dtype=np.uint8)
    drawn = np.random.default_rng(SEED)
    pattern[drawn.permutation(200)[:up], 0] = 1
    pattern[drawn.permutation(200)[:down], 1] = 1
    return given, np.tile(pattern, (BLOCK // 200, 1))


def _run(
    name: str,
    strategy: str,
    neuron: Cuba | SrmAlpha,
    given: FloatArray,
    block: ByteArray,
    blocks: int,
    *,
    fades: bool = True,
    quick: bool = False,
) -> LongRun:
    played = np.tile(block, (blocks, 1))[None]
    return LongRun(case_of(name, strategy, neuron, given, played, quick=quick, group=GROUP), block, fades)
