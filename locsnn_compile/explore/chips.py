"""explore.json of one network on chips as types: what each loses and takes, or why it refuses it."""

import shlex
from collections.abc import Mapping, Sequence

from hw_model.values import Frozen
from locsnn_compile.cluster.spread import code_version
from locsnn_compile.explore.chip_points import ChipFigures, ChipPoint, ChipSetting, ChipStudy
from locsnn_compile.explore.document import ExploredEvents, ExploredModel
from locsnn_compile.explore.events import Chosen
from locsnn_compile.explore.point import ModelFile
from locsnn_compile.network.network import Network
from locsnn_compile.report.figures.entries import Entry
from locsnn_compile.settings import Value
from locsnn_compile.verification.error_bounds import ErrorBudget

SCHEMA = "locsnn-explore-chips/1"


class TriedChip(Entry):
    """A chip with values of dials, and what came of it: figures, or the sentence that refused it.

    ``name`` tells it from the other rows, and ``setting`` has the values asked for by dial.
    ``keeps_bounds`` is None without bounds or figures; ``reported`` are the figures on the
    recordings of ``--report-on``. The commands reproduce the figures.
    """

    target: str
    name: str
    setting: Mapping[str, Value]
    figures: ChipFigures | None
    refused: str | None
    keeps_bounds: bool | None
    reported: ChipFigures | None
    command: str
    report_command: str | None


class ChipsDocument(Entry):
    """explore.json of chips, in the order in which they were given.

    ``lose_least`` has the names of the rows that lose least, and ``runs_on`` those of the chips that
    hold the network.
    """

    schema: str
    code: str
    model: ExploredModel
    compared_on: ExploredEvents
    reported_on: ExploredEvents | None
    bounds: ErrorBudget | None
    runs_on: tuple[str, ...]
    lose_least: tuple[str, ...]
    chips: tuple[TriedChip, ...]

    @property
    def keep_bounds(self) -> tuple[str, ...]:
        """The names of the rows that keep the bounds."""
        return tuple(tried.name for tried in self.chips if tried.keeps_bounds)


class ChipCommands(Frozen, eq=False):
    """What the commands of all rows name: files, and options that say how recordings are read.

    ``calibration_file`` is None if it is the file of ``events``. ``reported_on`` are the recordings
    of ``--report-on``.
    """

    model: ModelFile
    events: Chosen
    calibration_file: str | None
    reading_arguments: tuple[str, ...]
    reported_on: Chosen | None = None

    def command(self, network: Network, setting: ChipSetting) -> str:
        """Return the command that reproduces the figures of a row."""
        return self._command(network, setting, self.events)

    def report_command(self, network: Network, setting: ChipSetting) -> str | None:
        """Return the command that reproduces them on the recordings of ``--report-on``."""
        if self.reported_on is None:
            return None
        return self._command(network, setting, self.reported_on)

    def _command(self, network: Network, setting: ChipSetting, events: Chosen) -> str:
        calibration = self.calibration_file or self.events.file
        assert events.file is not None
        assert calibration is not None
        rounded_for = ["--calibration", calibration] if network.by_strategy else []
        return shlex.join(
            [
                "locsnn-compile",
                *self.model.arguments(),
                *setting.arguments,
                *rounded_for,
                "--events",
                events.file,
                *self.reading_arguments,
            ]
        )


def chips_document(
    study: ChipStudy,
    points: Sequence[ChipPoint],
    commands: ChipCommands,
    budget: ErrorBudget,
    reported: Mapping[ChipSetting, ChipFigures | None],
) -> ChipsDocument:
    """Return what there is to say of points, of which at least one has figures.

    ``reported`` has the figures on the recordings of ``--report-on``.
    """
    network = study.network
    varied = varied_dials([point.setting for point in points])
    tried: list[TriedChip] = []
    for point in points:
        setting = point.setting
        reported_figures = reported.get(setting)
        report_command = None
        if reported_figures is not None:
            report_command = commands.report_command(network, setting)
        tried.append(
            TriedChip(
                target=setting.target,
                name=setting.name(varied),
                setting=setting.values,
                figures=point.figures,
                refused=None if point.refusal is None else str(point.refusal.error),
                keeps_bounds=_keeps_bounds(point, budget),
                reported=reported_figures,
                command=commands.command(network, setting),
                report_command=report_command,
            )
        )
    reported_on = commands.reported_on
    return ChipsDocument(
        schema=SCHEMA,
        code=code_version(),
        model=ExploredModel(network.name, network.sha256),
        compared_on=ExploredEvents.of(commands.events),
        reported_on=None if reported_on is None else ExploredEvents.of(reported_on),
        bounds=budget if budget.given else None,
        runs_on=_chips_with_figures(tried),
        lose_least=_lose_least(tried),
        chips=tuple(tried),
    )


def _keeps_bounds(point: ChipPoint, budget: ErrorBudget) -> bool | None:
    if point.figures is None or not budget.given:
        return None
    return point.figures.keeps(budget)


def varied_dials(settings: Sequence[ChipSetting]) -> tuple[str, ...]:
    """Return the dials of which several values are tried."""
    texts: dict[str, set[str]] = {}
    for setting in settings:
        for name, text in setting.dials:
            texts.setdefault(name, set()).add(text)
    return tuple(name for name, different in texts.items() if len(different) > 1)


def _chips_with_figures(tried: Sequence[TriedChip]) -> tuple[str, ...]:
    able = [each.target for each in tried if each.figures is not None]
    return tuple(dict.fromkeys(able))


def _lose_least(tried: Sequence[TriedChip]) -> tuple[str, ...]:
    losses = {each.name: each.figures.losses for each in tried if each.figures is not None}
    least = min(losses.values())
    return tuple(name for name, of_row in losses.items() if of_row == least)
