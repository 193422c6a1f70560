"""``locsnn diff``: what changed from one build to another."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from locsnn_compile.errors import InputError

_EXAMPLE = """\
example:
  locsnn diff build/objects-hybrid build/objects-hybrid-4bit
"""
MAX_REPORT_BYTES = 64 << 20
Figures = dict[str, Any]


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the ``diff`` command."""
    parser = subparsers.add_parser(
        "diff",
        help="compare the reports of two builds",
        description="Compare the reports of two builds, figure by figure; figures that are equal are left out.",
        epilog=_EXAMPLE,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("before", metavar="BUILD_A", help="folder that locsnn-compile wrote")
    parser.add_argument("after", metavar="BUILD_B", help="another one")
    parser.add_argument("--json", action="store_true", help="print the differences as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print every figure that differs, with its change in percent where both are numbers."""
    before, after = (flatten(read_report(Path(folder))) for folder in (args.before, args.after))
    changed = {
        key: {"before": before.get(key), "after": after.get(key)}
        for key in [*before, *(key for key in after if key not in before)]
        if before.get(key) != after.get(key)
    }
    if args.json:
        print(json.dumps(changed, indent=2))
        return 0
    for key, values in changed.items():
        print(f"{key}: {values['before']} -> {values['after']}{_percent(**values)}")
    if not changed:
        print("The reports are equal.")
    return 0


def read_report(folder: Path) -> Figures:
    """Return report.json of a build; anything else is an ``InputError``."""
    from hw_model.folders import finish_writing

    finish_writing(folder)
    path = folder / "report.json"
    where = f"build {folder.name!r}"
    fix = "Give a folder that locsnn-compile wrote."
    try:
        if path.stat().st_size > MAX_REPORT_BYTES:
            raise InputError(where, "its report.json is absurdly large", fix=fix)
        document = json.loads(path.read_bytes())
    except OSError as error:
        raise InputError(where, f"report.json cannot be read: {error.strerror}", fix=fix) from error
    except (ValueError, RecursionError) as error:
        raise InputError(where, "report.json is damaged", fix=fix) from error
    if not isinstance(document, dict) or not str(document.get("schema", "")).startswith("locsnn-report/"):
        raise InputError(where, "report.json is no report", fix=fix)
    return document


def flatten(value: object, key: str = "") -> Figures:
    """Return the leaves of nested values by dotted keys, in order; histograms are left to the reports."""
    if key.endswith("_histogram"):
        return {}
    if isinstance(value, dict):
        items = [(str(name), item) for name, item in value.items()]
    elif isinstance(value, list):
        items = [(str(index), item) for index, item in enumerate(value)]
    else:
        return {key: value}
    found: Figures = {}
    for name, item in items:
        found.update(flatten(item, f"{key}.{name}" if key else name))
    return found


def _percent(before: Any, after: Any) -> str:
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in (before, after))
    return f" ({100 * (after / before - 1):+.1f} %)" if numbers and before else ""
