"""Populations, networks and programs that a core or a board of SpiNNaker cannot hold are refused, naming the limit.

Tables give the changes to a small valid network, and the whole error message.
"""

from __future__ import annotations

import numpy as np
import pytest

from hw_model.errors import InputError, TargetError
from hw_model.mapping.graph import Input, Phase, Readout
from hw_model.spinnaker.chips import spinnaker_chip, spinnaker_chip_names
from hw_model.spinnaker.program import SpinnakerProgram
from tests.support.small_spinnaker import Synapse, network, parameters, population, projection

CHIP = spinnaker_chip("spinnaker1")


def test_one_chip_ships():
    assert spinnaker_chip_names() == ("spinnaker1",)
    assert CHIP.description == ("856 cores of 256 neurons, 256 synapses of a source on a core")


def test_another_name_is_refused():
    with pytest.raises(InputError) as error:
        spinnaker_chip("spinnaker3")
    assert str(error.value) == (
        "target 'spinnaker3': no SpiNNaker of this name ships. Did you mean 'spinnaker1'?"
    )


POPULATIONS = {
    "time constant": (
        {"parameters": parameters(tau_m=0.0)},
        "population 'cells', tau_m: a core cannot hold it (0 against 1..2147483647). Correct it.",
    ),
    "refractory time": (
        {"parameters": parameters(tau_refrac=-1.0)},
        "population 'cells', tau_refrac: a core cannot hold it (-32768 against 0..2147483647). "
        "Correct it.",
    ),
    "potential": (
        {"parameters": parameters(v_thresh=65536.0)},
        "population 'cells', v_thresh: a core cannot hold it (2147483648 against "
        "-2147483648..2147483647). Correct it.",
    ),
    "shift": (
        {"shifts": (0, 17)},
        "population 'cells', shifts: a core cannot hold it (17 against 0..16). Correct it.",
    ),
    "slots": (
        {"slots": 12},
        "population 'cells': its ring buffer has another number of slots than a power of two "
        "(12). Give 2 or a higher power of two.",
    ),
    "shape": (
        {"parameters": parameters()._replace(c_m=np.array([1, 2]))},
        "population 'cells', c_m: the shape does not fit (int64 (2,) against int64 (1,)). Give "
        "this shape.",
    ),
}


@pytest.mark.parametrize("case", POPULATIONS)
def test_neurons_that_no_core_holds_are_refused(case):
    changes, message = POPULATIONS[case]
    with pytest.raises(InputError) as error:
        population(**changes)
    assert str(error.value) == message


NETWORKS = {
    "weight": (
        {"projections": (projection(Synapse(source=0, target=0, weight=65536, delay=1)),)},
        "projection 'lines' -> 'cells', excitatory, weight: a core cannot hold it (65536 against "
        "0..65535). Correct it.",
    ),
    "delay": (
        {"projections": (projection(Synapse(source=0, target=0, weight=1, delay=9)),)},
        "projection 'lines' -> 'cells', excitatory, delay: a core cannot hold it (9 against "
        "1..8). Correct it.",
    ),
    "no delay": (
        {"projections": (projection(Synapse(source=0, target=0, weight=1, delay=0)),)},
        "projection 'lines' -> 'cells', excitatory, delay: a core cannot hold it (0 against "
        "1..8). Correct it.",
    ),
    "target index": (
        {"projections": (projection(Synapse(source=0, target=1, weight=1, delay=1)),)},
        "projection 'lines' -> 'cells', excitatory, target_index: a core cannot hold it (1 "
        "against 0..0). Correct it.",
    ),
    "source": (
        {
            "projections": (
                projection(Synapse(source=0, target=0, weight=1, delay=1), source="line"),
            )
        },
        "projection 'line' -> 'cells', excitatory: its source does not exist. Did you mean "
        "'lines'?",
    ),
    "target": (
        {
            "projections": (
                projection(Synapse(source=0, target=0, weight=1, delay=1), target="lines"),
            )
        },
        "projection 'lines' -> 'lines', excitatory: its target is not a population. Choose one "
        "of: cells.",
    ),
    "receptor": (
        {
            "projections": (
                projection(Synapse(source=0, target=0, weight=1, delay=1), receptor="inhibitor"),
            )
        },
        "projection 'lines' -> 'cells', inhibitor: there is no such receptor. Did you mean "
        "'inhibitory'?",
    ),
    "phase": (
        {"inputs": (Input("lines", size=1, phase="walk", stream="touches"),)},
        "'lines': its phase does not exist. Choose one of: run.",
    ),
    "phases": (
        {
            "phases": (Phase("run", "time", steps=None), Phase("walk", "time", steps=None)),
            "inputs": (Input("lines", size=1, phase="walk", stream="touches"),),
        },
        "projection 'lines' -> 'cells', excitatory: its ends are in different phases. Connect "
        "what runs together.",
    ),
    "names": (
        {"inputs": (Input("cells", size=1, phase="run", stream="touches"),), "projections": ()},
        "network: it has more than one input or population 'cells'. Give each a name of its own.",
    ),
    "order": (
        {
            "inputs": (Input("lines", size=2, phase="run", stream="touches"),),
            "projections": (
                projection(
                    Synapse(source=1, target=0, weight=1, delay=1),
                    Synapse(source=0, target=0, weight=1, delay=1),
                ),
            ),
        },
        "projection 'lines' -> 'cells', excitatory: its synapses are not ordered by source. Sort "
        "them by source_index.",
    ),
}


