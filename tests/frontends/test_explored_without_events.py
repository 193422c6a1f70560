"""``locsnn explore`` and ``locsnn compile`` use the same synthetic recordings for files that carry none.

Both commands say in their JSON where their recordings come from, and how many there are. A point that explore lists can
be compiled again by the command that it gives.
"""

import json
import shlex
from pathlib import Path

import nir
import numpy as np
import pytest

from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.data.sensor import POLARITIES, TAXELS
from tests.support.net_files import dense, write_net
from tests.support.nir_graphs import chain, linear
from tests.support.slayer_files import write

RNG = np.random.default_rng(4)
USUAL_ROUNDING = ["--weight-bits", "8", "--split-weights", "0"]
"""The one point of the grid of settings that `compile` takes by default; others would only take time."""
NO_ROUNDING: list[str] = []
"""A lava-dl file holds the chip's integers: nothing is rounded, so the grid has one point, and takes no such options."""
FINGERTIP = TAXELS * POLARITIES
"""Channels of one fingertip, for which recordings are synthetic touches; other inputs get random spikes."""


def slayer(folder: Path, channels: int) -> list[str]:
    """Write a slayerPytorch checkpoint of so many channels, and return the arguments that name it."""
    # Means above 0, so that neurons spike.
    weights = {"fc1": RNG.normal(1, 2, (6, channels)), "fc2": RNG.normal(1, 2, (3, 6))}
    checkpoint, config = write(folder, weights)
    return [str(checkpoint), "--config", str(config)]


def lava_dl(folder: Path) -> list[str]:
    """Write a lava-dl network, and return the arguments that name it."""
    layers = [{"type": "input", "shape": [5]}, dense(RNG, outs=4, ins=5), dense(RNG, outs=3, ins=4)]
    write_net(folder / "model.net", layers)
    return [str(folder / "model.net")]


def graph(folder: Path) -> list[str]:
    """Write a NIR graph, and return the arguments that name it."""
    neuron = nir.IF(r=np.ones(3), v_threshold=np.ones(3), v_reset=np.zeros(3))
    nir.write(folder / "model.nir", chain((5,), ("fc", linear(RNG, outs=3, ins=5)), ("if", neuron)))
    return [str(folder / "model.nir")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("write_model", "grid"),
    [
        pytest.param(
            lambda folder: slayer(folder, channels=20), USUAL_ROUNDING, id="slayerPytorch"
        ),
        pytest.param(
            lambda folder: slayer(folder, channels=FINGERTIP),
            USUAL_ROUNDING,
            id="slayerPytorch of a fingertip",
        ),
        pytest.param(lava_dl, NO_ROUNDING, id="lava-dl"),
        pytest.param(graph, USUAL_ROUNDING, id="NIR"),
    ],
)
def test_explore_takes_the_synthetic_recordings_of_compile(write_model, grid, tmp_path, capsys):
    model = write_model(tmp_path)
    assert locsnn(["compile", *model, "-o", str(tmp_path / "built"), "--json"]) == 0
    compiled = json.loads(capsys.readouterr().out)
    folder = str(tmp_path / "explored")
    # One recording to choose a setting on saves time; "available" says how many there are to choose from.
    options = ["--recordings", "1", "-o", folder, "--json"]
    # Exit code 3: no setting is within the error bounds, which does not matter here.
    assert locsnn(["explore", *model, *grid, *options]) in (0, 3)
    explored = json.loads(capsys.readouterr().out)
    assert explored["chosen_on"]["source"] == compiled["match"]["events_source"]
    assert explored["chosen_on"]["available"] == compiled["match"]["samples"]
    # The command of a point begins with the program's name, locsnn-compile.
    arguments = shlex.split(explored["points"][0]["command"])[1:]
    assert locsnn(["compile", *arguments, "--quiet", "-o", str(tmp_path / "again")]) == 0
