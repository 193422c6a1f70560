"""The content of a report on a program for SpiNNaker, from which HTML, Markdown and terminal text are rendered.

The constants are texts of the report. The functions turn figures of report.json into verdicts, sections and tables.
"""

import math

from locsnn_compile.own_arithmetic.page import (
    FamilyPage,
    compose_page,
    costs_verdict,
    fits_verdict,
    limits_section,
    numbers_section,
    operations_section,
    provenance_section,
    worst_verdict,
)
from locsnn_compile.report.content import Cell, Fact, Notice, Report, Section, Table, Verdict
from locsnn_compile.report.figures.match import MatchFigures
from locsnn_compile.report.format import (
    NONE,
    agreed,
    any_value,
    count,
    known,
    plural,
    share,
    time,
)
from locsnn_compile.report.sections import build
from locsnn_compile.spinnaker.document import (
    NO_TABLE,
    REAL_TIME,
    OwnScale,
    ProvenRange,
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
    "sends once a step at most, as is proven below. Weights that take more than 16 bits then are stored rounded. Where "
    "two numbers are given, they are the smallest and the largest, or excitation and inhibition."
)
_RANGE_PROOF = (
    "Proven from the stored integers of each population, for any input in which a source spikes at "
    "most so often: no ring buffer can saturate, and no current, drive, goal or potential can wrap. A "
    "source cannot spike more than once in a step of 1 ms, so 1,000 a second is every input. Shares "
    "are of the limits, reached at worst. Not proven is that a board keeps up: late spikes and "
    "dropped synapses are counted by the board alone."
)
_OWN_SCALE = (
    "Weights are stored in units of 2^(shift - 15) nA. The program tells sPyNNaker the largest sum of "
    "weights that a step can bring, which gives its shifts. Left to itself, sPyNNaker takes the "
    "largest weight times the most synapses of a neuron or, where delays differ, an estimate from "
    "sources that send 30 spikes a second and five standard deviations."
)


def compose_spinnaker(report: SpinnakerFigures) -> Report:
    """Return the whole report."""
    page = FamilyPage(
        lowering=f"strategy {report.strategy}",
        costs=costs_verdict(
            report,
            answer="Energy not known",
            sentence=f"Energy is not known, because {NO_TABLE}.",
            first_facts=(Fact("real time", time(report.latency.per_sample_ns)),),
        ),
        fits=_fits(report),
        worst=worst_verdict(
            figure=time(report.latency.per_sample_ns),
            figure_label="per recording, if the board keeps up",
            sentence=f"{REAL_TIME[0].upper()}{REAL_TIME[1:]}. Whether a board keeps up with the "
            "busiest step is not known: there is no bound on its time.",
        ),
        not_known={
            "worst time": "whether a board finishes the busiest step in 1 ms",
            "energy": NO_TABLE,
            "on a board": "the arithmetic ran in an emulator; nothing ran on a board",
        },
        notices=_notices(report.match),
        sections=(
            _integers(report),
            operations_section(report.operations, _OPERATIONS),
            limits_section(report, of_a_core="; of a limit of a core, its fullest core"),
            build.left_out(report),
            numbers_section(report.quantization, SpinnakerNumbers, _NUMBERS, _number),
            _range_proof(report),
            _own_scale(report),
            provenance_section(report, KEEP_IN_MIND),
        ),
    )
    return compose_page(report, page, report.host)


def _fits(report: SpinnakerFigures) -> Verdict:
    limit = report.resources.limits["cores"]
    cores = f"{count(limit.used)} of {plural(limit.limit, 'core')}"
    taker = "The largest phase of the program"
    return fits_verdict(report, cores, taker, besides=", besides sources and monitors")


def _notices(match: MatchFigures) -> tuple[Notice, ...]:
    """Return the notices that only SpiNNaker has: about registers that wrapped and ring buffers that saturated."""
    notices = []
    if match.wraps:
        text = (
            f"Numbers left their 32 bits {plural(match.wraps, 'time')} and kept the rest. What the "
            "neuron does after that says little about the float network."
        )
        notices.append(Notice("Registers wrapped.", text))
    if match.clips:
        text = f"Ring buffers of 16 bits were full {plural(match.clips, 'time')}, and lost what came on top."
        notices.append(Notice("Ring buffers saturated.", text))
    return tuple(notices)


def _number(key: str, value: object) -> str:
    """Return a number of :class:`SpinnakerNumbers` as text."""
    if key == "current_decay_error":
        # A very small share, which would be 0 % otherwise.
        return f"{value:.2g}"
    if isinstance(value, tuple) and key == "largest_sums_na":
        # Whole nA are exact enough.
        return ", ".join(count(largest_sum) for largest_sum in value)
    return any_value(value)


def _integers(report: SpinnakerFigures) -> Section:
    """Return the section that compares the program with the integers that it was made from."""
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


def _range_proof(report: SpinnakerFigures) -> Section:
    """Return the section on the rates up to which nothing can overflow."""
    rows = tuple((name, *_proven_cells(proven)) for name, proven in report.range_proof.items())
    columns = (
        "population",
        *("proven up to, spikes a second", "ring buffer", "current", "potential"),
    )
    title = "What cannot overflow"
    return Section("range-proof", title, _RANGE_PROOF, (Table(title, columns, rows),))


def _proven_cells(proven: ProvenRange) -> tuple[Cell, ...]:
    """Return the cells of a population: the rate that is proven, then the shares of limits."""
    rate = "nothing"
    if proven.safe_period:
        # Rounded down: what is proven for a third of 1,000 is not proven for 334.
        rate = count(math.floor(proven.events_per_second))
    shares = (proven.ring_share, proven.current_share, proven.potential_share)
    return (rate, *map(share, shares))


def _own_scale(report: SpinnakerFigures) -> Section:
    """Return the section on what sPyNNaker's own choice of shifts would cost."""
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
    """Return the row of a population; ``shifts`` are those of the program."""
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
