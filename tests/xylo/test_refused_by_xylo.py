"""Networks and options that a Xylo cannot handle are refused, with an error that names the reason and a way out.

Most cases are a valid small network with one change; tables give the whole message.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.errors import InputError, TargetError
from tests.support.small_xylo_networks import (
    INPUTS,
    STEPS,
    TIME,
    network,
    small_network,
    soft,
    touches,
)


def one_layer(neuron: lc.SoftCuba | lc.Cuba | lc.SrmAlpha | lc.ChipCuba, **changes: object):
    """Return a network with four neurons of this kind between the input and the outputs, and other changes."""
    populations = (
        lc.Population("hidden", TIME, 4, neuron),
        lc.Population("classes", TIME, 2, OUTPUT),
    )
    return replace(network(populations, (INTO_HIDDEN, OUT_OF_HIDDEN)), **changes)


OUTPUT = soft(size=2, decay_u=0.5, decay_v=0.25, threshold=1.0)
LEAKY = soft(size=4, decay_u=0.5, decay_v=0.25, threshold=1.0)
INTO_HIDDEN = lc.Projection("touch", "hidden", np.full((4, INPUTS), 0.2))
OUT_OF_HIDDEN = lc.Projection("hidden", "classes", np.full((2, 4), 0.2))
SRM = lc.SrmAlpha(theta=1.0, tau_sr=2.0, tau_ref=2.0, scale_ref=1.0)


def reset_to_zero(**changes: object) -> lc.Cuba:
    """Return four neurons whose spikes reset the potential to 0."""
    return lc.Cuba.of(4, **{"decay_u": 0.5, "decay_v": 0.25, "threshold": 1.0} | changes)


def integers() -> lc.Network:
    """Return a network in the integers of Loihi."""
    neuron = lc.ChipCuba.of(4, decay_u=1024, decay_v=512, threshold=100)
    into = lc.ChipProjection("touch", "hidden", np.full((4, INPUTS), 2), 0, 8, "mixed")
    return one_layer(neuron, projections=(into, OUT_OF_HIDDEN))


def over_locations() -> lc.Network:
    """Return a network of a location branch."""
    walk = np.arange(INPUTS)
    return network(
        (
            lc.Population("hidden", "location", 4, LEAKY),
            lc.Population("classes", "location", 2, OUTPUT),
        ),
        (replace(INTO_HIDDEN, weights=np.full((4, STEPS), 0.2)), OUT_OF_HIDDEN),
        views=(lc.InputView("touch", "location", STEPS, walk=walk),),
    )


def in_two_phases() -> lc.Network:
    """Return a network with an additional population in a phase of its own."""
    late = lc.InputView("late touch", TIME, INPUTS, own_phase="late")
    return network(
        (
            lc.Population("later", TIME, 2, OUTPUT, own_phase="late"),
            lc.Population("hidden", TIME, 4, LEAKY),
            lc.Population("classes", TIME, 2, OUTPUT),
        ),
        (
            INTO_HIDDEN,
            OUT_OF_HIDDEN,
            lc.Projection("late touch", "later", np.full((2, INPUTS), 0.2)),
        ),
        views=(lc.InputView("touch", TIME, INPUTS), late),
    )


def with_two_inputs() -> lc.Network:
    """Return a network with a second, unused input."""
    again = lc.InputView("again", TIME, INPUTS)
    return one_layer(LEAKY, views=(lc.InputView("touch", TIME, INPUTS), again))


def with_projections(*projections: lc.Projection) -> lc.Network:
    """Return a network with these projections."""
    return one_layer(LEAKY, projections=projections)


def with_inputs(count: int) -> lc.Network:
    """Return a network with this number of input lines."""
    return one_layer(
        LEAKY,
        channels=count,
        views=(lc.InputView("touch", TIME, count),),
        projections=(replace(INTO_HIDDEN, weights=np.full((4, count), 0.2)), OUT_OF_HIDDEN),
    )


def with_hidden(count: int) -> lc.Network:
    """Return a network with four and ``count`` hidden neurons."""
    return network(
        (
            lc.Population("small", TIME, 4, LEAKY),
            lc.Population(
                "convolution", TIME, count, soft(count, decay_u=0.5, decay_v=0.25, threshold=1.0)
            ),
            lc.Population("classes", TIME, 2, OUTPUT),
        ),
        (
            lc.Projection("touch", "small", np.full((4, INPUTS), 0.2)),
            lc.Projection("small", "convolution", np.full((count, 4), 0.2)),
            lc.Projection("convolution", "classes", np.full((2, count), 0.2)),
        ),
    )


def with_classes(count: int) -> lc.Network:
    """Return a network with this number of outputs."""
    return network(
        (
            lc.Population("hidden", TIME, 4, LEAKY),
            lc.Population(
                "classes", TIME, count, soft(count, decay_u=0.5, decay_v=0.25, threshold=1.0)
            ),
        ),
        (INTO_HIDDEN, replace(OUT_OF_HIDDEN, weights=np.full((count, 4), 0.2))),
    )


# By what is refused: the network, and the error.
REFUSED = {
    "spike response kernels": (
        one_layer(SRM),
        "population 'hidden': its neurons have spike response kernels, and those of a Xylo leak. "
        "Give a network of leaky neurons with a current.",
    ),
    "integers of another chip": (
        integers(),
        "population 'hidden': its parameters are integers of a chip with another arithmetic. Give "
        "the network in float, as it was before it was rounded or trained in integers.",
    ),
    "a reset to 0": (
        one_layer(reset_to_zero()),
        "population 'hidden': a spike resets its potential to 0, and on a Xylo it subtracts the "
        "threshold. Read a NIR graph with --reset subtract, or give SoftCuba neurons.",
    ),
    "a subtraction one step late": (
        one_layer(replace(LEAKY, drop=np.full(4, 1.0))),
        "population 'hidden': what a spike takes from the next potential is not the decayed "
        "threshold (1 against 0.75 in neuron 0). Read a NIR graph with --reset subtract, or give "
        "drop = (1 - decay_v) * threshold.",
    ),
    "refractory steps": (
        one_layer(reset_to_zero(refractory=3)),
        "population 'hidden': its neurons rest after a spike, and those of a Xylo have no "
        "refractory steps (2 steps against 0). Train without a refractory period.",
    ),
    "a floor of the potential": (
        one_layer(replace(LEAKY, floor=np.full(4, -1.0))),
        "population 'hidden': its potential has a floor, and on a Xylo only the end of a register "
        "stops it. Train without a floor.",
    ),
    "no current": (
        one_layer(reset_to_zero(decay_u=1.0)),
        "population 'hidden': its current decays faster than one of a Xylo, which keeps half of it "
        "or more (a step loses 1 against less than 0.7071). Train neurons with a synaptic current, "
        "or give a smaller step (--dt).",
    ),
    "a current without decay": (
        one_layer(replace(LEAKY, decay_u=np.array([0.5, 0.5, 0.0, 0.5]))),
        "population 'hidden': its current never decays, and on a Xylo every current does. Train "
        "with a finite time constant.",
    ),
    "a potential without leak": (
        one_layer(replace(LEAKY, decay_v=np.zeros(4))),
        "population 'hidden': its potential never decays, and on a Xylo every potential does. "
        "Train with a finite time constant.",
    ),
    "delays": (
        with_projections(replace(INTO_HIDDEN, delay=3), OUT_OF_HIDDEN),
        "projection 'touch' -> 'hidden': its spikes arrive late, and a Xylo has no delays (3 steps "
        "against 0). Train without delays.",
    ),
    "location phases": (
        over_locations(),
        "population 'hidden': it steps over locations, and a Xylo steps over time alone. Give a "
        "network with a time branch only.",
    ),
    "two phases": (
        in_two_phases(),
        "model 'small': a Xylo plays a recording once, in one phase (late and time against 1 "
        "phase). Compile one branch at a time.",
    ),
    "two inputs": (
        with_two_inputs(),
        "model 'small': a Xylo hears a recording in one way (2 inputs against 1). Join the inputs "
        "into one.",
    ),
    "a start at the first touch": (
        one_layer(LEAKY, views=(lc.InputView("touch", TIME, INPUTS, align_events=2),)),
        "input 'touch': it starts at the first touch, and a Xylo starts with the recording. Train "
        "without aligning recordings.",
    ),
    "graded outputs": (
        one_layer(LEAKY, readout=lc.Readout(("classes",), (1.0,), potentials_from=1)),
        "readout: it reads potentials, and a Xylo sends spikes. End the network in neurons that "
        "spike, such as CubaLIF instead of LI or CubaLI.",
    ),
    "several outputs": (
        network(
            (
                lc.Population("hidden", TIME, 4, LEAKY),
                lc.Population("classes", TIME, 2, OUTPUT),
                lc.Population("others", TIME, 2, OUTPUT),
            ),
            (INTO_HIDDEN, OUT_OF_HIDDEN, replace(OUT_OF_HIDDEN, target="others")),
            readout=lc.Readout(("classes", "others"), (1.0, 1.0)),
        ),
        "readout: several populations give spikes to the scores, and a Xylo has one of outputs "
        "('classes' and 'others'). Give a network with one output population.",
    ),
    "outputs that hear inputs": (
        with_projections(
            INTO_HIDDEN,
            OUT_OF_HIDDEN,
            lc.Projection("touch", "classes", np.full((2, INPUTS), 0.2)),
        ),
        "projection 'touch' -> 'classes': outputs of a Xylo hear hidden neurons only. Put a hidden "
        "layer in between.",
    ),
    "outputs that hear themselves": (
        with_projections(
            INTO_HIDDEN, OUT_OF_HIDDEN, lc.Projection("classes", "classes", -np.eye(2))
        ),
        "projection 'classes' -> 'classes': outputs of a Xylo hear hidden neurons only. End the "
        "network in neurons without synapses among themselves, such as CubaLIF.",
    ),
    "outputs that are heard": (
        with_projections(
            INTO_HIDDEN,
            OUT_OF_HIDDEN,
            lc.Projection("classes", "hidden", np.full((4, 2), 0.2)),
        ),
        "projection 'classes' -> 'hidden': outputs of a Xylo send spikes to nothing on the chip. "
        "Read out a population behind it.",
    ),
    "17 inputs": (
        with_inputs(17),
        "xylo-audio3: too many inputs (17 against 16). Train on fewer channels: merge polarities "
        "(--merge-polarities), or neighbours (--merge-channels 16).",
    ),
    "a large convolution": (
        with_hidden(1000),
        "xylo-audio3: too many hidden neurons (1004 against 992, of which 'convolution' has 1000). "
        "Train smaller layers, or convolutions with a larger stride or fewer channels.",
    ),
    "33 classes": (
        with_classes(33),
        "xylo-audio3: too many outputs (33 against 32). Train with fewer classes, or for a Xylo "
        "with more outputs.",
    ),
}


@pytest.mark.parametrize("feature", REFUSED)
def test_a_lowering_that_a_xylo_lacks_is_refused_by_name(feature):
    refused, message = REFUSED[feature]
    recordings = np.zeros((1, STEPS, refused.channels), np.uint8)
    with pytest.raises(TargetError) as error:
        lc.compile(refused, target="xylo-audio3", events=recordings)
    assert str(error.value) == message


def test_the_smallest_layer_of_each_size_still_fits():
    """One input, neuron or class fewer than what is refused above; the chip has 992 hidden neurons, 4 of them here."""
    for fits in (with_inputs(16), with_hidden(988), with_classes(32)):
        recordings = np.zeros((1, STEPS, fits.channels), np.uint8)
        assert lc.compile(fits, target="xylo-audio3", events=recordings).program.chip.inputs == 16


# By option: how Python asks for it, and the error.
OPTIONS = {
    "strategy": (
        {"strategy": "reset"},
        "strategy: it lays out SRM neurons, and xylo-audio3 has neurons that leak (got reset). "
        "Leave it out.",
    ),
    "weight bits": (
        {"weight_bits": 4},
        "weight_bits: weights of xylo-audio3 have one width (got 4). Leave it out.",
    ),
    "split weights": (
        {"split_weights": 0.5},
        "split_weights: xylo-audio3 has one synapse for a weight (got 0.5). Leave it out.",
    ),
    "budget": (
        {"budget": lc.ErrorBudget(max_spike_error=0.0)},
        "budget: there is one setting for xylo-audio3, and a budget chooses among several. "
        "Leave it out, and look at the match of the report.",
    ),
    "profile": (
        {"profile": "loihi-paper"},
        "profile 'loihi-paper': no energies of xylo-audio3 are published. Leave it out.",
    ),
    "scheduler": (
        {"scheduler": "tcp://127.0.0.1:8786"},
        "scheduler: recordings are played to xylo-audio3 in this process. Leave it out.",
    ),
    "calibration": (
        {"calibration": touches(2)},
        "calibration: it would change nothing: no weights of this model are rounded for "
        "recordings. Leave it out.",
    ),
}


@pytest.mark.parametrize("option", OPTIONS)
def test_options_of_other_chips_are_refused_by_name(option):
    options, message = OPTIONS[option]
    with pytest.raises(InputError) as error:
        lc.compile(small_network(), target="xylo-audio3", events=touches(2), **options)
    assert str(error.value) == message


def test_the_only_width_and_the_only_strategy_are_accepted_as_options():
    options = {"strategy": "native", "weight_bits": 8}
    compiled = lc.compile(small_network(), target="xylo-audio3", events=touches(2), **options)
    assert compiled.report["strategy"] == "native"
