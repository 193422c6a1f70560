"""What a device has left with the open core placed on it, and what that changes of the answers."""

from dataclasses import replace

from locsnn_compile.report.content import Bar, Fact, Facts, Section, Table, Verdict
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.placed import PlacedFigures
from locsnn_compile.report.format import count, plural, share, time

KEY = "device"
RESOURCES = {
    "luts": "LUTs",
    "flip_flops": "flip-flops",
    "block_rams": "block RAM",
    "multipliers": "multipliers",
}


def placed_section(placed: PlacedFigures | None) -> Section | None:
    """Return the cells and the clock of the device; None if nothing was placed."""
    if placed is None or placed.fmax_mhz is None:
        return None
    rows = []
    for kind, part in placed.shares.items():
        bar = Bar(part, f"{share(part)} used")
        used, available = count(placed.used[kind]), count(placed.available[kind])
        rows.append((RESOURCES[kind], bar, used, available, share(part)))
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
    """Return the clock of the bitstream, and of how many placements it is the fastest."""
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
    fullest = next(iter(placed.shares.items()), None)
    if fullest is None:
        return None
    kind, part = fullest
    return f"{RESOURCES[kind]}, {share(part)}"


def with_board(verdict: Verdict, report: ReportFigures) -> Verdict:
    """Return the answer to whether the program fits, with what a board adds to it."""
    placed = report.placed
    if placed is None:
        return verdict
    added = Facts.of({"fullest resource": _fullest(placed), "clock": _clock_on_board(placed)})
    verdict = replace(verdict, facts=(*verdict.facts, *added.facts))
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
    return replace(
        verdict,
        status="no",
        answer="No",
        figure="no room",
        figure_label=f"on the device of {placed.board}",
        sentence=f"The core of {placed.device} cannot be placed on {placed.board}: {lacking}.",
    )


def _too_slow(verdict: Verdict, placed: PlacedFigures) -> Verdict:
    wanted = f"{placed.core_mhz:g} MHz"
    reached = f"{placed.fmax_mhz:.1f} MHz"
    return replace(
        verdict,
        status="no",
        answer=f"Not at {wanted}",
        figure=reached,
        figure_label=f"of the {wanted} that {placed.board} gives it",
        sentence=f"The open core of {placed.device} holds the program, but its bitstream for "
        f"{placed.board} reaches {reached}, below the {wanted} of the board.",
    )


def at_clock_of_board(report: ReportFigures) -> Fact | None:
    """Return the times at the clock of a board, if it is another than that of the target."""
    placed = report.placed
    target_mhz = 1000 * report.latency.clock_ghz
    if placed is None or placed.device != report.target or placed.core_mhz == target_mhz:
        return None
    longer = target_mhz / placed.core_mhz
    times = f"the slowest recording takes {time(longer * report.latency.over_samples_ns.max)}"
    if report.bounds is not None:
        expected = report.bounds.expected
        events = plural(expected.events_per_step, "event")
        bound_ns = longer * expected.recording_ns.bound
        times += f", and none with up to {events} in a step takes more than {time(bound_ns)}"
    return Fact(f"at {placed.core_mhz:g} MHz", f"on {placed.board}, {times}")
