"""What earlier versions wrote is loaded, and gives what it gave: fixtures of each, made by ``write_fixtures.py`` then."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.models.checkpoint_reader import read_checkpoint
from locsnn_compile.reference.evaluate import evaluate

VERSIONS = sorted(Path(__file__).parent.glob("version_*"))
PROGRAMS = [
    (folder, path.name) for folder in VERSIONS for path in sorted(folder.iterdir()) if path.is_dir()
]
CHECKPOINTS = [path for folder in VERSIONS for path in sorted(folder.glob("*.pt"))]
ARTIFICIAL = ("gru-mlp", "cnn-3d")


def recordings(folder: Path, program: str) -> np.ndarray:
    if program == "by-hand":
        return np.load(folder / "inputs.npz")["spikes"]
    return np.load(folder / "touches.npz")["spikes"].transpose(0, 2, 1)


def test_there_are_fixtures():
    assert len(PROGRAMS) >= 13
    assert len(CHECKPOINTS) >= 11


@pytest.mark.parametrize("engine", ["fast", "reference"])
@pytest.mark.parametrize(
    ("folder", "program"), PROGRAMS, ids=lambda value: getattr(value, "name", value)
)
def test_a_program_gives_the_same_spikes_scores_and_counts(folder, program, engine):
    found = hw.simulate(
        hw.load_program(folder / program), recordings(folder, program), engine=engine
    )
    with np.load(folder / "expected.npz") as expected:
        wanted = {
            key.removeprefix(f"{program}/"): expected[key]
            for key in expected
            if key.startswith(f"{program}/")
        }
    assert {key for key in wanted if key.startswith("spikes/")} == {
        f"spikes/{name}" for name in found.spikes
    }
    for name, spikes in found.spikes.items():
        np.testing.assert_array_equal(np.packbits(spikes, axis=1), wanted[f"spikes/{name}"], name)
    np.testing.assert_array_equal(found.scores, wanted["scores"])
    counts = [asdict(each) for each in found.per_recording]
    for key in (key for key in wanted if key.startswith("counts/")):
        name = key.removeprefix("counts/")
        if name == "skipped_steps" and engine == "reference":
            continue  # the plain engine skips nothing
        np.testing.assert_array_equal([each[name] for each in counts], wanted[key], name)


@pytest.mark.parametrize("path", CHECKPOINTS, ids=lambda path: path.stem)
def test_a_checkpoint_is_read_and_predicts_the_same(path):
    if path.stem in ARTIFICIAL:
        assert read_checkpoint(path).description.architecture == path.stem
        return
    network = lc.load(path)
    found = evaluate(
        network, recordings(path.parent, path.stem), registers=hw.chip("loihi-sim").registers
    )
    strategy = "dendrite" if path.stem == "hybrid" else "auto"
    with np.load(path.parent / "expected.npz") as expected:
        np.testing.assert_array_equal(
            found.prediction, expected[f"{path.stem}-{strategy}/reference"]
        )


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line", "reset"])
def test_a_checkpoint_on_the_grid_compiles_to_the_program_of_then(strategy):
    name = f"hybrid-loihi-{strategy}"
    for folder in VERSIONS:
        given = recordings(folder, name)
        compiled = lc.compile(lc.load(folder / f"{name}.pt"), events=given, diagnosis=False)
        then, now = (
            hw.simulate(p, given)
            for p in (hw.load_program(folder / f"{name}-auto"), compiled.program)
        )
        assert asdict(then.counts) == asdict(now.counts)
        for population, spikes in then.spikes.items():
            np.testing.assert_array_equal(now.spikes[population], spikes, population)


def test_the_fixtures_are_not_silent():
    """A program that never spiked would agree with any other that never does."""
    for folder in VERSIONS:
        with np.load(folder / "expected.npz") as expected:
            spikes = {program: 0 for _, program in PROGRAMS}
            for key in expected:
                program, kind, *_ = key.split("/")
                spikes[program] += (
                    int(np.unpackbits(expected[key]).sum()) if kind == "spikes" else 0
                )
        assert not [program for program, count in spikes.items() if count == 0]
