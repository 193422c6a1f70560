"""Licence, citation, container, workflow and templates say what the project says elsewhere."""

from __future__ import annotations

import re
import tomllib

import pytest
import yaml

import locsnn_compile as lc
from tests.support.fences import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
DEVELOPERS = "the locsnn-compile developers"


def load(path):
    """A YAML file of the project."""
    return yaml.safe_load((ROOT / path).read_text("utf-8"))


def test_licence_and_authors():
    text = (ROOT / "LICENSE").read_text("utf-8")
    assert text.startswith(f"MIT License\n\nCopyright (c) 2026 {DEVELOPERS}\n")
    assert PROJECT["license"] == "MIT"
    assert PROJECT["license-files"] == ["LICENSE"]
    assert PROJECT["authors"] == [{"name": DEVELOPERS}]


def test_citation():
    found = load("CITATION.cff")
    assert found["authors"] == [{"name": DEVELOPERS}]
    assert found["version"] == lc.__version__
    assert found["license"] == "MIT"
    assert found["type"] == "software"
    assert set(found) >= {"cff-version", "message", "title"}


def test_the_container_is_made_of_files_that_are_there():
    text = (ROOT / "Dockerfile").read_text("utf-8")
    assert re.findall(r"^FROM (\S+)$", text, flags=re.MULTILINE) == ["python:3.12-slim-bookworm"]
    copied = [
        name
        for line in re.findall(r"^COPY (.*)$", text, flags=re.MULTILINE)
        for name in line.split()[:-1]
    ]
    kept = set((ROOT / ".dockerignore").read_text("utf-8").split())
    for name in copied:
        assert (ROOT / name).exists(), name
        assert f"!{name}" in kept, name
    assert {"pyproject.toml", "LICENSE", "hw_model", "locsnn_compile"} <= set(copied)
    assert "USER locsnn" in text


def test_every_supported_python_runs_the_tests():
    jobs = load(".github/workflows/test.yml")["jobs"]
    supported = [
        one.rpartition(" ")[2] for one in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", one)
    ]
    assert jobs["test"]["strategy"]["matrix"]["python"] == supported
    assert (
        PROJECT["requires-python"]
        == f">={supported[0]},<3.{int(supported[-1].partition('.')[2]) + 1}"
    )
    commands = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    targets = [found[1] for command in commands if (found := re.match(r"make ([a-z-]+)", command))]
    assert targets == ["test", "check-rest", "floors"]
    for target in targets:
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text("utf-8"), flags=re.MULTILINE)


def test_hooks_before_a_commit_are_those_of_make():
    (repo,) = load(".pre-commit-config.yaml")["repos"]
    rest = (ROOT / "Makefile").read_text("utf-8").replace("$(BIN)", ".venv/bin")
    for hook in repo["hooks"]:
        assert " ".join(hook["entry"].split()[:2]).replace(" check --fix", " check") in rest


@pytest.mark.parametrize(
    "path", sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.stem
)
def test_templates_of_issues(path):
    found = yaml.safe_load(path.read_text("utf-8"))
    if path.stem == "config":
        assert found == {"blank_issues_enabled": True}
        return
    assert set(found) == {"name", "description", "labels", "body"}
    ids = [part["id"] for part in found["body"]]
    assert len(ids) == len(set(ids))
    assert all(part["attributes"]["label"] for part in found["body"])


def test_hostile_files_have_a_page():
    page = (ROOT / "docs/explanation/security.md").read_text("utf-8")
    assert "Nothing in it is executed." in page
    assert "docs/explanation/security.md" in (ROOT / ".github/SECURITY.md").read_text("utf-8")
    assert "](../docs/explanation/security.md)" in (ROOT / ".github/SECURITY.md").read_text("utf-8")
