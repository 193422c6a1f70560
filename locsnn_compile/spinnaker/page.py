"""The report of a program for SpiNNaker as content without form, in the order of all reports."""

from locsnn_compile.report.compose import LONGEST_NAME
from locsnn_compile.report.content import (
    Bullets,
    Cell,
    Fact,
    Notice,
    Report,
    Section,
    Table,
    Verdict,
)
from locsnn_compile.report.figures.entries import keys_of
from locsnn_compile.report.figures.match import MatchFigures
from locsnn_compile.report.figures.operations import OperationFigures
from locsnn_compile.report.figures.resources import ProgramUse
from locsnn_compile.report.format import (
    NONE,
    agreed,
    any_value,
    count,
    known,
    plural,
    share,
    shortened,
    time,
)
from locsnn_compile.report.sections import behaviour, build
from locsnn_compile.report.sections.verdict import fullness, matches, notices
from locsnn_compile.report.words import words
from locsnn_compile.spinnaker.document import (
    NO_TABLE,
    REAL_TIME,
    OwnScale,
    SpinnakerFigures,
    SpinnakerNumbers,
)

KEEP_IN_MIND = (
    "The arithmetic was compared with the machine code that sPyNNaker 7.4.1 ships, value by value, in "
    "an emulator. Its event loop, packets and spike sources did not run there: no board was used.",
    "A core that does not finish its step in a millisecond sends late. A board counts that; it is "
    "not part of the model.",
)
_OPERATIONS = (
    "A synaptic operation adds a weight to a ring buffer; a neuron is updated in every step. The "
    "published method counts on paper: spikes of the trained network times their fan-out, and the "
    "events that are transposed for the location branch."
)
_INTEGERS = (
    "The network was rounded to the integers of loihi-sim first. What differs here is due to the "
    "arithmetic of SpiNNaker alone; the rest of the differences above is due to that rounding and to "
    "the strategy."
)
_NUMBERS = (
    "The network was rounded to integers first; a potential of 1 in the float network is the scale "
    "in registers of these. On SpiNNaker a weight of 1 is the weight unit, and a potential of 1 the "
    "potential unit: the largest powers of two up to 1 at which nothing can wrap while every source "
    "sends once a step at most. Weights that take more than 16 bits then are stored rounded. Where "
    "two numbers are given, they are the smallest and the largest, or excitation and inhibition."
)
_OWN_SCALE = (
    "Weights are stored in units of 2^(shift - 15) nA. The program tells sPyNNaker the largest sum of "
    "weights that a step can bring, which gives its shifts. Left to itself, sPyNNaker takes the "
    "largest weight times the most synapses of a neuron or, where delays differ, an estimate from "
    "sources that send 30 spikes a second and five standard deviations."
)


def compose_spinnaker(report: SpinnakerFigures) -> Report:
    """Return the whole report."""
    match = report.match
    names = (report.model.name, report.target)
    return Report(
        kind="locsnn-compile report",
        title=" on ".join(shortened(name, LONGEST_NAME) for name in names),
        subtitle=(
            f"{report.weight_bits}-bit weights, strategy {report.strategy}, "
            f"{plural(match.samples, 'recording')} of {match.events_source}"
        ),
        verdicts=(matches(report), _costs(report), _fits(report)),
        notices=(*notices(report), *_notices(match)),
        sections=(
            behaviour.agreement(match),
            _integers(report),
            _operations(report.operations),
            _resources(report.resources, report.target),
            build.left_out(report),
            _quantization(report),
            _own_scale(report),
            _provenance(report),
        ),
        footer="Per recording means the mean over the recordings of the check.",
        assumptions=report.assumptions,
    )


def _costs(report: SpinnakerFigures) -> Verdict:
    """How much does a recording take: counted operations and real time, as energy is not known."""
    per_sample = report.operations.per_sample
    return Verdict(
        question="What does it cost?",
        status="unknown",
        answer="Energy not known",
        figure=plural(per_sample.synaptic_ops, "synaptic operation"),
        figure_label="per recording",
        sentence=f"Energy is not known, because {NO_TABLE}. In time, {REAL_TIME}.",
        facts=(
            Fact("real time", time(report.latency.per_sample_ns)),
            Fact("neuron updates", count(per_sample.neuron_updates)),
            Fact("spikes", count(per_sample.spikes)),
        ),
    )


