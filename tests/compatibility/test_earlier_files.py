"""Programs and checkpoints that earlier versions wrote load, and give the results that they gave then.

Each folder ``version_*`` holds the files of a version and its results (``expected.npz``), which
``write_fixtures.py`` wrote with the code of that version.
"""

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
"""Networks without spikes: their checkpoints can be read, but not compiled."""


def recordings(folder: Path, program: str) -> np.ndarray:
    """Return the spikes (recordings, steps, channels) that a program was played with."""
    if program == "by-hand":
        return np.load(folder / "inputs.npz")["spikes"]
    return np.load(folder / "touches.npz")["spikes"].transpose(0, 2, 1)


def test_the_fixtures_of_a_version_are_found():
    # As many as `write_fixtures.py` writes for one version.
    assert len(PROGRAMS) >= 13
    assert len(CHECKPOINTS) >= 11


@pytest.mark.parametrize("engine", ["fast", "reference"])
@pytest.mark.parametrize(
    ("folder", "program"), PROGRAMS, ids=lambda value: getattr(value, "name", value)
)
def test_a_program_gives_the_same_spikes_scores_and_counts(folder, program, engine):
    result = hw.simulate(
        hw.load_program(folder / program), recordings(folder, program), engine=engine
    )
    with np.load(folder / "expected.npz") as arrays:
        expected = {
            key.removeprefix(f"{program}/"): arrays[key]
            for key in arrays
            if key.startswith(f"{program}/")
        }
    assert {key for key in expected if key.startswith("spikes/")} == {
        f"spikes/{name}" for name in result.spikes
    }
    for name, spikes in result.spikes.items():
        # Spikes are kept as bits, eight steps to a byte.
        packed = np.packbits(spikes, axis=1)
        np.testing.assert_array_equal(packed, expected[f"spikes/{name}"], name)
    np.testing.assert_array_equal(result.scores, expected["scores"])
    counts = [asdict(of_recording) for of_recording in result.per_recording]
    for key in (key for key in expected if key.startswith("counts/")):
        name = key.removeprefix("counts/")
        if name == "skipped_steps" and engine == "reference":
            continue  # the plain engine skips nothing
        values = [of_recording[name] for of_recording in counts]
        np.testing.assert_array_equal(values, expected[key], name)


@pytest.mark.parametrize("path", CHECKPOINTS, ids=lambda path: path.stem)
def test_a_checkpoint_is_read_and_predicts_the_same(path):
    if path.stem in ARTIFICIAL:
        assert read_checkpoint(path).description.architecture == path.stem
        return
    network = lc.load(path)
    result = evaluate(
        network, recordings(path.parent, path.stem), registers=hw.chip("loihi-sim").registers
    )
    # Predictions are kept with a program: of the several strategies of the hybrid, any will do.
    strategy = "dendrite" if path.stem == "hybrid" else "auto"
    with np.load(path.parent / "expected.npz") as expected:
        np.testing.assert_array_equal(
            result.prediction, expected[f"{path.stem}-{strategy}/reference"]
        )


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line", "reset"])
def test_a_checkpoint_on_the_grid_compiles_to_a_program_with_the_same_spikes(strategy):
    """A network trained on the chip's integers leaves the compiler nothing to round, so no version may differ."""
    name = f"hybrid-loihi-{strategy}"
    for folder in VERSIONS:
        events = recordings(folder, name)
        compiled = lc.compile(lc.load(folder / f"{name}.pt"), events=events, diagnosis=False)
        then = hw.simulate(hw.load_program(folder / f"{name}-auto"), events)
        now = hw.simulate(compiled.program, events)
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
                if kind == "spikes":
                    spikes[program] += int(np.unpackbits(expected[key]).sum())
        assert not [program for program, count in spikes.items() if count == 0]
