"""Points of ``locsnn explore`` with several chips: one network compiled for one chip by one setting.

A point has figures, or the reason why the chip refuses the network. All points share a study: the
network, the recordings of the check, those for which weights are rounded, and the engines to time.
A setting names a chip and values for some dials (choices of the compiler, such as the weight bits);
all other dials have the value that is usual on that chip.
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
    """What is tried: a chip and, for some dials, pairs of the dial's name and a value.

    Values are texts, as on a command line, so that settings can be compared, hashed and stored.
    """

    target: str
    dials: tuple[tuple[str, str], ...] = ()

    @property
    def values(self) -> dict[str, Value]:
        """The values by dial."""
        parse = {dial.name: dial.read for dial in DIALS}
        return {name: parse[name](text) for name, text in self.dials}

    @property
    def arguments(self) -> list[str]:
        """The options of ``locsnn-compile`` that reproduce the setting."""
        option_of_dial = {dial.name: dial.option for dial in DIALS}
        arguments = ["--target", self.target]
        for name, text in self.dials:
            arguments += [option_of_dial[name], text]
        return arguments

    def name(self, varied: Sequence[str] = ()) -> str:
        """Return the chip and, in brackets, the values of the ``varied`` dials: of these several are tried."""
        values = self.values
        words: list[str] = []
        for dial in DIALS:
            if dial.name in varied and dial.name in values:
                words.append(dial.words(values[dial.name]))
        return f"{self.target} ({', '.join(words)})" if words else self.target


class ChipFigures(Entry):
    """Figures of a program's report; costs are means per recording.

    Errors are shares of what was compared, None if nothing was compared. Accuracies, of the chip and
    of the float network, are None without labels. Energy and time are None where nothing is published.
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
        """Return the figures of a report of any kind of chip."""
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
        """Errors of predictions, spikes and scores, by which points are ranked in this order.

        An error is 0 if nothing was compared.
        """
        return (self.prediction_error or 0.0, self.spike_error or 0.0, self.score_error or 0.0)

    def keeps(self, budget: ErrorBudget) -> bool:
        """Return whether the budget is kept; a bound on something that was not compared is not kept."""
        max_prediction_error = None if budget.min_agreement is None else 1 - budget.min_agreement
        return (
            _is_within(self.prediction_error, max_prediction_error)
            and _is_within(self.spike_error, budget.max_spike_error)
            and _is_within(self.score_error, budget.max_score_error)
        )


def _error(agreement: float | None) -> float | None:
    return None if agreement is None else 1 - agreement


def _is_within(error: float | None, bound: float | None) -> bool:
    """Return whether an error keeps a bound; every error keeps no bound."""
    if bound is None:
        return True
    return error is not None and within(error, bound)


class Refusal(Frozen):
    """The parts of the error by which a chip refused a point: they can be compared and stored.

    ``is_of_chip``: it is a ``TargetError``, because the chip lacks something, and otherwise an
    ``InputError``, because a value means nothing for the chip.
    """

    where: str
    what: str
    measured: str
    fix: str
    is_of_chip: bool

    @classmethod
    def of(cls, error: LocsnnError) -> "Refusal":
        """Return the parts of an error."""
        is_of_chip = isinstance(error, TargetError)
        return cls(error.where, error.what, error.measured, error.fix, is_of_chip)

    @property
    def error(self) -> LocsnnError:
        """The error, made again from its parts."""
        kind = TargetError if self.is_of_chip else InputError
        return kind(self.where, self.what, measured=self.measured, fix=self.fix)


class ChipPoint(Frozen):
    """A setting with either its figures or its refusal.

    ``timings`` are by engine, and ``code`` is the version of the code that measured the point.
    """

    setting: ChipSetting
    figures: ChipFigures | None
    refusal: Refusal | None
    timings: Mapping[str, Timing]
    code: str


