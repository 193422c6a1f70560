"""``locsnn diff``: compare two builds.

Compare the reports and programs of two builds: does it match as well, cost less, use fewer resources?

example:
  locsnn diff build/objects-hybrid build/objects-hybrid-4bit --html diff.html

With --events both programs play recordings, and their spikes are compared by population. They may be for chips that
compute in different ways.
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hw_model.io.arguments import check_path
from hw_model.io.files import parsing, read_bytes, replace_file
from hw_model.io.folders import finish_writing
from hw_model.targets.programs import AnyProgram, load_any_program
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import terminal
from locsnn_compile.emitters import BUILD_NAMES
from locsnn_compile.errors import InputError, check_same, listed
from locsnn_compile.report.figures.any_program import any_program_figures
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.renderers.terminal import render_terminal
from locsnn_compile.report.sections.builds import (
    Build,
    Change,
    changes,
    contents_changed,
    percent,
)
from locsnn_compile.report.sections.comparison import comparison

if TYPE_CHECKING:
    from locsnn_compile.verification.both_programs import ProgramsCompared

MAX_REPORT_BYTES = 64 << 20
"""Of report.json. A damaged or hostile file must not fill the memory; usual reports take far less."""


def run(args: argparse.Namespace) -> int:
    """Print the summary, or every figure that differs, with the change in percent if both are numbers."""
    if args.html:
        _check_html_place(args)
    before_folder = Path(args.before)
    after_folder = Path(args.after)
    # Both reports before the programs: a folder without a report is not a build, which is the
    # likelier mistake and the quicker check.
    before_report = read_report(before_folder)
    after_report = read_report(after_folder)
    before_program = load_any_program(before_folder)
    after_program = load_any_program(after_folder)
    before = _build(before_folder, before_report, before_program)
    after = _build(after_folder, after_report, after_program)
    changed = changes(before, after)
    played = None
    if args.events:
        played = _play_both(before_program, after_program, args.events)
    if args.html:
        page = render_html(comparison(before, after, played))
        replace_file(Path(args.html), page.encode(), where=f"--html {args.html!r}")
    if args.json:
        print(json.dumps(_document(changed, played), indent=2))
    elif not changed:
        print("The builds are equal.")
    elif parts := contents_changed(changed):
        print(f"All figures are equal, but not the programs: they differ in {listed(parts)}.")
    elif args.all:
        _print_changes(changed)
    else:
        render_terminal(comparison(before, after, played), terminal())
        print("\n--all lists every figure that changed.")
    return 0


def _check_html_place(args: argparse.Namespace) -> None:
    """Refuse a page that would replace a file of one of the builds."""
    inputs: dict[str, Path] = {}
    for option, folder in (("BUILD_A", args.before), ("BUILD_B", args.after)):
        for name in BUILD_NAMES:
            inputs[f"{option}, {name}"] = Path(folder) / name
    check_places(inputs, [(f"--html {args.html!r}", Path(args.html))])


def _print_changes(changed: Mapping[str, Change]) -> None:
    """Print a line for each figure that differs: its key, both values, and the change in percent."""
    for key, (before, after) in changed.items():
        change = percent(before, after)
        in_brackets = f" ({change})" if change else ""
        print(f"{key}: {before} -> {after}{in_brackets}")


def _play_both(before: AnyProgram, after: AnyProgram, events: str) -> "ProgramsCompared":
    """Play recordings to both programs; the first one determines their steps and channels."""
    # Imported here, because most comparisons play nothing.
    from locsnn_compile.cli.players import expected_by
    from locsnn_compile.data.read import read_recordings
    from locsnn_compile.verification.both_programs import compare_programs

    return compare_programs(before, after, read_recordings(events, model=expected_by(before)))


def _document(changed: Mapping[str, Change], played: "ProgramsCompared | None") -> dict[str, Any]:
    """Return what ``--json`` prints: each figure that differs and, if any were played, the spikes."""
    document: dict[str, Any] = {
        key: {"before": before, "after": after} for key, (before, after) in changed.items()
    }
    if played is not None:
        document["played"] = _played_document(played)
    return document


def _played_document(played: "ProgramsCompared") -> dict[str, Any]:
    """Return the spikes of both programs by population, and how many of them both sent."""
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
    """Return a build as the comparison takes it; refuse a report that is of another program."""
    figures = any_program_figures(program)
    # The absolute path has a name even if the folder is given as "." or "..".
    build = Build(folder.absolute().name, report, plain(figures))
    # A report without this figure is not refused for it.
    reported_synapses = build.figures.get("resources.synapses", figures.synapses)
    what = "report.json counts other synapses than the program has"
    where = f"build {build.name!r}"
    check_same(reported_synapses, figures.synapses, where, what, fix="Compile again.")
    return build


def read_report(folder: Path) -> dict[str, Any]:
    """Return report.json of a build; ``InputError`` if it cannot be read or is not a report."""
    check_path(folder, f"build {folder.name[:60]!r}")
    # If a writer of the folder was killed halfway, what it left there is put in place first.
    finish_writing(folder)
    where = f"build {folder.name!r}"
    fix = "Give a folder that locsnn-compile wrote."
    content = read_bytes(
        folder / "report.json", f"{where}, report.json", MAX_REPORT_BYTES, fix, fix
    )
    with parsing(where, "report.json is damaged", fix=fix):
        document = json.loads(content)
    # The number after the slash is the version of the schema: other versions are still reports.
    is_report = isinstance(document, dict) and str(document.get("schema", "")).startswith(
        "locsnn-report/"
    )
    if not is_report:
        raise InputError(where, "report.json is not a report", fix=fix)
    report: dict[str, Any] = document
    return report
