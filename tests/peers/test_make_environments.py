"""Making the peers' environments: done once, remade where the recipe changed, and a failure keeps its reason."""

from __future__ import annotations

import make_environments
import pytest


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setattr(make_environments, "ROOT", tmp_path / ".peers")
    monkeypatch.setattr(make_environments, "RECIPES", {"peer": ("--version",)})
    return tmp_path / ".peers"


def test_an_environment_that_was_not_made_says_how(root):
    assert make_environments.why_missing("peer") == "not made yet: run `make peers`"


def test_an_environment_that_cannot_be_made_keeps_the_reason(root, monkeypatch):
    monkeypatch.setattr(make_environments, "PYTHON", "python0.0")
    reason = make_environments.make("peer")
    assert reason == "cannot be made: [Errno 2] No such file or directory: 'python0.0'"
    assert make_environments.why_missing("peer") == reason


@pytest.mark.parametrize(
    ("stamp", "remade"),
    [("--version", False), ("--help", True)],
    ids=["same recipe", "another recipe"],
)
def test_an_environment_is_remade_for_another_recipe(root, monkeypatch, stamp, remade):
    (root / "peer").mkdir(parents=True)
    (root / "peer" / "recipe").write_text(stamp)
    assert make_environments.why_missing("peer") == (
        "made by another recipe: run `make peers`" if remade else None
    )
    calls = []
    monkeypatch.setattr(make_environments.subprocess, "run", lambda call, **_: calls.append(call))
    monkeypatch.setattr(make_environments.shutil, "rmtree", lambda *_, **__: None)
    assert make_environments.make("peer") is None
    assert bool(calls) == remade
    assert (root / "peer" / "recipe").read_text() == "--version"
