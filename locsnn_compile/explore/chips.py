"""explore.json for one network on several chips, as types: figures of each chip, or why it refuses.

The fields of an ``Entry`` are the keys of its JSON object. A row is a chip with one combination of
the values that the user gave for dials, choices of the compiler such as the weight bits.
"""

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
    """A row: a chip with values of dials, and its figures or the sentence by which it refused.

    - ``name``: the chip and the values by which this row differs from the others
    - ``setting``: the values that the user gave, by dial
    - ``keeps_bounds``: None without bounds or without figures
    - ``reported``: the figures on the recordings of ``--report-on``
    - ``command``, ``report_command``: reproduce ``figures`` and ``reported``
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
    """All of explore.json, with chips in the order in which they were given.

    ``runs_on`` has the names of the chips that can hold the network, and ``lose_least`` the names of
    the rows with the smallest errors.
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
    """Makes the commands that reproduce rows, from the files and options that all of them name.

    ``calibration_file`` is None if it is the file of ``events``. ``reading_arguments`` are options
    that say how recordings are read. ``reported_on`` are the recordings of ``--report-on``.
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
        """Return the command for the recordings of ``--report-on``; None without that option."""
        if self.reported_on is None:
            return None
        return self._command(network, setting, self.reported_on)

    def _command(self, network: Network, setting: ChipSetting, events: Chosen) -> str:
        calibration = self.calibration_file or self.events.file
        # Recordings without a file have been written to a copy before any command is made.
        assert events.file is not None
        assert calibration is not None
        # locsnn-compile refuses the option if no weight is rounded for recordings.
        calibration_arguments = ["--calibration", calibration] if network.by_strategy else []
        return shlex.join(
            [
                "locsnn-compile",
                *self.model.arguments(),
                *setting.arguments,
                *calibration_arguments,
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
    """Return explore.json for points of which at least one has figures.

    ``reported`` has the figures on the recordings of ``--report-on``, by setting.
    """
    network = study.network
    varied = varied_dials([point.setting for point in points])
    rows: list[TriedChip] = []
    for point in points:
        setting = point.setting
        reported_figures = reported.get(setting)
        report_command = None
        if reported_figures is not None:
            report_command = commands.report_command(network, setting)
        rows.append(
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
        runs_on=_chips_with_figures(rows),
        lose_least=_lose_least(rows),
        chips=tuple(rows),
    )


def _keeps_bounds(point: ChipPoint, budget: ErrorBudget) -> bool | None:
    """Return whether a point keeps the bounds; None if there are none, or no figures."""
    if point.figures is None or not budget.given:
        return None
    return point.figures.keeps(budget)


def varied_dials(settings: Sequence[ChipSetting]) -> tuple[str, ...]:
    """Return the names of the dials of which several values are tried."""
    values_of_dial: dict[str, set[str]] = {}
    for setting in settings:
        for name, text in setting.dials:
            values_of_dial.setdefault(name, set()).add(text)
    return tuple(name for name, values in values_of_dial.items() if len(values) > 1)


def _chips_with_figures(rows: Sequence[TriedChip]) -> tuple[str, ...]:
    """Return the chips that can hold the network, each once."""
    targets = [row.target for row in rows if row.figures is not None]
    return tuple(dict.fromkeys(targets))


def _lose_least(rows: Sequence[TriedChip]) -> tuple[str, ...]:
    """Return the names of the rows with the smallest errors: of predictions, then spikes, then scores."""
    losses_of_row = {row.name: row.figures.losses for row in rows if row.figures is not None}
    least = min(losses_of_row.values())
    return tuple(name for name, losses in losses_of_row.items() if losses == least)
