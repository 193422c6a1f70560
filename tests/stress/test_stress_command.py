"""``locsnn stress`` end to end: verdicts, JSON, and the page between its marks; and the cases of ``--quick``.

A case is a network with extreme numbers or inputs, and a row is a case with its verdict: ``ok``, ``limited`` (a limit of
the chip explains what was lost), ``refused`` (with a way out) or ``unexplained`` (a defect of this project).
"""

import csv
import json
from xml.etree import ElementTree

import pytest

import hw_model as hw
from locsnn_compile.cli.main import main
from locsnn_compile.stress import run as run_module
from locsnn_compile.stress.cases import GROUPS, LEADS, cases
from locsnn_compile.stress.cases.case import QUICK, long_runs
from locsnn_compile.stress.page import BEGIN, END
from locsnn_compile.stress.run import run_stress

CHIP = hw.chip("loihi-sim")


@pytest.fixture(scope="module")
def rows():
    """The rows of a quick run."""
    return run_stress(CHIP, quick=True)


@pytest.fixture
def few(monkeypatch):
    """A run of three rows: one ok, one limited, one refused."""
    names = {("one spike", "native"), ("tau_sr 0.001", "dendrite"), ("delay 63", "native")}
    three_cases = tuple(case for case in cases() if (case.name, case.strategy) in names)
    monkeypatch.setattr(run_module, "cases", lambda quick: three_cases)
    monkeypatch.setattr(run_module, "long_runs", list)


@pytest.mark.slow
def test_nothing_is_unexplained(rows):
    assert [row for row in rows if row.verdict == "unexplained"] == []
    assert {row.verdict for row in rows} == {"ok", "limited", "refused"}


@pytest.mark.slow
def test_every_group_has_a_row_and_a_lead(rows):
    groups = {*GROUPS} | {run.case.group for run in long_runs()}
    assert {row.case.group for row in rows} == groups == set(LEADS)


def test_the_rows_that_every_run_has_exist():
    names = {
        (case.group, case.strategy, case.name)
        for case in (*cases(), *(run.case for run in long_runs()))
    }
    quick_names = set()
    for group, names_by_strategy in QUICK.items():
        for strategy, names_of_strategy in names_by_strategy.items():
            quick_names |= {(group, strategy, name) for name in names_of_strategy}
    assert quick_names <= names


def test_cases_have_names_of_their_own():
    names = [(case.group, case.name, case.strategy) for case in cases()]
    assert len(names) == len(set(names))
    assert len(names) > 400  # so that no group of cases is lost unnoticed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("group", "name", "strategy", "verdict", "cause"),
    [
        ("time constants", "tau_sr 0.5", "dendrite", "ok", ""),
        (
            "time constants",
            "tau_sr 10000",
            "dendrite",
            "refused",
            "(10000 steps against at most 8191)",
        ),
        (
            "time constants",
            "leak of 1000 steps",
            "native",
            "limited",
            "a decay of 4.094 in 4096 is 4",
        ),
        ("decays at the ends of the grid", "decay_u 0, decay_v 4095", "native", "ok", ""),
        (
            "weights against the threshold",
            "weights times 1e-6",
            "native",
            "limited",
            "24 of 24 weights round to 0",
        ),
        (
            "weights against the threshold",
            "weights times 1e+6",
            "native",
            "refused",
            "Train with smaller weights",
        ),
        ("weight bits", "7 bits", "dendrite", "refused", "Choose one of 1, 2, 3, 4, 5, 6, 8."),
        ("extreme floats", "theta 5e-324", "dendrite", "refused", "Give it in other units."),
        ("extreme floats", "weights 5e-324", "native", "limited", "24 of 24 weights round to 0"),
        ("extreme floats", "weights nan", "native", "refused", "a weight is not a finite number"),
        ("inputs", "none", "dendrite", "ok", ""),
        ("inputs", "every step", "dendrite", "ok", ""),
        ("crowds of inputs", "4096 inputs excite, exponent 7", "native", "limited", "19 wraps"),
        ("potentials at the threshold", "integrator, 3 spikes, rule >=", "native", "ok", ""),
        (
            "potentials at the threshold",
            "peak of a kernel of 1",
            "dendrite",
            "limited",
            "4 potentials exactly at the",
        ),
        ("refractory counts", "count 63", "native", "ok", ""),
        ("refractory counts", "count 64", "native", "refused", "(64 against 1..63)"),
        ("biases", "bias 1e-09 thresholds", "native", "limited", "4 of 4 biases round to 0"),
        ("delays", "delay 62", "dendrite", "ok", ""),
        (
            "delays",
            "delay 63",
            "dendrite",
            "refused",
            "(63 against 0..62 steps; 6 of 6 delays outside)",
        ),
        ("a million steps", "leak of 10 steps", "native", "ok", ""),
    ],
)
def test_a_case_has_its_verdict_and_a_cause_with_these_words(
    rows, group, name, strategy, verdict, cause
):
    row_of_case = {(row.case.group, row.case.name, row.case.strategy): row for row in rows}
    row = row_of_case[group, name, strategy]
    assert row.verdict == verdict
    assert cause in "; ".join(row.causes)


