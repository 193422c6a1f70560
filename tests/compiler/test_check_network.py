"""The rules that a network must keep before it is compiled, each with its whole error message; and weight matrices.

Each case breaks one rule of a sound network, most of them of the small hybrid of ``tests/support/networks.py``. Weight
matrices may be dense or sparse.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from locsnn_compile.errors import InputError
from locsnn_compile.network.check import check_network
from locsnn_compile.network.chip_neurons import ChipCuba, ChipSrm
from locsnn_compile.network.network import InputView
from locsnn_compile.network.neurons import Cuba, SrmAlpha
from locsnn_compile.network.projections import (
    ChipProjection,
    Projection,
    charge,
    connections,
    fan_out,
    matrix,
    of_target,
    row_maxima,
    row_sums,
    values_of,
    with_values,
)
from locsnn_compile.passes.srm.quantize import refractory_count
from tests.support.networks import DECAY_OF_10, NEURON, hybrid, on_grid, single

CHANNELS = 4
STEPS = 12
"""The size of the hybrid. Its location branch visits the channels, each on a line for every step."""


def lif(**changes):
    """Return a network of two leaky neurons behind three channels, with parameters of the neurons changed."""
    return single(replace(Cuba.of(2, decay_v=0.1, threshold=1.0), **changes), np.ones((2, 3)))


def integers(neuron, mantissa=((2, 4), (0, 6)), **changes):
    """Return a network of two neurons in the chip's integers behind two channels, with these weight mantissas."""
    projection = ChipProjection(
        "touch", "n", matrix(mantissa, np.int64), exponent=0, weight_bits=8, **changes
    )
    return replace(single(neuron, np.ones((2, 2))), projections=(projection,))


def chip_cuba(**changes):
    """Return two neurons in the chip's integers."""
    return replace(ChipCuba.of(2, decay_u=4096, decay_v=100, threshold=10), **changes)


def in_phase(phase):
    """Return the hybrid with its first population in a phase of this name."""
    first, *others = hybrid().populations
    return replace(hybrid(), populations=(replace(first, own_phase=phase), *others))


def tapped(**changes):
    """Return two neurons with two self-synapses (taps) each, of which some parameters are changed."""
    neuron = ChipSrm.with_taps(
        2, decay=DECAY_OF_10, threshold=10, delay=[0, 1], mantissa=[-3, 2], exponent=[1, 1]
    )
    return replace(neuron, refractory=replace(neuron.refractory, **changes))


def joined(**changes):
    """Return two neurons with a refractory dendrite, of which some parameters are changed."""
    neuron = ChipSrm.with_taps(
        2, decay=DECAY_OF_10, threshold=10, refractory_decay=1, mantissa=-3, exponent=0
    )
    return replace(neuron, refractory=replace(neuron.refractory, **changes))


def visiting(axis="location", **changes):
    """Return the hybrid with fields of the view of one axis changed."""
    network = hybrid()
    views = tuple(replace(view, **changes) if view.axis == axis else view for view in network.views)
    return replace(network, views=views)


def two_walks():
    """Return the hybrid with a second view of the location axis, which takes one step more."""
    network = hybrid()
    other = InputView("other", "location", lines=STEPS, walk=np.arange(CHANNELS), silence=1)
    return replace(network, views=(*network.views, other))


def moved(axis):
    """Return the hybrid with its first population on another axis."""
    network = hybrid()
    first, *others = network.populations
    return replace(network, populations=(replace(first, axis=axis), *others))


def named(*names):
    """Return the hybrid, which has two classes, with these class names."""
    return replace(hybrid(), class_names=names)


def with_tie_class(tie_class):
    """Return the hybrid, which has two classes, with this class for ties."""
    network = hybrid()
    return replace(network, readout=replace(network.readout, tie_class=tie_class))


THREE = np.array([1, 2, 3])
"""Values for three neurons, where networks here have two."""

