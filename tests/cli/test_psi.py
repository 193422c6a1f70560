"""Psi is kept from a training configuration to checkpoint, program and report.

While a recording arrives, the time-weighted prediction shifts from the time branch to the location branch: after step t of
T, the location branch has the share 1 / (1 + exp(-psi (t / T - 1))), which rises to 1/2 at the end. Psi, a number without
a unit, is the steepness of the rise: with a larger psi, the location branch has a say only later.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main
from locsnn_compile.data.synthetic import synthetic_touches


def write_touches():
    """Write touches.npz: six synthetic recordings of three classes."""
    touches = synthetic_touches(6, steps=30, classes=3, fingertips=1)
    # The axes of a recording in memory are (samples, steps, channels), those of the file (samples, channels, steps).
    np.savez(
        "touches.npz",
        spikes=touches.spikes.transpose(0, 2, 1),
        labels=touches.labels,
        step_seconds=0.02,
    )


@pytest.mark.slow
def test_psi_is_kept_from_training_to_the_running_program(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_touches()
    Path("c.yaml").write_text("psi: 2.5\nhidden: 4\nepochs: 1\nvalidation_fraction: 0.0\n")
    assert (
        main(["train", "--data", "touches.npz", "--config", "c.yaml", "-o", "net.pt", "--quiet"])
        == 0
    )
    assert lc.load("net.pt").psi == 2.5
    psi_of_program_and_report = {}
    for options in ((), ("--psi", "7")):
        assert compile_main(["net.pt", "--quiet", "-o", "out", *options]) == 0
        psi_of_program_and_report[options] = (
            hw.load_program("out").psi,
            json.loads(Path("out/report.json").read_text())["over_time"]["psi"],
        )
    assert psi_of_program_and_report == {(): (2.5, 2.5), ("--psi", "7"): (7.0, 7.0)}
    capsys.readouterr()
    # The folder has the program of the last round, with psi 7. A stream does not take it from there: branches are
    # weighed by psi only if the command asks for it.
    assert main(["run", "out", "--events", "touches.npz", "--stream", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stream"]["psi"] is None
    assert main(["run", "out", "--events", "touches.npz", "--stream", "--psi", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stream"]["psi"] == 1.0


def test_psi_of_a_single_branch_is_not_kept_and_not_trained(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_touches()
    Path("c.yaml").write_text("psi: 2.5\nmodel: tactile-snn\n")
    assert (
        main(["train", "--data", "touches.npz", "--config", "c.yaml", "-o", "net.pt", "--quiet"])
        == 2
    )
    assert capsys.readouterr().err == (
        "config 'c.yaml', psi: it would change nothing: the network has no second branch. Leave it out.\n"
    )
