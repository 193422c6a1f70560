"""The tables with a row per kind of program (of Loihi, Xylo, SpiNNaker): none is missing, and each row works."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.program.sealed import KINDS
from hw_model.targets.programs import PROGRAM_KINDS, AnyProgram, kind_of, load_any_program
from locsnn_compile.cli.players import PLAYERS, expected_by
from locsnn_compile.families import FAMILIES
from locsnn_compile.report.figures.any_program import any_program_figures

TARGETS = ("loihi-sim", "xylo-audio3", "spinnaker1")
STEPS = 24


def network_for(target: str) -> lc.Network:
    """Return a network of two lines, two hidden neurons and two classes, one after the other.

    An event on line 0 exceeds the threshold, 1.2, and one on line 1 stays far below it, 0.25.
    """
    leak = {"decay_u": 0.5, "decay_v": 0.5, "threshold": 1.0}
    neurons = lc.SoftCuba.of(2, drop=0.5, **leak) if "xylo" in target else lc.Cuba.of(2, **leak)
    return lc.Network(
        "pair",
        2,
        STEPS,
        (lc.InputView("touch", "time", 2),),
        (
            lc.Population("hidden", "time", 2, neurons),
            lc.Population("scores", "time", 2, neurons),
        ),
        (
            lc.Projection("touch", "hidden", np.diag([1.2, 0.25])),
            lc.Projection("hidden", "scores", np.diag([1.2, 1.2])),
        ),
        lc.Readout(("scores",), (1.0,)),
        step_seconds=1e-3,
    )


@pytest.fixture(scope="module", params=TARGETS)
def compiled(request):
    """A network, compiled for one target of each kind."""
    events = np.ones((1, STEPS, 2), np.uint8)
    return lc.compile(network_for(request.param), events=events, target=request.param)


def test_every_kind_of_program_has_one_row_in_each_table():
    kinds = [kind.program for kind in PROGRAM_KINDS]
    assert set(kinds) == set(get_args(AnyProgram)) == set(PLAYERS)
    assert [kind.format for kind in PROGRAM_KINDS] == list(KINDS)
    assert len(FAMILIES) == len(kinds)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["reference", "fast"])
def test_a_saved_program_is_loaded_played_and_reported_by_its_row(compiled, engine, tmp_path):
    compiled.save(tmp_path)
    program = load_any_program(tmp_path)
    assert type(program) is type(compiled.program)
    # A touch of 1.2 thresholds gives one spike a step later; what its current still brings, 0.7
    # thresholds at most, gives none, and is gone before the next touch.
    touches = np.zeros((1, STEPS, 2), np.uint8)
    touches[0, [0, 10, 20]] = 1
    played = kind_of(program).play(program, touches, engine)
    for name, spike_steps in {"hidden": [1, 11, 21], "scores": [2, 12, 22]}.items():
        assert np.flatnonzero(played.spikes[name][0, :, 0]).tolist() == spike_steps
        assert not played.spikes[name][0, :, 1].any()
    assert played.scores is not None
    assert played.scores.tolist() == [[3.0, 0.0]]
    assert any_program_figures(program).synapses == 4
    assert (expected_by(program).channels, expected_by(program).steps) == (2, STEPS)