BROKEN_RULES = [
    pytest.param(
        lambda: single(replace(NEURON, theta=0.0)),
        "population 'n': theta must be above 0 (0.0). Correct it.",
        id="theta",
    ),
    pytest.param(
        lambda: single(replace(NEURON, tau_ref=np.nan)),
        "population 'n': tau_ref must be above 0 (nan). Correct it.",
        id="tau",
    ),
    pytest.param(
        lambda: single(replace(NEURON, scale_ref=-1.0)),
        "population 'n': scale_ref must be at least 0 (-1.0). Correct it.",
        id="scale_ref",
    ),
    pytest.param(
        lambda: lif(decay_u=np.array([0.5, 1.5])),
        "population 'n': decay_u must be a fraction from 0 to 1 (1.5). Correct it.",
        id="decay",
    ),
    pytest.param(
        lambda: lif(threshold=np.array([1.0, np.inf])),
        "population 'n': threshold must be above 0 (inf). Correct it.",
        id="threshold",
    ),
    pytest.param(
        lambda: lif(threshold=np.array([1.0, 1e-101])),
        "population 'n': threshold is too small a number to compute with (1e-101 against "
        "1e-100 to 1e+100). Give it in other units.",
        id="small threshold",
    ),
    pytest.param(
        lambda: lif(threshold=np.array([1.0, 1e101])),
        "population 'n': threshold is too large a number to compute with (1e+101 against "
        "1e-100 to 1e+100). Give it in other units.",
        id="large threshold",
    ),
    pytest.param(
        lambda: lif(bias=np.array([1.0, -1e101])),
        "population 'n': bias is too large a number to compute with (-1e+101 against "
        "1e+100). Give it in other units.",
        id="large bias",
    ),
    pytest.param(
        lambda: with_tie_class(2),
        "readout: tie_class is not a class (2 against 0..1). Give the number of a class, or None.",
        id="a class for ties that is not there",
    ),
    pytest.param(
        lambda: lif(bias=np.array([1.0, np.nan])),
        "population 'n': bias must be a finite number (nan). Correct it.",
        id="bias",
    ),
    pytest.param(
        lambda: lif(refractory=np.array([0, 1])),
        "population 'n': refractory must be at least 1 (0). Correct it.",
        id="refractory",
    ),
    pytest.param(
        lambda: lif(decay_v=np.full(3, 0.1)),
        "population 'n': decay_v has the wrong shape ((3,) against (2,)). Give one number "
        "per neuron.",
        id="float shape",
    ),
    pytest.param(
        lambda: integers(chip_cuba(refractory=THREE)),
        "population 'n': refractory has the wrong shape ((3,) against (2,)). Give one number "
        "per neuron.",
        id="integer shape",
    ),
    pytest.param(
        lambda: integers(tapped(exponent=THREE)),
        "population 'n': tap exponent has the wrong shape ((3,) against (2,)). Give one "
        "number per neuron.",
        id="taps",
    ),
    pytest.param(
        lambda: integers(tapped(mantissa=THREE)),
        "population 'n': tap mantissa has the wrong shape ((3,) against (2, 2)). Give one "
        "number per neuron.",
        id="tap mantissas",
    ),
    pytest.param(
        lambda: integers(joined(decay=THREE)),
        "population 'n': refractory decay has the wrong shape ((3,) against (2,)). Give one "
        "number per neuron.",
        id="dendrite",
    ),
    pytest.param(
        lambda: integers(replace(joined(), dendrites=0)),
        "population 'n': its neurons have no dendrite (0). Give 1 or more.",
        id="no dendrites",
    ),
    pytest.param(
        lambda: integers(replace(joined(), dendrites=2), dendrite=2),
        "projection 'touch' -> 'n': the target has no such dendrite (2 of 2, counted from "
        "0). Name one that it has.",
        id="no such dendrite",
    ),
    pytest.param(
        lambda: integers(chip_cuba(), dendrite=1),
        "projection 'touch' -> 'n': the target has no such dendrite (1 of 1, counted from "
        "0). Name one that it has.",
        id="one compartment",
    ),
    pytest.param(
        lambda: replace(
            hybrid(), projections=(Projection("time_hidden", "touch", np.ones((1, 1))),)
        ),
        "projection 'time_hidden' -> 'touch': an input takes no synapses. Connect it the "
        "other way round.",
        id="input as an end",
    ),
    pytest.param(
        lambda: replace(hybrid(), projections=(Projection("touch", "no", np.ones((1, 1))),)),
        "projection 'touch' -> 'no': it joins something that does not exist. Name an input "
        "or a population.",
        id="end",
    ),
    pytest.param(
        lambda: moved("location"),
        "projection 'touch' -> 'time_hidden': joins the time axis to the location axis. Keep "
        "to one axis.",
        id="axes",
    ),
    pytest.param(
        lambda: replace(
            integers(chip_cuba()), projections=(Projection("touch", "n", np.ones((2, 2))),)
        ),
        "projection 'touch' -> 'n': float weights reach integer neurons. Give a population "
        "and the weights onto it in one kind of number.",
        id="float onto integers",
    ),
    pytest.param(
        lambda: replace(integers(chip_cuba()), populations=lif().populations),
        "projection 'touch' -> 'n': integer weights reach float neurons. Give a population "
        "and the weights onto it in one kind of number.",
        id="integers onto float",
    ),
    pytest.param(
        lambda: integers(chip_cuba(), mantissa=((2, 4),)),
        "projection 'touch' -> 'n': the weights have the wrong shape ((1, 2) against (2, "
        "2)). Give one row per target and one column per source.",
        id="weights",
    ),
    pytest.param(
        lambda: single(NEURON, [[np.inf]]),
        "projection 'touch' -> 'n': a weight is not a finite number. Train again, with a "
        "lower learning rate.",
        id="finite",
    ),
    pytest.param(
        lambda: integers(chip_cuba(), delay=THREE),
        "projection 'touch' -> 'n': the delays have the wrong shape ((3,) against (2, 2)). "
        "Give one delay, or one for each weight that is held.",
        id="delays",
    ),
    pytest.param(
        lambda: single(NEURON, sparse.csr_array([[1.0, 0.0]]), delay=np.array([[1, 2]])),
        "projection 'touch' -> 'n': the delays have the wrong shape ((1, 2) against (1,)). "
        "Give one delay, or one for each weight that is held.",
        id="sparse delays",
    ),
    pytest.param(
        lambda: single(NEURON, delay=0.5),
        "projection 'touch' -> 'n', delay: it must be an int or ndarray (got float 0.5). "
        "Correct it.",
        id="broken delay",
    ),
    pytest.param(
        lambda: single(NEURON, delay=-1),
        "projection 'touch' -> 'n': a delay is not a whole number of steps from 0 up. Round "
        "the delays.",
        id="early delay",
    ),
    pytest.param(
        lambda: replace(hybrid(), channels=CHANNELS + 1),
        "input 'touch_transposed': its location order is not a permutation of the channels. "
        "Visit every channel exactly once.",
        id="walk",
    ),
    pytest.param(
        # Every channel once, so nothing but the type of the numbers is wrong.
        lambda: visiting(walk=np.arange(CHANNELS, dtype=np.float64)),
        "input 'touch_transposed': its location order is not a permutation of the channels. "
        "Visit every channel exactly once.",
        id="walk in floats",
    ),
    pytest.param(
        lambda: visiting(walk=None),
        "input 'touch_transposed': its location order is not a permutation of the channels. "
        "Visit every channel exactly once.",
        id="no walk",
    ),
    pytest.param(
        lambda: visiting("time", walk=np.arange(CHANNELS)),
        "input 'touch': only a location axis has a location order. Leave it out.",
        id="walk over time",
    ),
    pytest.param(
        lambda: visiting("time", silence=1),
        "input 'touch': only a location axis has a location order. Leave it out.",
        id="silence over time",
    ),
    pytest.param(
        lambda: visiting(together=0),
        "input 'touch_transposed', together: it must be a whole number from 1 to 10000000 "
        "(got 0). Correct it.",
        id="none together",
    ),
    pytest.param(
        lambda: visiting(together=CHANNELS + 2),
        "input 'touch_transposed': channels visited together do not have equal lines of "
        "their own (6 of 4 channels on 12 lines). Give lines for every time step of each.",
        id="too many together",
    ),
    pytest.param(
        lambda: visiting(lines=STEPS + 1, together=2),
        "input 'touch_transposed': channels visited together do not have equal lines of "
        "their own (2 of 4 channels on 13 lines). Give lines for every time step of each.",
        id="lines that do not part",
    ),
    pytest.param(
        lambda: visiting(silence=-1),
        "input 'touch_transposed', silence: it must be a whole number from 0 to 10000000 "
        "(got -1). Correct it.",
        id="negative silence",
    ),
    pytest.param(
        two_walks,
        "model 'small-hybrid': its inputs do not give the location axis one number of steps "
        "(steps 4, 5). Give inputs of that axis that take equal steps.",
        id="two walks",
    ),
    pytest.param(
        lambda: visiting(own_phase="time"),
        "input 'touch_transposed': its phase 'time' has inputs or populations of the time "
        "axis. Give it the time axis, or another phase.",
        id="two axes in a phase of inputs",
    ),
    pytest.param(
        lambda: in_phase("location"),
        "population 'time_hidden': its phase 'location' has inputs or populations of the "
        "location axis. Give it the location axis, or another phase.",
        id="two axes in a phase of populations",
    ),
    pytest.param(
        lambda: replace(hybrid(), views=hybrid().views[:1]),
        "model 'small-hybrid': its inputs do not give the location axis one number of steps "
        "(steps of none). Give inputs of that axis that take equal steps.",
        id="no input",
    ),
    pytest.param(
        lambda: named("cup"),
        "model 'small-hybrid': its class names do not fit its classes (1 different ones "
        "against 2). Give a name of 1 to 80 printable characters for each class, from class 0 on.",
        id="few class names",
    ),
    pytest.param(
        lambda: named("cup", "jug", "can"),
        "model 'small-hybrid': its class names do not fit its classes (3 against 2). Give "
        "one for each class.",
        id="many class names",
    ),
    pytest.param(
        lambda: named("cup", "cup"),
        "model 'small-hybrid': its class names do not fit its classes (1 different ones "
        "against 2). Give a name of 1 to 80 printable characters for each class, from class 0 on.",
        id="same class names",
    ),
    pytest.param(
        lambda: named("cup", "jug\n"),
        "model 'small-hybrid': a class name cannot be used ('jug\\n'). Give a name of 1 to "
        "80 printable characters for each class, from class 0 on.",
        id="odd class names",
    ),
    pytest.param(
        lambda: replace(hybrid(), populations=hybrid().populations[:1] * 2),
        "population 'time_hidden': the name is taken. Rename it.",
        id="name",
    ),
]


