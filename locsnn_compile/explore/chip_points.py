"""One network on one chip by one setting: its figures, or why that chip refuses it.

All points share a study: a network, the recordings of the check, those that weights are rounded
for, and the engines to time. A setting has values of some dials; the others are usual on each chip.
"""

import itertools
from collections.abc import Mapping, Sequence
from functools import cached_property, partial

from hw_model.simulation import Engine
from hw_model.targets.families import AnyChip, chip_named, family_of
from hw_model.values import Frozen
from locsnn_compile.api import fulfil
from locsnn_compile.cluster.spread import Spread, code_version
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, LocsnnError, TargetError
from locsnn_compile.explore.point import digest_of, recordings_digest
from locsnn_compile.explore.sweep import Store, measured_points
from locsnn_compile.explore.timing import Timing, engine_timings
from locsnn_compile.families import setting_of
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.document import SharedFigures
from locsnn_compile.report.figures.entries import Entry
from locsnn_compile.request.compile_request import CheckRequest, CompileRequest, SettingRequest
from locsnn_compile.settings import DIALS, Value
from locsnn_compile.verification.error_bounds import ErrorBudget, within
from locsnn_compile.verification.matching import Progress
from locsnn_compile.verification.observation import check_labels


class ChipSetting(Frozen):
    """What is tried: a chip, and values of some dials, by name, as options of a command write them."""

    target: str
    dials: tuple[tuple[str, str], ...] = ()

    @property
    def values(self) -> dict[str, Value]:
        """The values by dial."""
        read = {dial.name: dial.read for dial in DIALS}
        return {name: read[name](text) for name, text in self.dials}

    @property
    def arguments(self) -> list[str]:
        """The options of ``locsnn-compile``."""
        option = {dial.name: dial.option for dial in DIALS}
        arguments = ["--target", self.target]
        for name, text in self.dials:
            arguments += [option[name], text]
        return arguments

    def name(self, varied: Sequence[str] = ()) -> str:
        """Return the chip, with the values of the dials that are ``varied`` in brackets."""
        values = self.values
        words = [
            dial.words(values[dial.name])
            for dial in DIALS
            if dial.name in varied and dial.name in values
        ]
        return f"{self.target} ({', '.join(words)})" if words else self.target


class ChipFigures(Entry):
    """What the report of a program says, with means per recording.

    Errors are shares of what was compared, None if nothing was; accuracies are None without labels,
    and energy and time where nothing published tells them.
    """

    strategy: str
    weight_bits: int
    spike_error: float | None
    prediction_error: float | None
    score_error: float | None
    accuracy: float | None
    float_accuracy: float | None
    cores: int
    synapses: int
    synaptic_ops: float
    chip_time_ns: float | None
    energy_pj: float | None
    energy_profile: str | None

    @classmethod
    def of(cls, report: SharedFigures) -> "ChipFigures":
        """Take the figures from a report of any kind of chip."""
        match = report.match
        accuracy = report.accuracy
        return cls(
            strategy=report.strategy,
            weight_bits=report.weight_bits,
            spike_error=_error(match.spikes.spike_agreement),
            prediction_error=_error(match.prediction_agreement),
            score_error=match.score_error,
            accuracy=None if accuracy is None else accuracy.chip,
            float_accuracy=None if accuracy is None else accuracy.reference,
            cores=report.resources.cores,
            synapses=report.resources.synapses,
            synaptic_ops=report.operations.per_sample.synaptic_ops,
            chip_time_ns=report.latency_ns,
            energy_pj=report.energy_pj,
            energy_profile=report.energy_profile,
        )

    @property
    def losses(self) -> tuple[float, float, float]:
        """Errors of predictions, spikes and scores, to compare by; 0 for what was not compared."""
        return (self.prediction_error or 0.0, self.spike_error or 0.0, self.score_error or 0.0)

    def keeps(self, budget: ErrorBudget) -> bool:
        """Tell whether the budget is kept; a bound on something that was not compared is not kept."""
        most_changed = None if budget.min_agreement is None else 1 - budget.min_agreement
        bounds = (
            (self.prediction_error, most_changed),
            (self.spike_error, budget.max_spike_error),
            (self.score_error, budget.max_score_error),
        )
        return all(_is_within(error, bound) for error, bound in bounds)


def _error(agreement: float | None) -> float | None:
    return None if agreement is None else 1 - agreement


def _is_within(error: float | None, bound: float | None) -> bool:
    if bound is None:
        return True
    return error is not None and within(error, bound)


class Refusal(Frozen):
    """An error in parts, which are compared and stored; ``is_of_chip``: the chip lacks something."""

    where: str
    what: str
    measured: str
    fix: str
    is_of_chip: bool

    @classmethod
    def of(cls, error: LocsnnError) -> "Refusal":
        """Take an error apart."""
        is_of_chip = isinstance(error, TargetError)
        return cls(error.where, error.what, error.measured, error.fix, is_of_chip)

    @property
    def error(self) -> LocsnnError:
        """The error again."""
        kind = TargetError if self.is_of_chip else InputError
        return kind(self.where, self.what, measured=self.measured, fix=self.fix)


