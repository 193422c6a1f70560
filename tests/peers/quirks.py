"""Where the peers differ from the chip: the one place that says how inputs are translated and what is left out, and why.

Each difference is a *quirk*. Its *witness* is a network on which the peer, given the very same inputs, differs from our
engine because of the quirk. A quirk without a witness is a translation, or a parameter that the peer does not have at all
and that its driver refuses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from peer_networks import Network, Population, Projection
from random_networks import VOLTAGE_MAX, Abilities


@dataclass(frozen=True, eq=False)
class Quirk:
    """One way in which a peer differs, and what is done about it."""

    topic: str
    peer: str
    """What the peer does."""
    handling: Literal["translated", "left out", "in part"]
    ours: str
    """What the test does instead."""
    witness: Network | None = None


@dataclass(frozen=True, eq=False)
class Peer:
    """A simulator, what it can do, and how many random networks it is given."""

    name: str
    driver: str
    networks: int
    can: Abilities
    quirks: tuple[Quirk, ...]

    @property
    def seeds(self) -> range:
        """Seeds of its random networks."""
        return range(self.networks)


def witness(
    name: str,
    weight: int,
    *,
    sources: int = 1,
    steps: int = 5,
    exponent: int = 0,
    sign_mode: str = "mixed",
    decay_u: int = 4096,
    threshold: int = 131071,
) -> Network:
    """Return one compartment that does not leak voltage, driven through equal weights by lines that spike each step."""

    def one(value: int) -> np.ndarray:
        return np.array([value], dtype=np.int64)

    cell = Population(
        "h",
        1,
        one(decay_u),
        one(0),
        one(threshold),
        bias=one(0),
        refractory=one(1),
        vmin=-VOLTAGE_MAX,
        vmax=VOLTAGE_MAX,
    )
    shape = (1, sources)
    weights = np.full(shape, weight, dtype=np.int64)
    drive = Projection("x", "h", weights, np.zeros(shape, dtype=np.int64), exponent, 8, sign_mode)
    return Network(name, np.ones((steps, sources), dtype=np.uint8), (cell,), (drive,))


NENGO_LOIHI = Peer(
    name="nengo-loihi",
    driver="drive_nengo_loihi.py",
    networks=200,
    can=Abilities(delay="none", floors_negative_exponents=False, lowest_mantissa=range(0)),
    quirks=(
        Quirk(
            "u decay",
            "takes the register, one less than the effective decay",
            "translated",
            "effective decay less one; effective 0 becomes -1, which no register holds but the emulator computes with",
        ),
        Quirk(
            "first step",
            "counts steps from 1; the input of a step arrives in the next",
            "translated",
            "row t is given as step t + 1",
        ),
        Quirk("delay", "has none", "left out", "no delays"),
        Quirk(
            "negative exponent",
            "rounds each weight half to even where the chip model floors",
            "in part",
            "mantissas that lose no bits",
            witness("nengo negative exponent", 3, exponent=-1, sign_mode="excitatory"),
        ),
        Quirk(
            "lowest mixed weight",
            "clips to -254 (8 bits), one grid step above the chip's -256",
            "in part",
            "mantissas from one step above -256; with 1 bit none is left",
            witness("nengo lowest mixed weight", -256),
        ),
    ),
)

BRIAN2_LOIHI = Peer(
    name="brian2-loihi",
    driver="drive_brian2_loihi.py",
    networks=80,
    can=Abilities(
        overflow=False,
        per_compartment=False,
        bias=False,
        limits=False,
        lowest_mantissa=range(-8, 7),
    ),
    quirks=(
        Quirk("first input", "acts in its own row", "translated", "row t is given as row t + 1"),
        Quirk("delay", "one per synapse group", "translated", "one group for each delay"),
        Quirk("parameters", "one value per neuron group", "in part", "one value per population"),
        Quirk("bias", "has none", "left out", "bias 0"),
        Quirk("voltage limits", "has none", "left out", "the chip's widest"),
        Quirk(
            "overflow",
            "neither wraps nor clips",
            "left out",
            "networks without an event; others are drawn again",
            witness("brian2 overflow", 254, sources=2, exponent=7),
        ),
        Quirk(
            "lowest mixed weight",
            "at exponent 7 clips -2^21, the weight of -256, to -(2^21 - 64)",
            "in part",
            "-256 at the exponents below 7",
            witness("brian2 lowest weight at exponent 7", -256, steps=3, exponent=7),
        ),
        Quirk(
            "weights off the grid",
            "rounds them toward zero",
            "left out",
            "weights on the grid: ours refuses others",
        ),
        Quirk("refractory", "allows 64", "left out", "1..63, the chip's"),
    ),
)

LAVA_DL = Peer(
    name="lava-dl",
    driver="drive_lava_dl.py",
    networks=100,
    can=Abilities(
        overflow=False,
        per_compartment=False,
        bias=False,
        limits=False,
        refractory=False,
        feedback=False,
        delay="axon",
        threshold_max=4095,
        exponents=range(1),
        odd_mantissas=False,
        lowest_mantissa=range(1),
    ),
    quirks=(
        Quirk("first input", "acts in its own row", "translated", "row t is given as row t + 1"),
        Quirk(
            "units",
            "weights and thresholds in 64ths, decays in 4096ths",
            "translated",
            "divided on the way in",
        ),
        Quirk(
            "v of a spike",
            "shown before the reset",
            "translated",
            "set to 0, the chip's value after the step",
        ),
        Quirk(
            "threshold",
            "a spike from v = threshold on where the mantissa is 4096 or more, by rounding to float32",
            "in part",
            "thresholds to 4095",
            witness("lava threshold", 128, steps=40, threshold=4096),
        ),
        Quirk(
            "overflow",
            "neither wraps nor clips",
            "left out",
            "networks without an event; others are drawn again",
            witness("lava overflow", 254, sources=40, steps=40, decay_u=0),
        ),
        Quirk("parameters", "one value per neuron layer", "in part", "one value per population"),
        Quirk(
            "delay",
            "one per axon, and none in a layer's recurrence",
            "in part",
            "one per source, forward only",
        ),
        Quirk("recurrence", "within a layer", "in part", "no projection to an earlier population"),
        Quirk(
            "odd weights",
            "has the mixed 8-bit grid only: rounds to even numbers, half to even steps",
            "in part",
            "even mantissas, in every sign mode",
            witness("lava odd weights", 23, sign_mode="excitatory"),
        ),
        Quirk("weight exponent", "has none", "left out", "exponent 0"),
        Quirk("negative exponent", "has none", "left out", "exponent 0"),
        Quirk("refractory", "has none", "left out", "1"),
        Quirk("bias", "has none", "left out", "bias 0"),
        Quirk("voltage limits", "has none", "left out", "the chip's widest"),
    ),
)

PEERS: Sequence[Peer] = (NENGO_LOIHI, BRIAN2_LOIHI, LAVA_DL)
