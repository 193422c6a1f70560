"""explore.json of one chip, as types, and its points as rows of explore.csv.

The fields of an ``Entry`` are the keys of its JSON object, in this order; ``INLINED`` puts the keys
of an object into the object around it. A point is one setting of the compiler with its figures.
"""

from collections.abc import Iterable
from typing import Annotated

from locsnn_compile.cluster.spread import code_version
from locsnn_compile.explore.events import Chosen
from locsnn_compile.explore.exploration import FRONT_RULE, OBJECTIVES, Exploration
from locsnn_compile.explore.point import Figures
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.entries import INLINED, Entry, keys_of, plain
from locsnn_compile.settings import Setting
from locsnn_compile.verification.error_bounds import ErrorBudget

SCHEMA = "locsnn-explore/1"


class ExploredModel(Entry):
    """The name of the network, and the checksum of its file."""

    name: str
    sha256: str | None


class ExploredEvents(Entry):
    """The recordings of a comparison: ``recordings`` of the ``available`` ones of a source were used."""

    source: str
    part: str | None
    recordings: int
    available: int

    @classmethod
    def of(cls, chosen: Chosen) -> "ExploredEvents":
        """Return the entry of some recordings."""
        recordings = chosen.recordings
        return cls(recordings.source, chosen.part, len(recordings), chosen.available)


class Recommended(Entry):
    """The setting that is recommended, None if no setting keeps the bounds."""

    setting: Setting | None
    why: str
    command: str | None
    budget: Annotated[ErrorBudget, INLINED]


class PointFigures(Entry):
    """The figures of a point; those to minimise come first."""

    spike_error: float | None
    prediction_error: float | None
    score_error: float | None
    energy_pj: float | None
    chip_time_ns: float
    prediction_agreement: float | None
    spike_agreement: float | None
    accuracy: float | None
    float_accuracy: float | None
    energy_profile: str | None
    cores: int
    compartments: int
    synapses: int
    synapse_bits: int
    wraps: int
    clips: int

    @classmethod
    def of(cls, figures: Figures | None) -> "PointFigures | None":
        """Return the figures as explore.json has them; None without any."""
        if figures is None:
            return None
        return cls(
            spike_error=figures.spike_error,
            prediction_error=figures.prediction_error,
            score_error=figures.score_error,
            energy_pj=figures.energy_pj,
            chip_time_ns=figures.chip_time_ns,
            prediction_agreement=figures.prediction_agreement,
            spike_agreement=figures.spike_agreement,
            accuracy=figures.accuracy,
            float_accuracy=figures.float_accuracy,
            energy_profile=figures.energy_profile,
            cores=figures.cores,
            compartments=figures.compartments,
            synapses=figures.synapses,
            synapse_bits=figures.synapse_bits,
            wraps=figures.wraps,
            clips=figures.clips,
        )


class ExploredPoint(Entry):
    """A setting with its figures, or the reason why it was refused.

    ``reported``: for a setting on the front, its figures on the recordings of ``--report-on``.
    ``command`` and ``report_command`` reproduce ``figures`` and ``reported``.
    """

    setting: Setting
    figures: PointFigures | None
    refused: str | None
    on_front: bool
    recommended: bool
    reported: PointFigures | None
    command: str
    report_command: str | None


class ExploreDocument(Entry):
    """All of explore.json, with points in the order of the grid."""

    schema: str
    code: str
    model: ExploredModel
    target: str
    chosen_on: ExploredEvents
    reported_on: ExploredEvents | None
    objectives: tuple[str, ...]
    front_rule: str
    recommended: Recommended
    points: tuple[ExploredPoint, ...]

    @classmethod
    def of(cls, exploration: Exploration) -> "ExploreDocument":
        """Return explore.json of an exploration."""
        network = exploration.study.network
        reported_on = exploration.reported_on
        return cls(
            schema=SCHEMA,
            code=code_version(),
            model=ExploredModel(network.name, network.sha256),
            target=exploration.study.chip.name,
            chosen_on=ExploredEvents.of(exploration.events),
            reported_on=None if reported_on is None else ExploredEvents.of(reported_on),
            objectives=OBJECTIVES,
            front_rule=FRONT_RULE,
            recommended=_recommended(exploration),
            points=tuple(_points(exploration)),
        )


def _recommended(exploration: Exploration) -> Recommended:
    """Return the entry of the recommendation."""
    point = exploration.recommendation.taken
    return Recommended(
        setting=None if point is None else point.setting,
        why=exploration.recommendation.why,
        command=None if point is None else exploration.command(point.setting),
        budget=exploration.budget,
    )


def _points(exploration: Exploration) -> Iterable[ExploredPoint]:
    """Yield the entry of each point."""
    reported = {point.setting: point.figures for point in exploration.reported}
    for point, on_front in zip(exploration.points, exploration.on_front, strict=True):
        yield ExploredPoint(
            setting=point.setting,
            figures=PointFigures.of(point.figures),
            refused=None if point.refused is None else str(point.refused),
            on_front=on_front,
            recommended=point is exploration.recommendation.taken,
            reported=PointFigures.of(reported.get(point.setting)),
            command=exploration.command(point.setting),
            report_command=exploration.report_command(point.setting),
        )


def table_row(point: ExploredPoint) -> Document:
    """Return a row of explore.csv; cells without a figure are empty."""
    no_figures = dict.fromkeys(keys_of(PointFigures))  # rows of a CSV have equal keys
    figures = no_figures if point.figures is None else plain(point.figures)
    reported = no_figures if point.reported is None else plain(point.reported)
    return {
        **plain(point.setting),
        "on_front": point.on_front,
        "recommended": point.recommended,
        **figures,
        **{f"reported_{name}": figure for name, figure in reported.items()},
        "refused": point.refused,
        "command": point.command,
        "report_command": point.report_command,
    }
