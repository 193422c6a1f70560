"""``locsnn diff``: compare two builds.

Compare the reports and programs of two builds: does it match as well, cost less, use fewer resources?

example:
  locsnn diff build/objects-hybrid build/objects-hybrid-4bit --html diff.html

With --events both programs play recordings, and their spikes are compared by population. They may be for chips that
compute in different ways.
"""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.io.files import parsing, read_bytes, replace_file
from hw_model.io.folders import finish_writing
from hw_model.io.given import check_path
from hw_model.targets.programs import AnyProgram, load_any_program
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import terminal
from locsnn_compile.emitters import BUILD_NAMES
from locsnn_compile.errors import InputError, check_same, listed
from locsnn_compile.report.figures.any_program import any_program_figures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.renderers.terminal import render_terminal
from locsnn_compile.report.sections.builds import Build, changes, contents_changed, percent
from locsnn_compile.report.sections.comparison import comparison

if TYPE_CHECKING:
    from locsnn_compile.verification.both_programs import ProgramsCompared

MAX_REPORT_BYTES = 64 << 20


def run(args: argparse.Namespace) -> int:
    """Print the summary, or every figure that differs, with the change in percent if both are numbers."""
    if args.html:
        builds = (("BUILD_A", args.before), ("BUILD_B", args.after))
        reads = {
            f"{option}, {name}": Path(folder) / name
            for option, folder in builds
            for name in BUILD_NAMES
        }
        check_places(reads, [(f"--html {args.html!r}", Path(args.html))])
    folders = (Path(args.before), Path(args.after))
    # Reports first: a folder without one is no build.
    reports = [read_report(folder) for folder in folders]
    programs = [load_any_program(folder) for folder in folders]
    before, after = map(_build, folders, reports, programs)
    changed = changes(before, after)
    played = _played(programs[0], programs[1], args.events) if args.events else None
    if args.html:
        page = render_html(comparison(before, after, played))
        replace_file(Path(args.html), page.encode(), where=f"--html {args.html!r}")
    if args.json:
        document: dict[str, Any] = {
            key: {"before": a, "after": b} for key, (a, b) in changed.items()
        }
        if played:
            document["played"] = _document(played)
        print(json.dumps(document, indent=2))
    elif not changed:
        print("The builds are equal.")
    elif parts := contents_changed(changed):
        print(f"All figures are equal, but not the programs: they differ in {listed(parts)}.")
    elif args.all:
        for key, (a, b) in changed.items():
            by = percent(a, b)
            print(f"{key}: {a} -> {b}{f' ({by})' if by else ''}")
    else:
        render_terminal(comparison(before, after, played), terminal())
        print("\n--all lists every figure that changed.")
    return 0


def _played(before: AnyProgram, after: AnyProgram, events: str) -> "ProgramsCompared":
    """Play recordings to both programs, which say how they are read."""
    # Only where something is played.
    from locsnn_compile.cli.players import expected_by
    from locsnn_compile.data.read import read_recordings
    from locsnn_compile.verification.both_programs import compare_programs

    return compare_programs(before, after, read_recordings(events, model=expected_by(before)))


def _document(played: "ProgramsCompared") -> dict[str, Any]:
    return {
        "source": played.source,
        "recordings": played.recordings,
        "same_classes": played.same_classes,
        "by_population": {
            name: {
                "before": match.reference_spikes,
                "after": match.chip_spikes,
                "equal": match.common_spikes,
            }
            for name, match in played.by_population.items()
        },
    }


def _build(folder: Path, report: dict[str, Any], program: AnyProgram) -> Build:
    figures = any_program_figures(program)
    build = Build(folder.absolute().name, report, plain(figures))
    counted = build.figures.get("resources.synapses", figures.synapses)
    what = "report.json counts other synapses than the program has"
    check_same(counted, figures.synapses, f"build {build.name!r}", what, fix="Compile again.")
    return build


def read_report(folder: Path) -> dict[str, Any]:
    """Return report.json of a build; ``InputError`` if it cannot be read or is not a report."""
    check_path(folder, f"build {folder.name[:60]!r}")
    finish_writing(folder)
    where, fix = f"build {folder.name!r}", "Give a folder that locsnn-compile wrote."
    content = read_bytes(
        folder / "report.json", f"{where}, report.json", MAX_REPORT_BYTES, fix, fix
    )
    with parsing(where, "report.json is damaged", fix=fix):
        document = json.loads(content)
    if not isinstance(document, dict) or not str(document.get("schema", "")).startswith(
        "locsnn-report/"
    ):
        raise InputError(where, "report.json is not a report", fix=fix)
    return document