@pytest.mark.parametrize(("make", "message"), BROKEN_RULES)
def test_a_network_that_breaks_a_rule_is_refused(make, message):
    network = make()
    with pytest.raises(InputError) as error:
        check_network(network)
    assert str(error.value) == message


@pytest.mark.parametrize(
    "make",
    [
        pytest.param(hybrid, id="hybrid"),
        pytest.param(lambda: hybrid(together=2, silence=3), id="together"),
        pytest.param(lambda: on_grid(seed=1), id="on grid"),
        pytest.param(lif, id="lif"),
        pytest.param(lambda: with_tie_class(1), id="class for ties"),
        pytest.param(lambda: lif(bias=np.array([0.0, 1e100])), id="large bias"),
        pytest.param(lambda: integers(chip_cuba()), id="chip cuba"),
        pytest.param(lambda: integers(tapped()), id="taps"),
        pytest.param(lambda: integers(joined()), id="dendrite"),
        pytest.param(lambda: integers(replace(joined(), dendrites=2), dendrite=1), id="paired"),
    ],
)
def test_sound_networks_are_accepted(make):
    check_network(make())


WEIGHTS = np.array([[0.0, 2.0, 0.0], [-3.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    "form", [np.array, sparse.csr_array, sparse.coo_array], ids=["dense", "csr", "coo"]
)
@pytest.mark.parametrize("dtype", [np.int64, np.float64])
def test_both_forms_of_a_matrix_mean_the_same(form, dtype):
    m = matrix(form(WEIGHTS), dtype)
    # Ordered by source, as the chip stores synapses, then by target.
    target, source, index = connections(m)
    assert target.tolist() == [1, 0, 1]
    assert source.tolist() == [0, 1, 2]
    assert values_of(m).ravel()[index].tolist() == [-3.0, 2.0, 1.0]
    assert fan_out(m).tolist() == [1, 1, 1]
    assert row_maxima(m).tolist() == [2.0, 3.0]
    spikes = np.array([[[1, 0, 1], [0, 1, 0]]], dtype=np.uint8)
    assert charge(spikes, m).tolist() == [[[0, -2], [2, 0]]]
    assert charge(spikes, m).dtype == dtype
    doubled = with_values(m, values_of(m) * of_target(m, [2, 10]).astype(dtype))
    assert charge(spikes, doubled).tolist() == [[[0, -20], [4, 0]]]


@pytest.mark.parametrize("form", [np.array, sparse.csr_array], ids=["dense", "sparse"])
def test_a_matrix_cannot_be_written_to(form):
    m = matrix(form(WEIGHTS), np.float64)
    with pytest.raises(ValueError, match="read-only"):
        values_of(m)[...] = 1


def test_a_stored_weight_of_zero_is_no_synapse():
    m = sparse.csr_array(([3.0, 0.0, -5.0], ([0, 1, 1], [0, 0, 1])), shape=(2, 2))
    assert fan_out(m).tolist() == [1, 1]


def test_the_sum_of_a_row_is_that_of_the_larger_sign():
    """Positive and negative weights are summed separately, and the larger magnitude counts."""
    assert row_sums(np.array([[3.0, -2.0, 1.0], [1.0, -4.0, 0.0]])).tolist() == [4.0, 4.0]


def test_entries_given_twice_are_added():
    m = matrix(sparse.coo_array(([1.0, 2.0], ([0, 0], [1, 1])), shape=(1, 2)), np.float64)
    assert values_of(m).tolist() == [3.0]


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"steps": 2.5},
            "Network, steps: it must be a whole number from 1 to 10000000 (got 2.5). Correct it.",
        ),
        ({"views": (1,)}, "Network, views: it must be an InputView (got int 1). Correct it."),
        (
            {"populations": None},
            "Network, populations: it must be a tuple (got NoneType None). Correct it.",
        ),
        ({"readout": "n"}, "Network, readout: it must be a Readout (got str 'n'). Correct it."),
        ({"psi": "x"}, "Network, psi: it must be a number of at least 0 (got 'x'). Correct it."),
        (
            {"steps": 2**31},
            "Network, steps: it must be a whole number from 1 to 10000000 (got 2147483648). "
            "Correct it.",
        ),
        (
            {"step_seconds": 1e300},
            "Network, step_seconds: it must be a number above 0 and at most 1e+06 (got 1e+300). "
            "Correct it.",
        ),
        (
            {"any_length": "no"},
            "Network, any_length: it must be a bool (got str 'no'). Correct it.",
        ),
        (
            {"class_names": (1, 2)},
            "Network, class_names: it must be a str (got int 1). Correct it.",
        ),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_fields_of_a_network_have_their_types(changes, line):
    with pytest.raises(InputError) as caught:
        check_network(replace(lif(), **changes))
    assert str(caught.value) == line


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        (
            {"size": "2"},
            "population 'n', size: it must be a whole number from 1 to 10000000 (got '2'). "
            "Correct it.",
        ),
        # Not a wrong type: a readout reads no helper, so it finds no population to take the number of classes from.
        (
            {"helper": True},
            "readout: its populations or weights do not fit together (populations ('n',), sizes "
            "[], weights (1.0,)). Name populations of one size, each with its weight.",
        ),
        (
            {"axis": np.ones(2)},
            "population 'n', axis: it must be a str (got ndarray array([1., 1.])). Correct it.",
        ),
        ({"axis": "tme"}, "population 'n', axis: there is no 'tme'. Did you mean 'time'?"),
        (
            {"neuron": None},
            "population 'n', neuron: it must be a Neuron (got NoneType None). Correct it.",
        ),
    ],
    ids=["size", "helper", "axis", "no such axis", "neuron"],
)
def test_fields_of_a_population_have_their_types(changes, line):
    network = lif()
    with pytest.raises(InputError) as caught:
        check_network(replace(network, populations=(replace(network.populations[0], **changes),)))
    assert str(caught.value) == line


