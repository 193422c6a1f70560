"""What is asked of the compiler, as one frozen value: Python, the command line and explore all make one.

CompileRequest = a network, a chip, SettingRequest, CheckRequest, PricingRequest

A setting is one value for each dial of the compiler: strategy, weight bits, split weights
(``settings.py``). ``locsnn_compile.api.fulfil`` takes a request and returns the compiled network.
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

    - ``setting``: the setting asked for; with the strategy ``auto`` or a ``budget``, several that
      begin with it are compared
    - ``given``: the names of the dials whose values the user gave; the others have usual values,
      which the compiler may change
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
        """Return a request for a setting that was made of ``values``.

        ``values`` are by dial; a dial is given if its value is not None.
        """
        given = frozenset(name for name, value in values.items() if value is not None)
        return cls(setting, given, budget or NO_BOUNDS, calibration)

    @property
    def chooses(self) -> bool:
        """Whether the compiler chooses among several settings; otherwise ``setting`` is used as it is."""
        return self.setting.strategy == AUTO or self.budget.given


class CheckRequest(Frozen, eq=False):
    """How the program is checked against the trained network.

    - ``events``: what both sides play; None stands for the recordings in the model, or else
      synthetic ones
    - ``labels``: the class of each recording, (samples,), if ``events`` are an array
    - ``psi``: how late the time-weighted prediction shifts to the location branch; None for the
      model's own
    - ``diagnosis``: also break the error down, follow predictions over time, and keep an excerpt
    - ``scheduler``: the address of a Dask cluster that plays the recordings; None to play them here
    - ``progress``: a function that is called with (recordings done, all recordings)
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
        """Return the chip with these costs; ``InputError`` for a profile that does not exist."""
        return chip if self.profile is None else hw.priced_by(chip, self.profile)


class CompileRequest(Generic[TargetT], Frozen, eq=False):
    """All that is asked of the compiler: what to compile, for which chip, and how."""

    network: Network
    chip: TargetT
    setting: SettingRequest
    check: CheckRequest
    pricing: PricingRequest = PricingRequest()


def check_only_setting(request: CompileRequest[AnyChip], unpriced: str) -> None:
    """Refuse requests that make no sense for a chip with one setting and without a table of energies.

    ``unpriced`` is the reason why there is no table, for the message.
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
