"""Making the peers' environments: done once, remade where the recipe changed, and a failure keeps its reason."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import make_environments
import pytest


@pytest.fixture
def root(tmp_path, monkeypatch):
    monkeypatch.setattr(make_environments, "ROOT", tmp_path / ".peers")
    monkeypatch.setattr(make_environments, "RECIPES", {"peer": ("--version",)})
    monkeypatch.setattr(make_environments, "PATCHES", {})
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


PATCH = make_environments.Patch("peer/module.py", sha256="", text="old", replacement="new")


def test_a_patch_changes_the_file_that_it_is_for(tmp_path):
    file = tmp_path / "peer/module.py"
    file.parent.mkdir()
    file.write_text("value = 'old'\n")
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    replace(PATCH, sha256=digest).apply(tmp_path)
    assert file.read_text() == "value = 'new'\n"


def test_a_patch_leaves_another_file_alone(root, monkeypatch):
    file = root / "peer/lib/python3.11/site-packages/peer/module.py"
    file.parent.mkdir(parents=True)
    file.write_text("value = 'old, and old'\n")
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    monkeypatch.setattr(make_environments, "PATCHES", {"peer": (replace(PATCH, sha256=digest),)})
    monkeypatch.setattr(make_environments.subprocess, "run", lambda *_, **__: None)
    monkeypatch.setattr(make_environments.shutil, "rmtree", lambda *_, **__: None)
    message = f"cannot be made: peer/module.py: is not the file that the patch is for ({digest})"
    assert make_environments.make("peer") == message
    assert file.read_text() == "value = 'old, and old'\n"
