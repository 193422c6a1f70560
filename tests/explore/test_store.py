"""The store of measured points gives back what was written, and treats any damaged file as missing.

``locsnn explore`` compiles a network with every combination (setting) of strategy, weight bits and other dials, and
measures each as a point. The store has a JSON file for each point.
"""

import json
from dataclasses import replace

import pytest

from locsnn_compile.cluster.spread import code_version
from locsnn_compile.errors import TargetError
from locsnn_compile.explore import sweep as store_module
from locsnn_compile.explore.point import Point, digest_of
from locsnn_compile.explore.sweep import MAX_BYTES, Store
from locsnn_compile.explore.timing import Timing
from tests.support.explored_model import explore, figures, files_without_timings, point

KEY = "0" * 64
"""Points are stored under a SHA-256 digest, of 64 digits; this one is made up."""
POINTS = {
    # Numbers that no short decimal equals: a rounded copy would differ.
    "figures": point(
        found=figures(spikes=0.1 + 0.2, predictions=1 / 3),
        timings={"fast": Timing(recordings=16, seconds=1e-3 / 3)},
    ),
    "refusal": point(
        refusal=vars(TargetError("layer 'a'", "too large", measured="2 against 1", fix="Cut it."))
    ),
}


@pytest.fixture
def store(tmp_path, monkeypatch):
    """A store whose points are measured by code of version ``1+code``."""
    monkeypatch.setattr(store_module, "code_version", lambda: "1+code")
    return Store(tmp_path / "points", Point)


@pytest.mark.parametrize("stored", POINTS.values(), ids=POINTS)
def test_a_point_comes_back_exactly(store, stored):
    store.write(KEY, stored)
    assert store.read(KEY, stored.setting) == stored
    assert [path.name for path in store.folder.iterdir()] == [f"{KEY}.json"]


def test_a_refusal_is_the_same_error_again():
    error = TargetError("layer 'a'", "too large", measured="2 against 1", fix="Cut it.")
    remade = point(refusal=vars(error)).refused
    assert (type(remade), str(remade)) == (
        TargetError,
        "layer 'a': too large (2 against 1). Cut it.",
    )


def test_an_empty_store_has_no_point(store):
    assert store.read(KEY, POINTS["figures"].setting) is None


def edited(change):
    """Return a function that changes the JSON document of a text."""

    def edit(text):
        document = json.loads(text)
        change(document)
        return json.dumps(document)

    return edit


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda text: "",
        lambda text: "[]",
        lambda text: "null",
        lambda text: "[" * 100_000,
        lambda text: text.replace("0.3", "0.4", 1),
        lambda text: text + " " * MAX_BYTES,  # valid JSON still, and too large
        edited(lambda d: d.pop("sha256")),
        edited(lambda d: d["point"].pop("figures")),
        edited(lambda d: d["point"]["figures"].update(energy_pj=1.0)),
        edited(lambda d: d.update(schema="locsnn-explore-point/2")),
    ],
    ids=[
        "cut",
        "empty",
        "list",
        "null",
        "deep",
        "digit",
        "huge",
        "no sum",
        "no figures",
        "other energy",
        "newer",
    ],
)
def test_a_damaged_point_counts_as_missing(store, damage):
    stored = POINTS["figures"]
    store.write(KEY, stored)
    path = store.folder / f"{KEY}.json"
    path.write_text(damage(path.read_text()))
    assert store.read(KEY, stored.setting) is None


@pytest.mark.parametrize(
    "change",
    [
        lambda point: point["figures"].update(energy_pj="much"),
        lambda point: point["figures"].update(colour=1.0),
        lambda point: point["timings"].update(fast=[1, 2]),
        lambda point: point.update(setting=None),
    ],
    ids=["a text for a number", "another key", "a list for a record", "no setting"],
)
def test_a_document_that_is_not_a_point_counts_as_missing_though_its_checksum_is_right(
    store, change
):
    stored = POINTS["figures"]
    store.write(KEY, stored)
    path = store.folder / f"{KEY}.json"
    document = json.loads(path.read_text())
    change(document["point"])
    path.write_text(json.dumps(document | {"sha256": digest_of(document["point"])}))
    assert store.read(KEY, stored.setting) is None


def test_a_point_of_another_setting_or_code_counts_as_missing(store, monkeypatch):
    stored = POINTS["figures"]
    store.write(KEY, stored)
    assert stored.setting.strategy == "dendrite"
    assert store.read(KEY, replace(stored.setting, strategy="reset")) is None
    monkeypatch.setattr(store_module, "code_version", lambda: "2+code")
    assert store.read(KEY, stored.setting) is None


def test_corrupt_points_are_measured_again(model, events, tmp_path):
    out = tmp_path / "out"
    grid = ["--strategy", "reset", "--weight-bits", 4, 8]
    time_no_engines = ["--engines"]  # without names; times would differ from run to run
    arguments = [model, "--events", events, *grid, *time_no_engines, "-o", out, "--quiet"]
    assert explore(*arguments) == 0
    files_before = files_without_timings(out)
    a_point = next((out / "points").iterdir())
    point_before = a_point.read_bytes()
    a_point.write_bytes(point_before[:100])
    assert explore(*arguments) == 0
    assert files_without_timings(out) == files_before
    assert a_point.read_bytes() == point_before


def test_the_code_has_a_version_and_a_digest():
    number, digest = code_version().split("+")
    assert number
    assert len(digest) == 12
