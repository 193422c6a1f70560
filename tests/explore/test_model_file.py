"""Models as the command line names them: what is loaded, said again, and hashed."""

from dataclasses import replace

import pytest

import locsnn_compile as lc
from locsnn_compile.errors import InputError
from locsnn_compile.explore.point import ModelFile


def test_a_checkpoint_needs_nothing_else(model):
    file = ModelFile(str(model))
    assert file.load().sha256 == lc.load(model).sha256
    assert file.arguments() == [str(model)]


def test_options_are_passed_on_and_said_again(model):
    file = ModelFile(str(model), config="a.yaml", dt=0.001, reset="zero", discretisation="exact")
    wanted = ["--config", "a.yaml", "--dt", "0.001", "--reset", "zero", "--discretisation", "exact"]
    assert file.arguments() == [str(model), *wanted]
    with pytest.raises(InputError, match="dt was given"):
        replace(file, config=None).load()


def test_the_digest_follows_files_and_options(tmp_path):
    for name, text in (("a.pt", "one"), ("b.pt", "two"), ("same.pt", "one"), ("x.yaml", "config"), ("y.yaml", "other")):
        (tmp_path / name).write_text(text)

    def digest(name, config=None, **options):
        return ModelFile(str(tmp_path / name), config and str(tmp_path / config), **options).digest()

    assert digest("a.pt") == digest("same.pt")
    different = [
        digest("a.pt"),
        digest("b.pt"),
        digest("a.pt", "x.yaml"),
        digest("a.pt", "y.yaml"),
        digest("a.pt", dt=0.1),
        digest("a.pt", reset="zero"),
    ]
    assert len(set(different)) == len(different)
