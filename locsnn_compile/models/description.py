"""What a trained network is, in plain values: its input, its neurons and its structure.

Nothing here imports torch, so that the compiler can read descriptions without it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from locsnn_compile.errors import InputError, did_you_mean

#: The structures of networks.md: which step axes a network of that name has, in population order.
BRANCHES: dict[str, tuple[str, ...]] = {
    "tactile-snn": ("time",),
    "location-tactile-snn": ("location",),
    "hybrid": ("time", "location"),
}

#: Largest sizes accepted anywhere: a few times what any published tactile recording needs.
MAX_STEPS = 20_000
MAX_CHANNELS = 4_096
MAX_UNITS = 4_096


@dataclass(frozen=True)
class InputLayout:
    """The shape of one recording.

    ``channels = fingertips * taxels * polarities``, numbered taxel-major: channel = polarities * taxel
    + polarity, taxels counted from 0 through all fingertips. ``steps`` time steps of ``step_seconds``.
    """

    fingertips: int
    steps: int
    step_seconds: float
    taxels: int = 39
    polarities: int = 2

    def __post_init__(self) -> None:
        for name in ("fingertips", "taxels", "polarities", "steps"):
            _require_count(f"input {name!r}", getattr(self, name), MAX_STEPS)
        _require_positive("input 'step_seconds'", self.step_seconds)
        _require_count("input channels", self.channels, MAX_CHANNELS)

    @property
    def channels(self) -> int:
        """Number of input channels of a recording."""
        return self.fingertips * self.taxels * self.polarities


@dataclass(frozen=True)
class NeuronParameters:
    """The constants of one spike response neuron; time constants in steps of its own axis.

    eps(k) = (k / tau_sr) exp(1 - k / tau_sr);
    nu(k) = -scale_ref * theta * (k / tau_ref) exp(1 - k / tau_ref); a spike where u >= theta.
    ``tau_rho`` and ``scale_rho`` shape the surrogate gradient only. Defaults: Kang et al. 2022.
    """

    theta: float = 10.0
    tau_sr: float = 10.0
    tau_ref: float = 1.0
    scale_ref: float = 2.0
    tau_rho: float = 1.0
    scale_rho: float = 1.0

    def __post_init__(self) -> None:
        for name in ("theta", "tau_sr", "tau_ref", "tau_rho", "scale_rho"):
            _require_positive(f"neuron {name!r}", getattr(self, name))
        if not (_is_number(self.scale_ref) and math.isfinite(self.scale_ref) and self.scale_ref >= 0):
            raise InputError(
                "neuron 'scale_ref'",
                "it must be a finite number of at least 0",
                measured=f"got {self.scale_ref!r}",
                fix="The published value is 2.",
            )


@dataclass(frozen=True)
class NetworkDescription:
    """A network without its weights.

    ``location_order`` names the walk and ``location_taxels`` is it, 1-based taxel numbers of one fingertip;
    both are None for a network without a location branch. Weights are [out, in] in ``weight_shapes``.
    """

    architecture: str
    input: InputLayout
    classes: int
    hidden: int = 32
    neuron: NeuronParameters = field(default_factory=NeuronParameters)
    location_order: str | None = None
    location_taxels: tuple[int, ...] | None = None
    name: str = "model"

    def __post_init__(self) -> None:
        if self.architecture not in BRANCHES:
            raise InputError(
                "architecture",
                f"{self.architecture!r} is not known",
                fix=did_you_mean(str(self.architecture), BRANCHES),
            )
        _require_count("classes", self.classes, MAX_UNITS)
        _require_count("hidden", self.hidden, MAX_UNITS)
        if "location" not in self.branches:
            if self.location_taxels is not None or self.location_order is not None:
                raise InputError(
                    f"architecture {self.architecture!r}",
                    "it has no location branch, so it takes no location order",
                    fix="Leave the order out.",
                )
        elif self.location_taxels is None or self.location_order is None:
            raise InputError(
                f"architecture {self.architecture!r}",
                "its location branch needs a location order",
                fix="Give one of: arch, loop, whorl, or a list of taxel numbers.",
            )
        else:
            check_location_taxels(self.location_taxels, self.input.taxels)

    @property
    def branches(self) -> tuple[str, ...]:
        """The step axes of the network: ``time``, ``location`` or both."""
        return BRANCHES[self.architecture]

    @property
    def weight_shapes(self) -> dict[str, tuple[int, int]]:
        """Population name -> (out, in) of the weights into it, in evaluation order."""
        shapes: dict[str, tuple[int, int]] = {}
        for branch in self.branches:
            sources = self.input.channels if branch == "time" else self.input.steps
            shapes[f"{branch}_hidden"] = (self.hidden, sources)
            shapes[f"{branch}_output"] = (self.classes, self.hidden)
        return shapes


def check_location_taxels(taxels: Sequence[int], count: int) -> None:
    """Refuse an order that is no permutation of the taxels 1..``count`` of a fingertip.

    Raises ``InputError`` that names the first number out of range, repeated or missing.
    """
    fix = f"Give every taxel from 1 to {count} exactly once."
    seen: set[int] = set()
    for position, taxel in enumerate(taxels, start=1):
        if isinstance(taxel, bool) or not isinstance(taxel, int) or not 1 <= taxel <= count:
            raise InputError(
                "location order",
                f"entry {position} is not a taxel of the fingertip",
                measured=f"got {taxel!r} against 1..{count}",
                fix=fix,
            )
        if taxel in seen:
            raise InputError("location order", f"taxel {taxel} is repeated at entry {position}", fix=fix)
        seen.add(taxel)
    if missing := [taxel for taxel in range(1, count + 1) if taxel not in seen]:
        raise InputError(
            "location order",
            f"taxel {missing[0]} is missing",
            measured=f"{len(seen)} of {count} taxels given",
            fix=fix,
        )


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _require_positive(where: str, value: float) -> None:
    if not (_is_number(value) and math.isfinite(value) and value > 0):
        raise InputError(
            where,
            "it must be a finite number above 0",
            measured=f"got {value!r}",
            fix="Correct the description.",
        )


def _require_count(where: str, value: int, limit: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= limit:
        raise InputError(
            where,
            "it must be a whole number in range",
            measured=f"got {value!r} against 1..{limit}",
            fix="Correct the description.",
        )