@pytest.mark.slow
def test_scale_is_all_that_differs_over_twelve_orders_of_magnitude(rows):
    """Threshold and weights are scaled together, so spikes and errors in thresholds depend on the strategy alone."""
    scaled_rows = [row for row in rows if row.case.group == "threshold and weights together"]
    strategies = {row.case.strategy for row in scaled_rows}
    results = {
        (row.measured.spikes, round(row.measured.error_thresholds, 9)) for row in scaled_rows
    }
    assert len(scaled_rows) >= 4
    assert len(results) == len(strategies)


@pytest.mark.slow
def test_refusals_are_one_line_with_a_way_out(rows):
    for row in rows:
        if row.verdict == "refused":
            (line,) = row.causes
            assert "\n" not in line
            assert line.endswith(".")
            # What is wrong is one sentence, and what to do another.
            assert line.count(". ") >= 1


def test_verdicts_are_printed(few, capsys):
    assert main(["stress"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines] == [
        ["rows", "ok", "limited", "refused", "unexplained"],
        ["extreme", "floats", "1", "0", "1", "0", "0"],
        ["inputs", "1", "1", "0", "0", "0"],
        ["delays", "1", "0", "0", "1", "0"],
        ["all", "3", "1", "1", "1", "0"],
    ]


def test_json_has_every_figure(few, capsys):
    assert main(["stress", "--json", "--quick"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == 1
    assert document["target"] == "loihi-sim"
    assert document["verdicts"] == {"ok": 1, "limited": 1, "refused": 1, "unexplained": 0}
    limited, ok, refused = document["rows"]
    assert limited["causes"] == ["24 of 24 weights round to 0"]
    assert limited["measured"]["weights"] == {"lost": 24, "of": 24}
    assert (ok["case"], ok["strategy"], ok["weight_bits"], ok["causes"]) == (
        "one spike",
        "native",
        8,
        [],
    )
    assert 0 < ok["measured"]["error_thresholds"] <= ok["measured"]["bound_thresholds"]
    assert refused["measured"] is None
    assert refused["causes"][0].startswith("synapses 'touch' -> 'n': a delay is out of range")


def test_weights_are_as_wide_as_the_chip_holds(few, tmp_path, capsys):
    """A chip of 4 bits refused every case of 8, so that nothing was put under stress."""
    narrow = tmp_path / "narrow.yaml"
    narrow.write_text(CHIP.document.replace("  delay_max:", "  weight_bits_max: 4\n  delay_max:"))
    assert main(["stress", "--json", "--quick", "--target", str(narrow)]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert [(row["verdict"], row["weight_bits"]) for row in rows] == [
        ("limited", 4),
        ("ok", 4),
        ("refused", 4),
    ]


def test_a_defect_is_exit_code_3(few, monkeypatch, capsys):
    monkeypatch.setattr(run_module, "measure", lambda case, chip: 1 / 0)
    assert main(["stress"]) == 3
    lines = capsys.readouterr().out.splitlines()
    assert (
        "unexplained: inputs, one spike, native: crash: ZeroDivisionError: division by zero"
        in lines
    )


def test_the_page_is_written_between_its_marks(few, tmp_path, capsys):
    page = tmp_path / "stress.md"
    page.write_text(f"# Ours\n\nbefore\n\n{BEGIN}\nold\n{END}\n\nafter\n")
    assert main(["stress", "-o", str(page)]) == 0
    text = page.read_text()
    assert text.startswith(f"# Ours\n\nbefore\n\n{BEGIN}\n3 rows on loihi-sim.\n")
    assert text.endswith(f"{END}\n\nafter\n")
    assert "old" not in text
    rows = list(csv.DictReader(page.with_suffix(".csv").read_text().splitlines()))
    assert [
        row["verdict"] for row in rows if (row["case"], row["strategy"]) == ("one spike", "native")
    ] == ["ok"]
    assert len(rows) == 3
    assert main(["stress", "-o", str(page)]) == 0
    assert page.read_text() == text


@pytest.mark.slow
def test_a_new_page_and_its_pictures(rows, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("locsnn_compile.cli.stress.run_stress", lambda chip, quick, progress: rows)
    page = tmp_path / "new" / "numbers.md"
    page.parent.mkdir()
    assert main(["stress", "-o", str(page)]) == 0
    text = page.read_text()
    assert text.startswith(f"# Numerical stress\n\n{BEGIN}\n{len(rows)} rows on loihi-sim.\n")
    for name in ("time-constants", "weights", "long-runs"):
        assert f"(images/numbers-{name}.svg)" in text
        ElementTree.parse(page.parent / "images" / f"numbers-{name}.svg")
    assert len(page.with_suffix(".csv").read_text().splitlines()) == 1 + len(rows)


@pytest.mark.parametrize(
    ("content", "line"),
    [
        (b"# no place\n", f"page 'p.md': it has no place for the table. Put the lines {BEGIN} and {END} there, or give a new file.\n"),
        (f"{END}{BEGIN}".encode(), f"page 'p.md': it has no place for the table. Put the lines {BEGIN} and {END} there, or give a new file.\n"),
        (b"\xff\xfe\x00", "page 'p.md': it cannot be read (not text). Give a text file.\n"),
    ],
    ids=["no marks", "marks the wrong way", "no text"],
)  # fmt: skip
def test_pages_that_cannot_be_written_to_are_refused_first(
    monkeypatch, tmp_path, content, line, capsys
):
    monkeypatch.setattr("locsnn_compile.cli.stress.run_stress", None)  # it must not be called
    page = tmp_path / "p.md"
    page.write_bytes(content)
    assert main(["stress", "-o", str(page)]) == 2
    assert capsys.readouterr() == ("", line.replace("'p.md'", repr(str(page))))
    assert page.read_bytes() == content


def test_an_unknown_chip(capsys):
    assert main(["stress", "--target", "loihi"]) == 2
    assert capsys.readouterr().err == (
        "target 'loihi': no chip of this name ships. Did you mean 'loihi-sim'? A chip file of your own ends in .yaml.\n"
    )


def test_help_shows_an_example(capsys):
    with pytest.raises(SystemExit) as caught:
        main(["stress", "--help"])
    assert caught.value.code == 0
    assert "example:\n  locsnn stress --quick\n" in capsys.readouterr().out


def test_a_page_of_the_name_of_its_table_is_refused(tmp_path, capsys):
    assert main(["stress", "-o", str(tmp_path / "p.csv")]) == 2
    assert capsys.readouterr().err == (
        f"page {str(tmp_path / 'p.csv')!r}: the table next to the page has this name. Give the page another, such as .md.\n"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["p.csv", "images/p-long-runs.svg"])
def test_files_next_to_a_new_page_are_not_overwritten(name, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("locsnn_compile.cli.stress.run_stress", None)  # it must not be called
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("mine")
    page = tmp_path / "p.md"
    assert main(["stress", "-o", str(page)]) == 2
    line = f"page {str(page)!r}: {name!r} next to it would be replaced, but belongs to no page. Give the page another name.\n"
    assert capsys.readouterr() == ("", line)
    assert (tmp_path / name).read_text() == "mine"
