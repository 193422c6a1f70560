"""Show the FPGA (the device) on which ``locsnn rtl fit`` placed the open core.

The section lists which cells are used and which clock is reached. The device may also change the report's
answers: a program that fits the target does not fit a board whose device lacks room or is too slow.
"""

from dataclasses import replace

from locsnn_compile.report.content import Bar, Fact, Facts, Section, Table, Verdict
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.placed import PlacedFigures
from locsnn_compile.report.format import count, plural, share, time

KEY = "device"
"""The key of the section."""
RESOURCES = {
    "luts": "LUTs",
    "flip_flops": "flip-flops",
    "block_rams": "block RAM",
    "multipliers": "multipliers",
}
"""Kinds of cells, by their keys in report.json, in words."""


def placed_section(placed: PlacedFigures | None) -> Section | None:
    """Return the section on the cells and the clock of the device; None if the core was not placed on it."""
    if placed is None or placed.fmax_mhz is None:
        return None
    rows = []
    for kind, used_share in placed.shares.items():
        bar = Bar(used_share, f"{share(used_share)} used")
        used = count(placed.used[kind])
        available = count(placed.available[kind])
        rows.append((RESOURCES[kind], bar, used, available, share(used_share)))
    facts = {
        "fullest resource": _fullest(placed),
        "clock": clock_words(placed),
        f"{placed.board} gives it": f"{placed.core_mhz:g} MHz",
    }
    return Section.of(
        KEY,
        "On the device",
        f"What the open core takes of {placed.device}, whatever program it holds.",
        Facts.of(facts),
        Table("Cells of the device", ("resource", "", "used", "of", "share"), tuple(rows)),
    )


def clock_words(placed: PlacedFigures) -> str:
    """Return the clock that the bitstream reaches, and out of how many placements it is the fastest."""
    if placed.fmax_mhz is None or placed.slowest_mhz is None:
        return ""
    clock = f"{placed.fmax_mhz:.1f} MHz"
    if placed.placements == 1:
        return f"{clock}, of 1 placement"
    return (
        f"{clock}, the fastest of {plural(placed.placements, 'placement')} "
        f"({placed.slowest_mhz:.1f} to {placed.fmax_mhz:.1f} MHz)"
    )


def _fullest(placed: PlacedFigures) -> str | None:
    """Return the kind of cells that is used most, and its share; None for a device without known cells."""
    fullest = next(iter(placed.shares.items()), None)
    if fullest is None:
        return None
    kind, used_share = fullest
    return f"{RESOURCES[kind]}, {share(used_share)}"


def with_board(verdict: Verdict, report: ReportFigures) -> Verdict:
    """Return the verdict on whether the program fits, changed by what is known of a board."""
    placed = report.placed
    if placed is None:
        return verdict
    facts = Facts.of({"fullest resource": _fullest(placed), "clock": _clock_on_board(placed)})
    verdict = replace(verdict, facts=(*verdict.facts, *facts.facts))
    # A board for another target says nothing of the target of this report.
    if placed.device != report.target:
        return verdict
    if placed.lacking is not None:
        return _without_room(verdict, placed, placed.lacking)
    if not placed.keeps_clock:
        return _too_slow(verdict, placed)
    reached = (
        f"On {placed.board} its bitstream reaches {placed.fmax_mhz:.1f} MHz, and the board runs it "
        f"at {placed.core_mhz:g} MHz."
    )
    return replace(verdict, sentence=f"{verdict.sentence} {reached}")


def _clock_on_board(placed: PlacedFigures) -> str:
    reached = clock_words(placed)
    return f"{reached}; {placed.board} gives it {placed.core_mhz:g} MHz" if reached else ""


def _without_room(verdict: Verdict, placed: PlacedFigures, lacking: str) -> Verdict:
    """Return the verdict of a program whose core finds no room on the device of the board."""
    return replace(
        verdict,
        status="no",
        answer="No",
        figure="no room",
        figure_label=f"on the device of {placed.board}",
        sentence=f"The core of {placed.device} cannot be placed on {placed.board}: {lacking}.",
    )


def _too_slow(verdict: Verdict, placed: PlacedFigures) -> Verdict:
    """Return the verdict of a program whose bitstream cannot have the clock of the board."""
    board_clock = f"{placed.core_mhz:g} MHz"
    reached = f"{placed.fmax_mhz:.1f} MHz"
    return replace(
        verdict,
        status="no",
        answer=f"Not at {board_clock}",
        figure=reached,
        figure_label=f"of the {board_clock} that {placed.board} gives it",
        sentence=f"The open core of {placed.device} holds the program, but its bitstream for "
        f"{placed.board} reaches {reached}, below the {board_clock} of the board.",
    )


def at_clock_of_board(report: ReportFigures) -> Fact | None:
    """Return the times at the clock of the board; None if there is no board, or if it has the target's clock."""
    placed = report.placed
    target_mhz = 1000 * report.latency.clock_ghz
    if placed is None or placed.device != report.target or placed.core_mhz == target_mhz:
        return None
    # The cycles are the same at any clock.
    slowdown = target_mhz / placed.core_mhz
    slowest_ns = slowdown * report.latency.over_samples_ns.max
    times = f"the slowest recording takes {time(slowest_ns)}"
    if report.bounds is not None:
        expected = report.bounds.expected
        events = plural(expected.events_per_step, "event")
        bound_ns = slowdown * expected.recording_ns.bound
        times += f", and none with up to {events} in a step takes more than {time(bound_ns)}"
    return Fact(f"at {placed.core_mhz:g} MHz", f"on {placed.board}, {times}")
