"""Write the fixtures of a version: ``python write_fixtures.py FOLDER``, with that version's packages on the path.

Trains and writes a checkpoint of every network, compiles them with every strategy, plays the programs on drawn recordings,
and keeps spikes, scores and counts: a later version must give the same (`test_earlier_files.py`). It is run once for each
version, before the format of a file changes. Fixtures are never written again.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.data.synthetic import synthetic_touches

SMALL = "hidden: 6\nfeatures: 3\nstep_features: 2\nepochs: 12\nvalidation_fraction: 0.0\nbatch_size: 6\n"
"""A training configuration that takes seconds: the fixtures need spikes, not accuracy."""
WITHOUT_SPIKES = ("gru-mlp", "cnn-3d")
NETWORKS = (
    "hybrid",
    "tactile-snn",
    "location-tactile-snn",
    "hybrid-lif",
    "hybrid-graph",
    "window-snn",
    *WITHOUT_SPIKES,
)
STRATEGIES = ("dendrite", "delay-line", "reset", "paired-dendrite")
"""With which the hybrid is compiled; other networks take the one that the compiler chooses."""
TRAINED_STRATEGIES = ("dendrite", "delay-line", "reset")
"""For which the hybrid is also trained on the chip's integers."""


def main(folder: Path) -> None:
    """Write all fixtures into a folder that does not exist."""
    folder.mkdir()
    os.chdir(folder)
    touches = synthetic_touches(6, steps=30, classes=3, fingertips=1)
    np.savez_compressed(
        "touches.npz",
        spikes=touches.spikes.transpose(0, 2, 1),
        labels=touches.labels,
        step_seconds=0.02,
    )
    Path("small.yaml").write_text(SMALL)
    train = ["train", "--data", "touches.npz", "--config", "small.yaml", "--quiet"]
    for name in NETWORKS:
        assert locsnn([*train, "--model", name, "-o", f"{name}.pt"]) == 0
    for strategy in TRAINED_STRATEGIES:
        target = [
            "--from",
            "hybrid.pt",
            "--target",
            "loihi-sim",
            "--strategy",
            strategy,
            "--weight-bits",
            "5",
        ]
        assert locsnn([*train, *target, "-o", f"hybrid-loihi-{strategy}.pt"]) == 0

    expected: dict[str, np.ndarray] = {}
    checkpoints = [path.stem for path in sorted(Path().glob("*.pt"))]
    spiking = [name for name in checkpoints if name not in WITHOUT_SPIKES]
    for name in spiking:
        network = lc.load(f"{name}.pt")
        for strategy in STRATEGIES if name == "hybrid" else ("auto",):
            compiled = lc.compile(network, strategy=strategy, events=touches, diagnosis=False)
            program = f"{name}-{strategy}"
            compiled.program.save(program)
            keep(expected, program, hw.simulate(compiled.program, touches.spikes))
            expected[f"{program}/reference"] = compiled.match.reference_prediction
    by_hand().save("by-hand")
    rng = np.random.default_rng(3)
    inputs = (rng.random((4, 40, 12)) < 0.3).astype(np.uint8)
    np.savez_compressed("inputs.npz", spikes=inputs)
    keep(expected, "by-hand", hw.simulate(by_hand(), inputs))
    np.savez_compressed("expected.npz", **expected)
    # Training wrote curves of its progress, which no later version reads.
    for path in (*Path().glob("*.csv"), *Path().glob("*.svg"), Path("small.yaml")):
        path.unlink()


def keep(expected: dict[str, np.ndarray], program: str, result: hw.SimulationResult) -> None:
    """Add a result to `expected`: spikes of every population, scores, and counts of every recording."""
    for name, spikes in result.spikes.items():
        expected[f"{program}/spikes/{name}"] = np.packbits(spikes, axis=1)
    if result.scores is not None:
        expected[f"{program}/scores"] = result.scores
    counts = [vars(each) for each in result.per_recording]
    for key in counts[0]:
        expected[f"{program}/counts/{key}"] = np.array([each[key] for each in counts])


def by_hand() -> hw.ChipProgram:
    """Return a program with what the trained networks lack.

    It has biases, a refractory period, delays up to the longest (62), three dendrites joined to one
    soma, recurrence, and limits of voltages. Its numbers are chosen by hand.
    """
    rng = np.random.default_rng(1)
    b = hw.ProgramBuilder(hw.chip("loihi-sim"), "by-hand")
    x = b.add_input("x", 12)
    soma = b.add_compartments("soma", 8, decay_u=4096, decay_v=4096, threshold=60, refractory=3)
    for number in range(3):
        dendrite = b.add_compartments(
            f"dendrite_{number}",
            8,
            decay_u=300 * number,
            decay_v=700,
            threshold=0,
            bias=32 * number,
            joined_to=soma,
        )
        b.connect(
            x,
            dendrite,
            2 * rng.integers(-60, 90, (8, 12)),
            delay=rng.integers(0, 20, (8, 12)),
            exponent=-1,
        )
    b.connect(soma, soma, -2 * rng.integers(0, 100, (8, 8)), delay=5)
    out = b.add_compartments(
        "out", 4, decay_u=1024, decay_v=128, threshold=200, vmin=1 - 2**15, vmax=2**17 - 1
    )
    b.connect(soma, out, 2 * rng.integers(-100, 127, (4, 8)), delay=62)
    b.connect(x, out, rng.integers(0, 200, (4, 12)), sign_mode="excitatory")
    b.read_out(out)
    return b.build()


if __name__ == "__main__":
    main(Path(sys.argv[1]).absolute())
