"""Names in a model file, or of the file itself, harm neither the page nor the files, whatever characters they have.

Names are markup, quotes, control characters, paths, formulas and very long texts. Builds run with them, and the results
are parsed with Python's own readers of HTML and CSV.
"""

from __future__ import annotations

import csv
import io
import json
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.io.build_folder import default_folder, write_build
from locsnn_compile.cli.compile import main
from locsnn_compile.emitters import LEVEL_KINDS
from tests.support.networks import hybrid, recordings

MODEL = Path(__file__).parents[2] / "examples/models/objects-hybrid.pt"
NAMES = {
    "script": "<script>alert(1)</script>",
    "quotes": "\"><img src=x onerror='alert(1)'>`",
    "newline": "two\nlines\r\x1b[31m\x00",
    "path": "../../x",
    "formula": "=HYPERLINK(1)",
    "other letters": "拇指 µ \u202e\udcff",
    "long": "n" * 10_000,
}


class Tags(HTMLParser):
    """The elements of a page, and the attributes that could load or run something."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.names: set[str] = set()
        self.dangerous_attributes: set[str] = set()
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.names.add(tag)
        self.dangerous_attributes |= {
            name for name, _ in attrs if name.startswith("on") or name in ("src", "style")
        }


def renamed(name):
    """Return a small network with this name, and with populations whose names begin with it."""
    network = hybrid(1, steps=40, hidden=6)
    new_names = {population.name: f"{name}{population.name}" for population in network.populations}
    populations = tuple(
        replace(population, name=new_names[population.name]) for population in network.populations
    )
    # The source of a projection may be an input, which keeps its name.
    projections = tuple(
        replace(
            projection,
            source=new_names.get(projection.source, projection.source),
            target=new_names[projection.target],
        )
        for projection in network.projections
    )
    readout = replace(
        network.readout,
        populations=tuple(new_names[population] for population in network.readout.populations),
    )
    return replace(
        network, name=name, populations=populations, projections=projections, readout=readout
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES.values(), ids=NAMES.keys())
def test_names_of_populations_do_no_harm(name, tmp_path):
    network = renamed(name)
    compiled = lc.compile(network, events=recordings(network))
    files = compiled.files([*LEVEL_KINDS, "csv"])
    page = files["report.html"].decode()
    assert len(page) < 2_000_000
    tags = Tags(page)
    assert not tags.names & {"script", "img", "iframe", "object"}
    assert not tags.dangerous_attributes
    # Control characters, and the one that turns the direction of text round.
    assert not set(page) & set("\x00\x1b\r\u202e")
    for table in ("figures", "spikes", "potential"):
        rows = list(csv.reader(io.StringIO(files[f"csv/{table}.csv"].decode())))
        assert {len(row) for row in rows} == {len(rows[0])}
        assert not [cell for row in rows for cell in row if cell.startswith(("=", "@"))]
    folder = tmp_path / "inside" / "build"
    write_build(folder, files)
    assert [path.name for path in tmp_path.iterdir()] == ["inside"]
    assert {
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    } == set(files)


@pytest.mark.parametrize(
    ("model", "folder"),
    [
        pytest.param("...pt", "build/model", id="two dots"),
        pytest.param("..pt", "build/model", id="one dot"),
        pytest.param("a/../../x.pt", "build/x", id="path"),
        pytest.param("two\nlines\x1b.pt", "build/two_lines_", id="newline"),
        pytest.param("a\\..\\b.pt", "build/a_.._b", id="backslashes"),
        pytest.param("<script>.pt", "build/<script>", id="script"),
        pytest.param("指.pt", "build/指", id="other letters"),
        pytest.param("\udcff.pt", "build/_", id="no letters"),
        pytest.param("n" * 10_000 + ".pt", f"build/{'n' * 200}", id="long"),
        pytest.param("指" * 100 + ".pt", f"build/{'指' * 66}", id="long in bytes"),
    ],
)
def test_the_name_of_a_model_file_gives_a_safe_folder(model, folder):
    assert str(default_folder(model)) == folder


@pytest.mark.parametrize(
    "name", ["...pt", "\"'<script>alert(1)<script>\n指.pt"], ids=["dots", "script"]
)
def test_a_model_file_with_a_bad_name_writes_only_its_build(name, tmp_path, monkeypatch, capsys):
    home = tmp_path / "home"
    home.mkdir()
    shutil.copy(MODEL, home / name)
    np.save(home / "few.npy", np.zeros((1, 78, 60), dtype=np.uint8))
    monkeypatch.chdir(home)
    assert main([name, "--events", "few.npy", "--strategy", "reset"]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"home"}
    assert {path.name for path in home.iterdir()} == {name, "few.npy", "build"}
    (build,) = (home / "build").iterdir()
    assert "\n" not in build.name
    assert "<script" not in (build / "report.html").read_text(encoding="utf-8")
    assert (
        json.loads((build / "report.json").read_text(encoding="utf-8"))["model"]["name"]
        == "objects-hybrid"
    )
