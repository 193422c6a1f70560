"""If both the network and an option do not suit the chip, the error is about the network.

Otherwise a user would remove the option, only to learn that the network does not fit.
"""

from __future__ import annotations

import numpy as np
import pytest

import locsnn_compile as lc
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.errors import InputError, TargetError

HYBRID = "examples/models/objects-hybrid.pt"
LOCATIONS_ON_XYLO = (
    "population 'location_hidden': it steps over locations, and a Xylo steps over time alone. "
    "Give a network with a time branch only."
)


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--strategy", "reset"),
        ("--weight-bits", "4"),
        ("--split-weights", "all"),
        ("--emit", "vectors"),
    ],
    ids=lambda options: " ".join(options) or "nothing else",
)
def test_a_xylo_names_what_the_network_has_before_options(options, tmp_path, capsys):
    folder = tmp_path / "out"
    arguments = [HYBRID, "--target", "xylo-audio3", *options, "-o", str(folder)]
    assert compile_main(arguments) == 1
    assert capsys.readouterr().err.strip() == LOCATIONS_ON_XYLO
    assert not folder.exists()


SUBTRACTING = lc.SoftCuba.of(1, decay_u=0.5, decay_v=0.25, threshold=2.0, drop=1.5)
RESETTING = lc.Cuba.of(1, decay_u=0.5, decay_v=0.25, threshold=2.0)


def one_neuron(neuron: lc.Cuba | lc.SoftCuba) -> lc.Network:
    """Return a network of one neuron behind two channels."""
    return lc.Network(
        name="small",
        channels=2,
        steps=8,
        views=(lc.InputView("touch", "time", 2),),
        populations=(lc.Population("cells", "time", 1, neuron),),
        projections=(lc.Projection("touch", "cells", np.ones((1, 2))),),
        readout=lc.Readout(("cells",), (1.0,)),
        step_seconds=0.001,
    )


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"strategy": "dendrite"},
        {"weight_bits": 4},
        {"split_weights": 0.5},
        {"scheduler": "tcp://127.0.0.1:1"},
    ],
    ids=lambda options: " ".join(options) or "nothing else",
)
def test_a_spinnaker_names_what_the_network_has_before_options(options):
    events = np.zeros((1, 8, 2), dtype=np.uint8)
    with pytest.raises(TargetError) as error:
        lc.compile(one_neuron(SUBTRACTING), target="spinnaker1", events=events, **options)
    assert str(error.value) == (
        "population 'cells': a spike subtracts from its potential, and on SpiNNaker it resets it "
        "to 0. Train neurons that reset to 0, such as Cuba."
    )


def test_an_option_is_refused_where_the_network_fits():
    events = np.zeros((1, 8, 2), dtype=np.uint8)
    with pytest.raises(InputError) as error:
        lc.compile(one_neuron(RESETTING), target="spinnaker1", events=events, split_weights=0.5)
    assert str(error.value) == (
        "split_weights: weights for spinnaker1 are rounded once (got 0.5). Leave it out."
    )
