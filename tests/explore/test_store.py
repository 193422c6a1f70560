"""The store of measured points gives back what was written, and treats any damaged file as missing."""

import json

import pytest

from locsnn_compile.cluster.spread import code_version
from locsnn_compile.errors import TargetError
from locsnn_compile.explore import sweep as store_module
from locsnn_compile.explore.point import Point, digest_of
from locsnn_compile.explore.sweep import Store
from locsnn_compile.explore.timing import Timing
from locsnn_compile.settings import Setting
from tests.support.explored_model import explore, figures, lasting, point

KEY = "0" * 64
POINTS = {
    "figures": point(found=figures(0.1 + 0.2, 1 / 3), timings={"fast": Timing(16, 1e-3 / 3)}),
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


def test_there_is_none_at_first(store):
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
        lambda text: " " * (2 << 20),
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
def test_a_damaged_point_is_none(store, damage):
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
def test_what_has_the_right_sum_and_is_not_a_point_is_none(store, change):
    stored = POINTS["figures"]
    store.write(KEY, stored)
    path = store.folder / f"{KEY}.json"
    document = json.loads(path.read_text())
    change(document["point"])
    path.write_text(json.dumps(document | {"sha256": digest_of(document["point"])}))
    assert store.read(KEY, stored.setting) is None


def test_a_point_of_another_setting_or_code_is_none(store, monkeypatch):
    stored = POINTS["figures"]
    store.write(KEY, stored)
    assert store.read(KEY, Setting("reset", *stored.setting.values[1:])) is None
    monkeypatch.setattr(store_module, "code_version", lambda: "2+code")
    assert store.read(KEY, stored.setting) is None


def test_corrupt_points_are_measured_again(model, events, tmp_path):
    arguments = (model, "--events", events, "--strategy", "reset", "--weight-bits", 4, 8, "--engines", "-o", tmp_path / "out", "--quiet")  # fmt: skip
    assert explore(*arguments) == 0
    before = lasting(tmp_path / "out")
    whole = {path: path.read_bytes() for path in (tmp_path / "out/points").iterdir()}
    first = next(iter(whole))
    first.write_bytes(whole[first][:100])
    assert explore(*arguments) == 0
    assert lasting(tmp_path / "out") == before
    assert first.read_bytes() == whole[first]


def test_the_code_has_a_version_and_a_digest():
    number, digest = code_version().split("+")
    assert number
    assert len(digest) == 12
