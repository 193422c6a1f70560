"""One network on several chips: what each loses and takes, or why it refuses the network."""

import shlex
from collections.abc import Mapping, Sequence

from hw_model.targets.families import AnyChip, chip_named
from hw_model.values import Frozen
from locsnn_compile.api import fulfil
from locsnn_compile.cluster.spread import code_version
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError, TargetError
from locsnn_compile.explore.document import ExploredEvents, ExploredModel
from locsnn_compile.explore.events import Chosen
from locsnn_compile.explore.point import ModelFile
from locsnn_compile.families import family_of
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.document import SharedFigures
from locsnn_compile.report.figures.entries import Entry
from locsnn_compile.request.compile_request import CheckRequest, CompileRequest, SettingRequest
from locsnn_compile.settings import Value
from locsnn_compile.verification.matching import Progress

SCHEMA = "locsnn-explore-chips/1"


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


def _error(agreement: float | None) -> float | None:
    return None if agreement is None else 1 - agreement


class Outcome(Frozen):
    """The figures of the network on a chip, or the sentence by which it was refused."""

    target: str
    figures: ChipFigures | None
    refused: str | None = None


class TriedChip(Entry):
    """An outcome, and the command that reproduces it."""

    target: str
    figures: ChipFigures | None
    refused: str | None
    command: str


class ChipsDocument(Entry):
    """explore.json of several chips, in the order in which they were given."""

    schema: str
    code: str
    model: ExploredModel
    compared_on: ExploredEvents
    runs_on: tuple[str, ...]
    lose_least: tuple[str, ...]
    chips: tuple[TriedChip, ...]

    @classmethod
    def of(
        cls, study: "ChipStudy", outcomes: Sequence[Outcome], commands: "ChipCommands"
    ) -> "ChipsDocument":
        """Return what there is to say of outcomes, of which at least one has figures."""
        able = [(each.target, each.figures) for each in outcomes if each.figures is not None]
        least = min(figures.losses for _, figures in able)
        network = study.network
        tried: list[TriedChip] = []
        for outcome in outcomes:
            command = commands.command(network, outcome.target)
            tried.append(TriedChip(outcome.target, outcome.figures, outcome.refused, command))
        return cls(
            schema=SCHEMA,
            code=code_version(),
            model=ExploredModel(network.name, network.sha256),
            compared_on=ExploredEvents.of(commands.events),
            runs_on=tuple(target for target, _ in able),
            lose_least=tuple(target for target, figures in able if figures.losses == least),
            chips=tuple(tried),
        )


class ChipStudy(Frozen, eq=False):
    """A network, the recordings of the check, those that weights are rounded for, and values of dials."""

    network: Network
    recordings: Recordings
    calibration: Recordings
    dials: Mapping[str, Value | None]


class ChipCommands(Frozen, eq=False):
    """What the commands of all chips name: files, options, and the values of dials.

    ``calibration_file`` is None if it is the file of ``events``; ``reading_arguments`` are the
    options that say how recordings are read.
    """

    model: ModelFile
    events: Chosen
    calibration_file: str | None
    dials: Mapping[str, Value | None]
    reading_arguments: tuple[str, ...]

    def command(self, network: Network, target: str) -> str:
        """Return the command that reproduces the figures of a chip."""
        calibration = self.calibration_file or self.events.file
        assert self.events.file is not None
        assert calibration is not None
        dials: list[str] = []
        for name, value in self.dials.items():
            if value is not None:
                dials += [f"--{name.replace('_', '-')}", str(value)]
        rounded_for = ["--calibration", calibration] if network.has_float_weights else []
        return shlex.join(
            [
                "locsnn-compile",
                *self.model.arguments(),
                "--target",
                target,
                *dials,
                *rounded_for,
                "--events",
                self.events.file,
                *self.reading_arguments,
            ]
        )


def try_chips(
    study: ChipStudy, targets: Sequence[str], progress: Progress | None = None
) -> tuple[Outcome, ...]:
    """Compile the network for each chip, and check it on the recordings.

    Raises ``InputError`` for recordings that do not fit, for a chip that does not exist, and if no
    chip can hold the network.
    """
    chips = [chip_named(target) for target in targets]
    outcomes: list[Outcome] = []
    for target, chip in zip(targets, chips, strict=True):
        outcomes.append(_try_chip(study, target, chip))
        if progress:
            progress(len(outcomes), len(targets))
    if all(outcome.figures is None for outcome in outcomes):
        sentences = "; ".join(f"{each.target}: {each.refused}" for each in outcomes)
        fix = "Try other chips of locsnn targets."
        raise InputError("--target", "no chip can run it", measured=sentences, fix=fix)
    return tuple(outcomes)


def _try_chip(study: ChipStudy, target: str, chip: AnyChip) -> Outcome:
    calibration = study.calibration if study.network.has_float_weights else None
    try:
        setting = family_of(chip).setting(chip, study.dials)
    except InputError as error:  # a value that this kind of chip does not have
        return Outcome(target, None, str(error))
    asked = SettingRequest.of(setting, study.dials, None, calibration)
    check = CheckRequest(study.recordings, diagnosis=False)
    try:
        compiled = fulfil(CompileRequest(study.network, chip, asked, check))
    except TargetError as error:
        return Outcome(target, None, str(error))
    return Outcome(target, ChipFigures.of(compiled.figures))
