"""What is asked of the compiler, as one frozen value: Python, the command line and explore all make one.

CompileRequest = a network, a chip, SettingRequest, CheckRequest, PricingRequest
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Generic, TypeVar

import hw_model as hw
from hw_model.targets.families import AnyChip
from hw_model.values import ArrayLike, Frozen
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError
from locsnn_compile.network.network import Network
from locsnn_compile.settings import AUTO, SPIKE_WORTH, Setting, Value
from locsnn_compile.verification.error_bounds import ErrorBudget
from locsnn_compile.verification.matching import Progress

Events = str | Path | Recordings | ArrayLike
"""Recordings: a file, an archive, a folder, or an array (samples, steps, channels)."""
TargetT = TypeVar("TargetT", bound=AnyChip, covariant=True)
NO_BOUNDS = ErrorBudget()


class SettingRequest(Frozen, eq=False):
    """Which setting to compile with, or which ones to choose from.

    - ``setting``: as asked for; with the strategy ``auto`` or a ``budget``, it is the first of
      several that are compared
    - ``given``: the names of the dials whose values are the user's, and not usual ones
    - ``budget``: the bounds that the chosen setting keeps
    - ``calibration``: recordings for which weights are rounded and settings chosen; None stands for
      those in the model, or else synthetic ones, or else those of the check
    - ``spike_worth``: without a budget, how many percent a setting has to save to lose another
      percent of the spikes
    """

    setting: Setting
    given: frozenset[str] = frozenset()
    budget: ErrorBudget = NO_BOUNDS
    calibration: Events | None = None
    spike_worth: float = SPIKE_WORTH

    @classmethod
    def of(
        cls,
        setting: Setting,
        values: Mapping[str, Value | None],
        budget: ErrorBudget | None = None,
        calibration: Events | None = None,
    ) -> "SettingRequest":
        """Return a request for the setting that values by dial, None for usual ones, stand for."""
        given = frozenset(name for name, value in values.items() if value is not None)
        return cls(setting, given, budget or NO_BOUNDS, calibration)

    @property
    def chooses(self) -> bool:
        """Whether a setting is chosen, or else used as it is."""
        return self.setting.strategy == AUTO or self.budget.given


class CheckRequest(Frozen, eq=False):
    """How the program is checked against the trained network.

    - ``events``: what both sides play; None stands for the recordings in the model, or else
      synthetic ones
    - ``labels``: (samples,), of events that are an array
    - ``psi``: of the time-weighted prediction; None for the model's own
    - ``diagnosis``: also break the error down, follow predictions over time, and keep an excerpt
    - ``scheduler``: the address of a Dask cluster that plays the recordings; None to play them here
    - ``progress``: is called with how many recordings are done, and of how many
    - ``events_per_step``: bounds on time are also stated for recordings with at most so many
      events in a step; None for those at the rate of ``events`` alone
    """

    events: Events | None = None
    labels: ArrayLike | None = None
    psi: float | None = None
    diagnosis: bool = True
    scheduler: str | None = None
    progress: Progress | None = None
    events_per_step: int | None = None


class PricingRequest(Frozen):
    """What operations cost: a profile of the chip or a YAML file; None for the chip's first."""

    profile: str | Path | None = None

    def priced(self, chip: hw.Chip) -> hw.Chip:
        """Return a chip with these costs; ``InputError`` for a profile that does not exist."""
        return chip if self.profile is None else hw.priced_by(chip, self.profile)


class CompileRequest(Generic[TargetT], Frozen, eq=False):
    """All that is asked of the compiler: what to compile, for which chip, and how."""

    network: Network
    chip: TargetT
    setting: SettingRequest
    check: CheckRequest
    pricing: PricingRequest = PricingRequest()


def check_only_setting(request: CompileRequest[AnyChip], unpriced: str) -> None:
    """Refuse what a request cannot ask of a chip that has one setting and no table of energies.

    ``unpriced``: why there is none.
    """
    name = request.chip.name
    if request.setting.budget.given:
        what = f"there is one setting for {name}, and a budget chooses among several"
        fix = "Leave it out, and look at the match of the report."
        raise InputError("budget", what, fix=fix)
    if request.pricing.profile is not None:
        where = f"profile {str(request.pricing.profile)!r}"
        raise InputError(where, unpriced, fix="Leave it out.")
    if request.check.scheduler is not None:
        what = f"recordings are played to {name} in this process"
        raise InputError("scheduler", what, fix="Leave it out.")
    if request.check.events_per_step is not None:
        what = f"the time of a recording on {name} is not bounded"
        raise InputError("events_per_step", what, fix="Leave it out.")
