"""All cases of ``locsnn stress`` with their verdicts, including runs of a million steps: this takes minutes.

The verdicts must be those of the table in the documentation.
"""

import csv
import itertools
import json
from pathlib import Path

import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.errors import LocsnnError
from locsnn_compile.passes.rounding.task import FINE
from locsnn_compile.report.compose import compose
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.renderers.markdown import render_markdown
from locsnn_compile.settings import NATIVE
from locsnn_compile.stress.cases import cases
from locsnn_compile.stress.run import run_stress

pytestmark = pytest.mark.minutes
PAGE = Path(__file__).parents[2] / "docs/research/numerics.md"


def rows_of_table():
    """Return (case, strategy, verdict) of the table next to the page."""
    with PAGE.with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        return [(row["case"], row["strategy"], row["verdict"]) for row in csv.DictReader(file)]


def test_every_row_is_explained_and_in_the_table():
    rows = run_stress(hw.chip("loihi-sim"))
    assert [row for row in rows if row.verdict == "unexplained"] == []
    computed = [(row.case.name, row.case.strategy, row.verdict) for row in rows]
    assert rows_of_table() == computed


@pytest.mark.parametrize("group", list(dict.fromkeys(case.group for case in cases())))
def test_reports_of_all_cases_hold_finite_numbers(group):
    for case in a_case_of_each_name(group):
        strategy = "auto" if case.strategy == NATIVE else case.strategy
        try:
            compiled = lc.compile(
                case.network,
                strategy=strategy,
                weight_bits=case.weight_bits,
                events=case.recordings,
            )
        except LocsnnError:
            continue
        json.dumps(compiled.report, allow_nan=False)
        assert render_markdown(compose(compiled.figures))
        assert render_html(compose(compiled.figures))


def a_case_of_each_name(group):
    """Return a case of each name in a group, of those that are rounded as the command rounds.

    Cases of a name differ in their strategy alone, and strategies take turns.
    """
    cases_by_name = {}
    for case in cases():
        if case.group == group and case.rounding == FINE:
            cases_by_name.setdefault(case.name, []).append(case)
    turn = itertools.count()
    chosen = []
    for same_name in cases_by_name.values():
        strategy = next(turn) if len(same_name) > 1 else 0
        chosen.append(same_name[strategy % len(same_name)])
    return chosen
