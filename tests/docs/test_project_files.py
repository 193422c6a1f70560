"""Licence, citation, container, workflow and issue templates agree with ``pyproject.toml`` and the Makefile."""

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
    """Return the content of a YAML file of the project."""
    return yaml.safe_load((ROOT / path).read_text("utf-8"))


def test_licence_and_authors_are_those_of_pyproject():
    text = (ROOT / "LICENSE").read_text("utf-8")
    assert text.startswith(f"MIT License\n\nCopyright (c) 2026 {DEVELOPERS}\n")
    assert PROJECT["license"] == "MIT"
    assert PROJECT["license-files"] == ["LICENSE"]
    assert PROJECT["authors"] == [{"name": DEVELOPERS}]


def test_the_citation_names_authors_version_and_licence():
    citation = load("CITATION.cff")
    assert citation["authors"] == [{"name": DEVELOPERS}]
    assert citation["version"] == lc.__version__
    assert citation["license"] == "MIT"
    assert citation["type"] == "software"
    # The keys that the format requires, besides authors.
    assert set(citation) >= {"cff-version", "message", "title"}


def test_the_container_copies_files_that_exist_and_are_not_ignored():
    text = (ROOT / "Dockerfile").read_text("utf-8")
    assert re.findall(r"^FROM (\S+)$", text, flags=re.MULTILINE) == ["python:3.12-slim-bookworm"]
    copied = [
        name
        for line in re.findall(r"^COPY (.*)$", text, flags=re.MULTILINE)
        for name in line.split()[:-1]
    ]
    # .dockerignore leaves everything out but the paths after an exclamation mark.
    ignore_rules = set((ROOT / ".dockerignore").read_text("utf-8").split())
    for name in copied:
        assert (ROOT / name).exists(), name
        assert f"!{name}" in ignore_rules, name
    assert {"pyproject.toml", "LICENSE", "hw_model", "locsnn_compile"} <= set(copied)
    assert "USER locsnn" in text


def test_every_supported_python_runs_the_tests():
    jobs = load(".github/workflows/test.yml")["jobs"]
    supported = [
        classifier.rpartition(" ")[2]
        for classifier in PROJECT["classifiers"]
        if re.search(r":: 3\.\d+$", classifier)
    ]
    assert jobs["test"]["strategy"]["matrix"]["python"] == supported
    minor_of_newest = int(supported[-1].partition(".")[2])
    assert PROJECT["requires-python"] == f">={supported[0]},<3.{minor_of_newest + 1}"
    commands = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    calls_of_make = [re.match(r"make ([a-z-]+)", command) for command in commands]
    targets = [call[1] for call in calls_of_make if call]
    assert targets == ["test", "check-rest", "floors"]
    for target in targets:
        assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text("utf-8"), flags=re.MULTILINE)


def test_hooks_before_a_commit_run_the_tools_that_make_runs():
    (repo,) = load(".pre-commit-config.yaml")["repos"]
    makefile = (ROOT / "Makefile").read_text("utf-8").replace("$(BIN)", ".venv/bin")
    for hook in repo["hooks"]:
        program_and_command = " ".join(hook["entry"].split()[:2])
        assert program_and_command.replace(" check --fix", " check") in makefile


@pytest.mark.parametrize(
    "path", sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.stem
)
def test_issue_templates_have_the_fields_of_a_form(path):
    template = yaml.safe_load(path.read_text("utf-8"))
    if path.stem == "config":
        assert template == {"blank_issues_enabled": True}
        return
    assert set(template) == {"name", "description", "labels", "body"}
    ids = [field["id"] for field in template["body"]]
    assert len(ids) == len(set(ids))
    assert all(field["attributes"]["label"] for field in template["body"])


def test_the_security_policy_links_the_page_on_hostile_files():
    page = (ROOT / "docs/explanation/security.md").read_text("utf-8")
    assert "Nothing in it is executed." in page
    policy = (ROOT / ".github/SECURITY.md").read_text("utf-8")
    assert "](../docs/explanation/security.md)" in policy
