"""``locsnn stress``: try extreme numbers and inputs.

Compile and play networks with extreme numbers and inputs: time constants, thresholds, weights, floats, decays, delays,
a million steps. Every row is ok, limited by named and counted causes, or refused in one line. Anything else is
unexplained, and gives exit code 3.

example:
  locsnn stress --quick
"""

import argparse
from collections.abc import Iterator, Sequence

import hw_model as hw
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import EXIT_GATE, progress_bar, say
from locsnn_compile.stress.page import TABLE, check_page, write_page
from locsnn_compile.stress.row import VERDICTS, Row, by_verdict, stress_document
from locsnn_compile.stress.run import run_stress


def run(args: argparse.Namespace) -> int:
    """Run the rows; print a table of verdicts, or JSON, and write the page if asked to."""
    chip = hw.chip(args.target)
    if args.output is not None:
        option, reads = f"-o {str(args.output)!r}", {"--target": args.target}
        check_places(reads, [(option, args.output)])
        check_page(args.output)
        check_places(reads, [(option, args.output.with_suffix(TABLE))])
    with progress_bar("stress", show=True) as progress:
        rows = run_stress(chip, quick=args.quick, progress=progress)
    if args.output is not None:
        write_page(args.output, rows, chip)
    say(args, stress_document(rows, chip), _verdicts(rows))
    return EXIT_GATE if any(row.verdict == "unexplained" for row in rows) else 0


def _verdicts(rows: Sequence[Row]) -> Iterator[str]:
    """Yield a table of verdicts by group, and a line for each row that nothing explains."""
    groups = list(dict.fromkeys(row.case.group for row in rows))
    width = max(map(len, groups))
    yield f"{'':{width}}  {'rows':>5}  {'  '.join(f'{verdict:>11}' for verdict in VERDICTS)}"
    for group in [*groups, "all"]:
        counted = by_verdict(row for row in rows if group in (row.case.group, "all")).values()
        yield f"{group:{width}}  {sum(counted):5}  {'  '.join(f'{number:11}' for number in counted)}"
    for row in rows:
        if row.verdict == "unexplained":
            yield f"unexplained: {row.case.group}, {row.case.name}, {row.case.strategy}: {'; '.join(row.causes)}"