@pytest.mark.parametrize("case", NETWORKS)
def test_a_network_that_cannot_be_is_refused(case):
    changes, message = NETWORKS[case]
    with pytest.raises(InputError) as error:
        network(**changes)
    assert str(error.value) == message


def _row(length: int) -> list[tuple[int, int, int, int]]:
    """Return synapses (source, target, weight, delay) from line 0 to this many neurons."""
    return [(0, n, 1, 1) for n in range(length)]


BOARDS = {
    "ring buffer": (
        {"populations": (population(size=200, slots=64, neurons_per_core=256),)},
        "population 'cells': its ring buffer is too large (15 against 14). Lower its neurons a "
        "core, or its delays.",
    ),
    "cores": (
        {"populations": (population(size=857, neurons_per_core=1),)},
        "phase 'run': too many cores (857 against 856). Train a network with fewer neurons.",
    ),
    "row": (
        {
            "populations": (population(size=256, neurons_per_core=256),),
            "projections": (
                projection(*_row(256)),
                projection(Synapse(source=0, target=7, weight=1, delay=1), receptor="inhibitory"),
            ),
        },
        "synapses 'lines' -> 'cells': too many synapses of a source on a core (257 against 256). "
        "Lower the neurons a core of the target, or prune synapses.",
    ),
}


@pytest.mark.parametrize("case", BOARDS)
def test_a_network_that_a_board_has_no_room_for_is_refused(case):
    changes, message = BOARDS[case]
    with pytest.raises(TargetError) as error:
        network(**changes).check_fits(CHIP)
    assert str(error.value) == message


def test_a_row_is_counted_core_by_core():
    halves = population(size=256, neurons_per_core=128)
    split = network(populations=(halves,), projections=(projection(*_row(256)),))
    assert split.longest_rows() == {("lines", "cells"): 128}
    assert split.cores_of("run") == 2


READOUTS = {
    "name": (
        {"readout": Readout(("cell",), (1.0,))},
        "program 'touch': its readout names 'cell', which does not exist. Did you mean 'cells'?",
    ),
    "ties": (
        {"readout": Readout(("cells",), (1.0,), tie_class=1)},
        "program 'touch': the class of its ties is not one of its outputs (1 against 0..0). Give "
        "one of them.",
    ),
    "class names": (
        {"readout": Readout(("cells",), (1.0,)), "class_names": ("a", "b")},
        "program 'touch': its class names do not fit its outputs (2 against 1). Give one for each "
        "output.",
    ),
}


@pytest.mark.parametrize("case", READOUTS)
def test_a_readout_that_does_not_fit_is_refused(case):
    changes, message = READOUTS[case]
    with pytest.raises(InputError) as error:
        SpinnakerProgram("touch", CHIP, network(), **changes)
    assert str(error.value) == message


def test_a_program_says_which_recordings_it_expects():
    assert SpinnakerProgram("touch", CHIP, network()).streams == {"touches": 1}
