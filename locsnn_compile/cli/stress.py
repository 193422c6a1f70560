"""``locsnn stress``: try extreme numbers and inputs.

Compile and play networks with extreme numbers and inputs: time constants, thresholds, weights, floats, decays, delays,
a million steps. Every row is ok, limited by named and counted causes, or refused in one line. Anything else is
unexplained, and gives exit code 3.

example:
  locsnn stress --quick
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse
from collections.abc import Iterable, Iterator, Sequence

import hw_model as hw
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import EXIT_GATE, print_result, progress_bar
from locsnn_compile.stress.page import TABLE, check_page, write_page
from locsnn_compile.stress.row import VERDICTS, Row, by_verdict, stress_document
from locsnn_compile.stress.run import run_stress

ALL_GROUPS = "all"
"""The last line of the table, which counts the rows of all groups."""


def run(args: argparse.Namespace) -> int:
    """Play all cases; print how many have each verdict, or JSON, and write the page if asked to.

    A row is one case with its verdict: a network with extreme numbers, how it was lowered, and what
    was played to it. Returns 3 if any row is unexplained.
    """
    chip = hw.chip(args.target)
    if args.output is not None:
        _check_output(args)
    with progress_bar("stress", show=True) as progress:
        rows = run_stress(chip, quick=args.quick, progress=progress)
    if args.output is not None:
        write_page(args.output, rows, chip)
    print_result(args, stress_document(rows, chip), _verdict_lines(rows))
    return EXIT_GATE if any(row.verdict == "unexplained" for row in rows) else 0


def _check_output(args: argparse.Namespace) -> None:
    """Refuse, before minutes of work, a page that cannot be written or would replace the chip file.

    The table next to the page is checked last: only a good name of the page gives it a name.
    """
    option = f"-o {str(args.output)!r}"
    inputs = {"--target": args.target}
    check_places(inputs, [(option, args.output)])
    check_page(args.output)
    check_places(inputs, [(option, args.output.with_suffix(TABLE))])


def _verdict_lines(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table of verdicts by group, and a line for each row that nothing explains."""
    groups = list(dict.fromkeys(row.case.group for row in rows))
    group_width = max(map(len, groups))
    headings = "  ".join(f"{verdict:>11}" for verdict in VERDICTS)  # as long as "unexplained"
    yield f"{'':{group_width}}  {'rows':>5}  {headings}"
    for group in groups:
        yield _count_line(group, group_width, (row for row in rows if row.case.group == group))
    yield _count_line(ALL_GROUPS, group_width, rows)
    for row in rows:
        if row.verdict == "unexplained":
            case = row.case
            causes = "; ".join(row.causes)
            yield f"unexplained: {case.group}, {case.name}, {case.strategy}: {causes}"


def _count_line(group: str, group_width: int, rows: Iterable[Row]) -> str:
    """Return a line of the table: the name of a group, its number of rows, and those by verdict."""
    counts = by_verdict(rows).values()
    cells = "  ".join(f"{count:11}" for count in counts)
    return f"{group:{group_width}}  {sum(counts):5}  {cells}"