class ChipStudy(Frozen, eq=False):
    """What all points share: the network and its recordings, and the chips by the names given for them.

    ``model_digest`` is a hash of the files of ``network``.
    """

    network: Network
    model_digest: str
    chips: Mapping[str, AnyChip]
    recordings: Recordings
    calibration: Recordings
    engines: tuple[Engine, ...] = ()

    def key(self, setting: ChipSetting) -> str:
        """Return the name under which a point is stored: a hash of all that determines it."""
        # The content of the chip file, because the same name may stand for a file that was edited.
        document = family_of(setting.target).document(setting.target)
        return digest_of(
            [self._digest, setting.target, document, setting.dials, self.engines, code_version()]
        )

    @cached_property
    def _digest(self) -> str:
        """A hash of what is the same for all points."""
        of_recordings = [recordings_digest(self.recordings), recordings_digest(self.calibration)]
        return digest_of([self.network.name, self.model_digest, of_recordings])

    def check(self) -> None:
        """Raise ``InputError`` for recordings that do not fit the network, whatever the chip."""
        for recordings in (self.recordings, self.calibration):
            self.network.with_steps_of(recordings).fitted(recordings)
        recordings = self.recordings
        check_labels(self.network, recordings.labels, len(recordings), recordings.source)

    def request(self, setting: ChipSetting) -> CompileRequest[AnyChip]:
        """Return what is asked of the compiler for a point; its report needs no diagnosis."""
        chip = self.chips[setting.target]
        compiler_setting = setting_of(chip, self.network, setting.values)
        # Only neurons that are lowered by a strategy have weights that are rounded for recordings.
        calibration = self.calibration if self.network.by_strategy else None
        setting_request = SettingRequest.of(
            compiler_setting, setting.values, budget=None, calibration=calibration
        )
        check = CheckRequest(self.recordings, diagnosis=False)
        return CompileRequest(self.network, chip, setting_request, check)


def chips_of(targets: Sequence[str]) -> dict[str, AnyChip]:
    """Return the chips by the names or files given for them; ``InputError`` for one that does not exist."""
    return {target: chip_named(target) for target in targets}


def chip_settings(
    targets: Sequence[str], values_to_try: Mapping[str, Sequence[Value]]
) -> tuple[ChipSetting, ...]:
    """Return every chip with every combination of the values to try, the last dial varying fastest.

    ``values_to_try`` are by dial; a dial without values is left at the usual value of each chip.
    """
    choices_by_dial: list[list[tuple[str, str]]] = []
    for name, values in values_to_try.items():
        if values:
            choices_by_dial.append([(name, str(value)) for value in dict.fromkeys(values)])
    combinations = list(itertools.product(*choices_by_dial))
    return tuple(
        ChipSetting(target, dials) for target in dict.fromkeys(targets) for dials in combinations
    )


def measure_chip(study: ChipStudy, setting: ChipSetting) -> ChipPoint:
    """Compile and check for a chip as ``locsnn-compile`` does, then time each engine.

    Where the chip refuses the network or the value of a dial, the point has the refusal: other chips
    may still take it.
    """
    try:
        compiled = fulfil(study.request(setting))
    except (InputError, TargetError) as error:
        return ChipPoint(
            setting, figures=None, refusal=Refusal.of(error), timings={}, code=code_version()
        )
    # The recordings with the channels and steps of the network, as the check has played them.
    fitted = study.network.with_steps_of(study.recordings).fitted(study.recordings)
    return ChipPoint(
        setting,
        figures=ChipFigures.of(compiled.figures),
        refusal=None,
        timings=engine_timings(compiled.program, fitted.spikes, study.engines),
        code=code_version(),
    )


def try_chips(
    study: ChipStudy,
    settings: Sequence[ChipSetting],
    store: Store[ChipPoint],
    spread: Spread,
    progress: Progress | None = None,
) -> tuple[ChipPoint, ...]:
    """Return a point for every setting, in their order; each is stored as soon as it is measured.

    Raises ``InputError`` for recordings that do not fit the network. If every chip refuses the
    network, raises the error of a single point, or one error with the sentences of all.
    """
    study.check()
    keys = {setting: study.key(setting) for setting in settings}
    points = measured_points(partial(measure_chip, study), keys, store, spread, progress)
    refusals = [point.refusal for point in points if point.refusal is not None]
    if len(refusals) == len(points):
        raise _error_of_all(points, refusals)
    return points


def _error_of_all(points: Sequence[ChipPoint], refusals: Sequence[Refusal]) -> LocsnnError:
    """Return the error that ends a command in which every point was refused."""
    if len(points) == 1:
        return refusals[0].error
    sentences: dict[str, None] = {}  # settings of one chip often fail by the same sentence
    for point, refusal in zip(points, refusals, strict=True):
        sentences[f"{point.setting.target}: {refusal.error}"] = None
    kind = TargetError if all(refusal.is_of_chip for refusal in refusals) else InputError
    fix = "Try other chips of locsnn targets."
    return kind("--target", "no chip can run it", measured="; ".join(sentences), fix=fix)