def _fits(report: SpinnakerFigures) -> Verdict:
    limits = report.resources.limits
    fullest = max(limits, key=lambda name: fullness(limits[name]))
    use = limits[fullest]
    cores = f"{count(limits['cores'].used)} of {plural(limits['cores'].limit, 'core')}"
    full = f"{count(use.used)} of {count(use.limit)} ({share(fullness(use))})"
    return Verdict(
        question="Does it fit?",
        status="yes",
        answer="Yes",
        figure=cores,
        figure_label=f"of {report.target}, besides sources and monitors",
        sentence=f"The largest phase of the program takes {cores} of {report.target}.",
        facts=(
            Fact("fullest limit", f"{words(fullest)}, {full}"),
            Fact("synapses", count(report.resources.synapses)),
        ),
    )


def _notices(match: MatchFigures) -> tuple[Notice, ...]:
    """Return what limits the figures and only SpiNNaker does."""
    said = []
    if match.wraps:
        text = (
            f"Numbers left their 32 bits {plural(match.wraps, 'time')} and kept the rest. What the "
            "neuron does after that says little about the float network."
        )
        said.append(Notice("Registers wrapped.", text))
    if match.clips:
        text = f"Ring buffers of 16 bits were full {plural(match.clips, 'time')}, and lost what came on top."
        said.append(Notice("Ring buffers saturated.", text))
    return tuple(said)


def _resources(resources: ProgramUse, target: str) -> Section:
    rows = tuple(
        (words(name), count(use.used), count(use.limit), share(fullness(use)))
        for name, use in resources.limits.items()
    )
    columns = ("limit", "used", "of", "share")
    lead = f"How much of {target} the program uses; of a limit of a core, its fullest core."
    return Section("resources", "Resources", lead, (Table("Limits", columns, rows),))


def _quantization(report: SpinnakerFigures) -> Section:
    table = Table(
        build.NUMBERS,
        ("population", *(words(key) for key in keys_of(SpinnakerNumbers))),
        tuple(_numbers(name, numbers) for name, numbers in report.quantization.items()),
    )
    return Section("quantization", build.QUANTISATION, _NUMBERS, (table,))


def _numbers(name: str, numbers: SpinnakerNumbers) -> tuple[Cell, ...]:
    cells: list[Cell] = [name]
    for key in keys_of(SpinnakerNumbers):
        cells.append(_number(key, getattr(numbers, key)))
    return tuple(cells)


def _number(key: str, value: object) -> str:
    """Return a number in words: shares that are small, and sums that need no decimals, in their own way."""
    if key == "current_decay_error":
        return f"{value:.2g}"
    if isinstance(value, tuple) and key == "largest_sums_na":
        return ", ".join(count(each) for each in value)
    return any_value(value)


def _integers(report: SpinnakerFigures) -> Section:
    rows = tuple(
        (
            name,
            agreed(compared.spike_agreement, NONE),
            count(compared.reference_spikes),
            count(compared.chip_spikes),
            count(compared.spike_mismatches),
        )
        for name, compared in report.integers_match.items()
    )
    columns = (
        "population",
        "spikes equal",
        "spikes on loihi-sim",
        "chip spikes",
        "only on one side",
    )
    title = "Agreement with its integers"
    return Section("integers", title, _INTEGERS, (Table("Spikes by population", columns, rows),))


def _own_scale(report: SpinnakerFigures) -> Section:
    rows = tuple(
        _own_row(name, own, report.quantization[name].ring_shifts)
        for name, own in report.own_scale.items()
    )
    columns = (
        *("population", "shifts", "shifts of sPyNNaker's choice"),
        *("spikes", "left by its choice", "lost"),
    )
    title = "What sPyNNaker's own choice of shifts would cost"
    return Section("own-scale", title, _OWN_SCALE, (Table(title, columns, rows),))


def _own_row(name: str, own: OwnScale, shifts: tuple[int, int]) -> tuple[Cell, ...]:
    lost: float | None = None
    if own.program_spikes and own.equal_spikes is not None:
        lost = 1 - own.equal_spikes / own.program_spikes
    return (
        name,
        any_value(shifts),
        any_value(own.ring_shifts),
        known(own.program_spikes, count, NONE),
        known(own.equal_spikes, count, NONE),
        known(lost, share, NONE),
    )


def _operations(figures: OperationFigures) -> Section:
    tables = behaviour.operations(figures)
    return Section(tables.key, tables.title, _OPERATIONS, tables.blocks)


def _provenance(report: SpinnakerFigures) -> Section:
    return Section.of(
        "provenance",
        "Provenance",
        build.PROVENANCE,
        build.origin(report),
        build.gates(report.gates),
        Bullets("Keep in mind", KEEP_IN_MIND),
    )