def test_lists_stand_for_tuples_and_numpy_numbers_for_numbers():
    network = lif()
    network = replace(
        network, steps=np.int64(network.steps), psi=np.float32(10), views=list(network.views)
    )
    check_network(network)
    assert type(network.steps) is int
    assert type(network.psi) is float


SRM = SrmAlpha(theta=10.0, tau_sr=10.0, tau_ref=1.0, scale_ref=2.0)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"theta": None}, "SrmAlpha, theta: it must be a float (got NoneType None). Correct it."),
        (
            {"theta": 10**400},
            "SrmAlpha, theta: it is too large for a float (1329 bits). Correct it.",
        ),
        ({"tau_sr": 1j}, "SrmAlpha, tau_sr: it must be a float (got complex 1j). Correct it."),
        ({"eps_taps": -1}, "population 'n': eps_taps must be from 1 to 100000 (-1). Correct it."),
        (
            {"nu_taps": math.nan},
            "population 'n': nu_taps must be from 1 to 100000 (nan). Correct it.",
        ),
    ],
    ids=["nothing", "beyond floats", "complex", "no taps", "taps that are no number"],
)
def test_parameters_of_a_neuron_are_checked(changes, line):
    with pytest.raises(InputError) as caught:
        check_network(single(replace(SRM, **changes)))
    assert str(caught.value) == line


