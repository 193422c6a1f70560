"""The report after ``locsnn rtl fit`` placed the open core on an FPGA: answers, section and report.json agree.

A small program is compiled for a device, and placements that were made up here are added to its written report. No
synthesis tool runs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import locsnn_compile as lc
from locsnn_compile.errors import InputError
from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Verdict
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.placed import PlacedFigures
from locsnn_compile.report.figures.typed import typed
from locsnn_compile.report.placed import WrittenReport
from locsnn_compile.report.renderers.html import verdicts_html
from locsnn_compile.report.renderers.markdown import verdicts_markdown
from tests.support.networks import hybrid, recordings

USED = {"luts": 20, "flip_flops": 31, "block_rams": 4, "multipliers": 2}
AVAILABLE = {"luts": 100, "flip_flops": 200, "block_rams": 5, "multipliers": 8}
PLACED = PlacedFigures(
    device="ecp5-25f",
    board="ulx3s-25f",
    core_mhz=100.0,
    used=USED,
    available=AVAILABLE,
    fmax_mhz=104.5,
    slowest_mhz=98.25,
    placement=2,
    placements=3,
)
WITHOUT_ROOM = PlacedFigures(
    device="ecp5-25f",
    board="my-board",
    core_mhz=50.0,
    used={},
    available={},
    fmax_mhz=None,
    slowest_mhz=None,
    placement=None,
    placements=3,
    lacking="60 of 56 block RAMs",
)
"""The core does not fit the device."""


@pytest.fixture(scope="module")
def files() -> Mapping[str, bytes]:
    """The report of a small program for a device."""
    network = hybrid()
    compiled = lc.compile(network, "ecp5-25f", events=recordings(network), strategy="dendrite")
    return {name: content for name, content in compiled.files().items() if "report" in name}


@pytest.fixture
def written(files: Mapping[str, bytes], tmp_path: Path) -> WrittenReport:
    return read(tmp_path, files)


def read(folder: Path, files: Mapping[str, bytes]) -> WrittenReport:
    """Write the files of a report, and read it as the commands do."""
    for name, content in files.items():
        (folder / name).write_bytes(content)
    report = WrittenReport.of(folder, json.loads(files["report.json"]))
    assert report is not None
    return report


def answer(files: Mapping[str, bytes], question: str) -> Verdict:
    """Return the answer to a question in report.json; both pages must show the same answers."""
    report = compose(typed(ReportFigures, json.loads(files["report.json"])))
    assert verdicts_html(report) in files["report.html"].decode()
    assert verdicts_markdown(report) in files["report.md"].decode()
    return next(verdict for verdict in report.verdicts if verdict.question == question)


def facts(verdict: Verdict) -> dict[str, str]:
    """Return the facts of a verdict by their labels."""
    return {fact.label: fact.value for fact in verdict.facts}


SECTION = """\
## On the device

What the open core takes of ecp5-25f, whatever program it holds.

- fullest resource: block RAM, 80.0 %
- clock: 104.5 MHz, the fastest of 3 placements (98.2 to 104.5 MHz)
- ulx3s-25f gives it: 100 MHz

**Cells of the device**

| resource | used | of | share |
| --- | ---: | ---: | ---: |
| block RAM | 4 | 5 | 80.0 % |
| multipliers | 2 | 8 | 25.0 % |
| LUTs | 20 | 100 | 20.0 % |
| flip-flops | 31 | 200 | 15.5 % |