class ChipPoint(Frozen):
    """A setting with its figures or its refusal, ``timings`` by engine, and the code that measured it."""

    setting: ChipSetting
    figures: ChipFigures | None
    refusal: Refusal | None
    timings: Mapping[str, Timing]
    code: str


class ChipStudy(Frozen, eq=False):
    """What all points share; ``model_digest`` is that of the files of ``network``."""

    network: Network
    model_digest: str
    chips: Mapping[str, AnyChip]
    recordings: Recordings
    calibration: Recordings
    engines: tuple[Engine, ...] = ()

    def key(self, setting: ChipSetting) -> str:
        """Return the name of a point: a hash of all that determines it."""
        document = family_of(setting.target).document(setting.target)
        return digest_of(
            [self._digest, setting.target, document, setting.dials, self.engines, code_version()]
        )

    @cached_property
    def _digest(self) -> str:
        played = [recordings_digest(self.recordings), recordings_digest(self.calibration)]
        return digest_of([self.network.name, self.model_digest, played])

    def check(self) -> None:
        """Refuse recordings that fit no chip, because they do not fit the network: ``InputError``."""
        for recordings in (self.recordings, self.calibration):
            self.network.with_steps_of(recordings).fitted(recordings)
        recordings = self.recordings
        check_labels(self.network, recordings.labels, len(recordings), recordings.source)

    def request(self, setting: ChipSetting) -> CompileRequest[AnyChip]:
        """Return what is asked of the compiler; its report needs no diagnosis."""
        chip = self.chips[setting.target]
        chosen = setting_of(chip, self.network, setting.values)
        calibration = self.calibration if self.network.by_strategy else None
        setting_request = SettingRequest.of(chosen, setting.values, None, calibration)
        check = CheckRequest(self.recordings, diagnosis=False)
        return CompileRequest(self.network, chip, setting_request, check)


def chips_of(targets: Sequence[str]) -> dict[str, AnyChip]:
    """Return chips by what was given for them; ``InputError`` for one that does not exist."""
    return {target: chip_named(target) for target in targets}


def chip_settings(
    targets: Sequence[str], wanted: Mapping[str, Sequence[Value]]
) -> tuple[ChipSetting, ...]:
    """Return every chip with every combination of the values wanted, the last dial fastest."""
    choices = [
        [(name, str(value)) for value in dict.fromkeys(values)]
        for name, values in wanted.items()
        if values
    ]
    return tuple(
        ChipSetting(target, dials)
        for target in dict.fromkeys(targets)
        for dials in itertools.product(*choices)
    )


def measure_chip(study: ChipStudy, setting: ChipSetting) -> ChipPoint:
    """Compile and check for a chip as ``locsnn-compile`` does, then time each engine.

    What a chip refuses, whether the network or the value of a dial, says nothing of other chips.
    """
    try:
        compiled = fulfil(study.request(setting))
    except (InputError, TargetError) as error:
        return ChipPoint(setting, None, Refusal.of(error), {}, code_version())
    fitted = study.network.with_steps_of(study.recordings).fitted(study.recordings)
    timings = engine_timings(compiled.program, fitted.spikes, study.engines)
    return ChipPoint(setting, ChipFigures.of(compiled.figures), None, timings, code_version())


def try_chips(
    study: ChipStudy,
    settings: Sequence[ChipSetting],
    store: Store[ChipPoint],
    spread: Spread,
    progress: Progress | None = None,
) -> tuple[ChipPoint, ...]:
    """Return a point for every setting, in their order; each is stored as soon as it is measured.

    Raises ``InputError`` for recordings that do not fit the network. If every chip refuses it, the
    error is that of the only one, or one with the sentences of all.
    """
    study.check()
    keys = {setting: study.key(setting) for setting in settings}
    points = measured_points(partial(measure_chip, study), keys, store, spread, progress)
    refusals = [point.refusal for point in points if point.refusal is not None]
    if len(refusals) == len(points):
        raise _error_of_all(points, refusals)
    return points


def _error_of_all(points: Sequence[ChipPoint], refusals: Sequence[Refusal]) -> LocsnnError:
    if len(points) == 1:
        return refusals[0].error
    sentences = {
        f"{point.setting.target}: {refusal.error}": None
        for point, refusal in zip(points, refusals, strict=True)
    }
    kind = TargetError if all(refusal.is_of_chip for refusal in refusals) else InputError
    fix = "Try other chips of locsnn targets."
    return kind("--target", "no chip can run it", measured="; ".join(sentences), fix=fix)