@pytest.mark.parametrize("tau", [2**63, 1e90], ids=["beyond 64 bits", "far beyond"])
def test_a_very_long_refractory_kernel_has_a_count_of_steps(tau):
    """The count is cut to the chip's largest later; to compute it must not overflow.

    It is about e * scale_ref * tau_ref, the sum of the kernel, and here scale_ref is 2.
    """
    count = refractory_count(replace(SRM, tau_ref=tau), decay=DECAY_OF_10)
    assert count == pytest.approx(2 * math.e * tau)


NO_STEP = "readout: potentials_from is not a step ({}). Give a step from 0 up, or one or None for each population."


@pytest.mark.parametrize(
    ("first", "message"),
    [
        pytest.param(-1, NO_STEP.format("-1"), id="negative"),
        pytest.param(2**63, NO_STEP.format("9223372036854775808"), id="beyond 64 bits"),
        pytest.param((), NO_STEP.format("()"), id="no step for the one population"),
        pytest.param([], NO_STEP.format("[]"), id="an empty list"),
        pytest.param((None, 3), NO_STEP.format("(None, 3)"), id="two steps for one population"),
        pytest.param(
            (0.5,),
            "Readout, potentials_from: it must be an int (got float 0.5). Correct it.",
            id="fraction",
        ),
    ],
)
def test_the_first_step_of_potentials_must_be_a_step(first, message):
    network = lif()
    with pytest.raises(InputError) as caught:
        check_network(replace(network, readout=replace(network.readout, potentials_from=first)))
    assert str(caught.value) == message