"""


def test_a_board_that_keeps_its_clock_is_a_yes_with_the_clock(files, written) -> None:
    before = answer(files, "Does it fit?")
    after = written.with_placed(PLACED)
    fit = answer(after, "Does it fit?")
    assert (fit.status, fit.answer, fit.figure) == ("yes", "Yes", before.figure)
    assert fit.sentence == (
        f"{before.sentence} On ulx3s-25f its bitstream reaches 104.5 MHz, and the board runs it at 100 MHz."
    )
    assert facts(fit) == {
        **facts(before),
        "fullest resource": "block RAM, 80.0 %",
        "clock": "104.5 MHz, the fastest of 3 placements (98.2 to 104.5 MHz); ulx3s-25f gives it 100 MHz",
    }
    assert after["report.md"].decode().count(SECTION) == 1
    page = after["report.html"].decode()
    assert page.count('<h2 id="device">') == page.count('href="#device"') == 1
    assert json.loads(after["report.json"])["placed"] == {
        "device": "ecp5-25f",
        "board": "ulx3s-25f",
        "core_mhz": 100.0,
        "used": USED,
        "available": AVAILABLE,
        "fmax_mhz": 104.5,
        "slowest_mhz": 98.25,
        "placement": 2,
        "placements": 3,
    }


@pytest.mark.parametrize(
    ("placed", "status", "short_answer", "figure", "sentence"),
    [
        pytest.param(
            replace(PLACED, fmax_mhz=99.75),
            "no",
            "Not at 100 MHz",
            "99.8 MHz",
            "The open core of ecp5-25f holds the program, but its bitstream for ulx3s-25f reaches "
            "99.8 MHz, below the 100 MHz of the board.",
            id="clock below that of the board",
        ),
        pytest.param(
            WITHOUT_ROOM,
            "no",
            "No",
            "no room",
            "The core of ecp5-25f cannot be placed on my-board: 60 of 56 block RAMs.",
            id="no room on the device",
        ),
    ],
)
def test_a_board_that_does_not_run_the_core_is_a_no(
    written: WrittenReport,
    placed: PlacedFigures,
    status: str,
    short_answer: str,
    figure: str,
    sentence: str,
) -> None:
    fit = answer(written.with_placed(placed), "Does it fit?")
    assert (fit.status, fit.answer, fit.figure) == (status, short_answer, figure)
    assert fit.sentence == sentence


def test_a_board_for_another_target_changes_no_answer(files, written) -> None:
    before = answer(files, "Does it fit?")
    fit = answer(
        written.with_placed(replace(PLACED, device="ecp5-85f", fmax_mhz=80.0)), "Does it fit?"
    )
    assert (fit.status, fit.sentence) == ("yes", before.sentence)
    assert facts(fit)["clock"].startswith("80.0 MHz, the fastest of 3 placements")


def test_the_worst_time_is_also_said_at_the_clock_of_another_board(files, written) -> None:
    unchanged = answer(written.with_placed(PLACED), "How fast at worst?")
    assert unchanged == answer(files, "How fast at worst?")
    assert unchanged.sentence.startswith("The slowest recording takes 5.07 µs")
    slower = answer(written.with_placed(replace(PLACED, core_mhz=10.0)), "How fast at worst?")
    assert facts(slower)["at 10 MHz"] == (
        "on ulx3s-25f, the slowest recording takes 50.7 µs, and none with up to 3 events in a step "
        "takes more than 99.4 µs"
    )


def test_another_placement_replaces_the_one_before(files, tmp_path) -> None:
    first = read(tmp_path, files).with_placed(replace(PLACED, fmax_mhz=90.0))
    again = read(tmp_path, first).with_placed(PLACED)
    assert again == read(tmp_path, files).with_placed(PLACED)
    assert read(tmp_path, again).with_placed(None) == files


def test_pictures_of_a_recording_stay(files, written) -> None:
    marker = '<section class="section" aria-labelledby="spikes">'
    assert files["report.html"].decode().count(marker) == 1
    assert written.with_placed(PLACED)["report.html"].decode().count(marker) == 1


# A file, an edit of its text, and the error.
REFUSED: dict[str, tuple[str, Any, str]] = {
    "an answer that was edited": (
        "report.md",
        lambda text: text.replace("Does it fit?", "Fits?"),
        "report.md: it does not say what report.json says. Compile the model again.",
    ),
    "a page of another build": (
        "report.html",
        lambda text: text.replace('id="resources"', 'id="r"'),
        "report.html: it does not say what report.json says. Compile the model again.",
    ),
    "a document without a key": (
        "report.json",
        lambda text: text.replace('"weight_bits"', '"weight_bit"'),
        "report.json: unknown key 'weight_bit'. Did you mean 'weight_bits'?",
    ),
}


@pytest.mark.parametrize(("name", "edit", "message"), REFUSED.values(), ids=REFUSED)
def test_a_report_whose_files_disagree_is_refused(files, tmp_path, name, edit, message):
    edited = edit(files[name].decode())
    assert edited != files[name].decode()
    with pytest.raises(InputError) as caught:
        read(tmp_path, {**files, name: edited.encode()})
    assert str(caught.value) == message
