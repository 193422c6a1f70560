"""Readouts and inputs of networks made by hand, written as NIR and ``.net``: read back unchanged, or refused.

The float reference plays the original network and the one that is read back from the file.
"""

from dataclasses import replace

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model import chip
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.reference.evaluate import evaluate

CHIP = chip("loihi-sim")
RNG = np.random.default_rng(8)
STEPS = 40
GIVEN = (RNG.random((6, STEPS, 10)) < 0.2).astype(np.uint8)
"""Events, (recordings, steps, channels)."""
WEIGHTS = RNG.normal(0.2, 0.6, (6, 10)), RNG.normal(0, 1, (4, 6)), RNG.normal(0, 1, (4, 10))
"""Float weights from the input to the first layer, from there to the second, and from the input to the second."""
EVEN = tuple(2 * np.rint(20 * weights).astype(int) for weights in WEIGHTS)
"""The same as even mantissas, which lava-dl needs."""
HELD = "program.yaml holds it, and --emit network shows it."
"""The advice of most refusals."""
INPUTS = tuple(lc.InputView(name, "time", 10) for name in ("touch", "read_back"))


def floats(size, **options):
    """Float neurons without a current; by default they lose a fifth per step."""
    return lc.Cuba.of(size, **{"decay_u": 1.0, "decay_v": 0.2, "threshold": 1.0} | options)


def integers(size, **options):
    """Neurons in the chip's integers, without a current; by default they lose 400 of 4096 parts per step."""
    return lc.ChipCuba.of(size, **{"decay_u": 4096, "decay_v": 400, "threshold": 60} | options)


def silent(size, **options):
    """Neurons that never spike, by a threshold that nothing reaches."""
    return floats(size, threshold=1e6, **options)


def network(second, first=None, skip=False, inputs=INPUTS[:1], **readout):
    """Return a network of two layers, whose second layer has the neurons ``second``.

    All ``inputs`` reach the first layer; with ``skip``, the first input also reaches the second layer. ``readout`` are
    fields of the readout that differ from spikes of the second layer.
    """
    default_neurons = integers if second.on_grid else floats
    one = lc.Population("one", "time", 6, first or default_neurons(6))
    two = lc.Population("two", "time", 4, second)
    input_to_one, one_to_two, input_to_two = EVEN if second.on_grid else WEIGHTS

    def projection(source, target, weights):
        if second.on_grid:
            return lc.ChipProjection(source, target, weights, 0, 8, "mixed")
        return lc.Projection(source, target, weights)

    projections = [projection(view.name, "one", input_to_one) for view in inputs]
    projections.append(projection("one", "two", one_to_two))
    if skip:
        projections.append(projection("touch", "two", input_to_two))
    return lc.Network(
        "by hand",
        channels=10,
        steps=STEPS,
        views=inputs,
        populations=(one, two),
        projections=tuple(projections),
        readout=lc.Readout(**{"populations": ("two",), "weights": (1.0,)} | readout),
        any_length=True,
    )


def emitted(kind, original, tmp_path):
    """Quantise a network, write it as a ``kind`` of file, and return the network that is read from the file."""
    path = tmp_path / f"model.{kind}"
    path.write_bytes(exchange_file(kind, quantize(original, CHIP)))
    return lc.load(path)


HOLDS = {
    "nir, LI": ("nir", network(silent(4), potentials_from=2)),
    "nir, CubaLI": ("nir", network(silent(4, decay_u=0.5), potentials_from=2)),
    "nir, several decays": (
        "nir",
        network(silent(4, decay_v=[0.1, 0.2, 0.3, 1.0]), potentials_from=2),
    ),
    "nir, past a layer": ("nir", network(silent(4), skip=True, potentials_from=1)),
    "nir, integers that must not spike": (
        "nir",
        network(integers(4, threshold=2**17 - 1), potentials_from=2),
    ),
    "nir, integers that nothing leads to spike": (
        "nir",
        network(integers(4, threshold=90_000), potentials_from=2),
    ),
    "nir, spikes": ("nir", network(floats(4))),
    "nir, two inputs": ("nir", network(floats(4), inputs=INPUTS)),
    "net, potentials": ("net", network(integers(4, threshold=90_000), potentials_from=2)),
    "net, potentials with biases": (
        "net",
        network(
            integers(4, threshold=90_000, bias_mantissa=[1, 0, 2, 3], bias_exponent=6),
            potentials_from=2,
        ),
    ),
    "net, spikes": ("net", network(integers(4))),
}


@pytest.mark.parametrize("name", HOLDS)
def test_what_a_format_holds_reads_back_as_it_was(name, tmp_path):
    """The channels, the kind of readout and the class scores are those of the original network."""
    kind, original = HOLDS[name]
    read_back = emitted(kind, original, tmp_path)
    assert read_back.channels == original.channels
    assert bool(read_back.readout.from_step) == bool(original.readout.from_step)
    assert read_back.readout.weights == (1.0,)
    # A reader delays the shorter of two paths, and so the whole second layer by one step.
    steps_late = 1 if "past a layer" in name else 0
    before = evaluate(original, GIVEN[:, : STEPS - steps_late])
    after = evaluate(read_back, GIVEN)
    assert np.ptp(before.scores) > 0
    tolerances = {"rtol": 1e-9, "atol": 1e-9}
    if original.populations[1].on_grid and kind == "nir":
        # Integers become floats, which are not truncated after a decay: within 40 units of 64.
        tolerances = {"rtol": 0.05, "atol": 40 * 64}
    np.testing.assert_allclose(after.scores, before.scores, **tolerances)
    np.testing.assert_array_equal(after.prediction, before.prediction)


def read(*populations, **options):
    """Return fields of a readout of these populations."""
    return {"populations": populations, "weights": (1.0,) * len(populations)} | options


UNLEAKY = "a state that never decays has no time constant"
LATE = "counts potentials of 'two' from another step"
BOUND = "neurons that NIR reads by potential have no biases and never spike"
REFUSED = [
    pytest.param(
        "nir",
        network(floats(4), weights=(2.0,)),
        f"nir, readout: the format cannot weigh what is read out (weights 2). {HELD}",
        id="nir, a weight",
    ),
    pytest.param(
        "net",
        network(integers(4), weights=(-1.0,)),
        f"net, readout: the format cannot weigh what is read out (weights -1). {HELD}",
        id="net, a weight",
    ),
    pytest.param(
        "nir",
        network(silent(4), potentials_from=0),
        f"nir, readout: NIR {LATE} (2 against 0). {HELD}",
        id="nir, another step",
    ),
    pytest.param(
        "nir",
        network(silent(4), skip=True, potentials_from=2),
        f"nir, readout: NIR {LATE} (1 against 2). {HELD}",
        id="nir, a later step",
    ),
    pytest.param(
        "net",
        network(integers(4, threshold=90_000), potentials_from=3),
        f"net, readout: lava-dl counts potentials from another step (2 against 3). {HELD}",
        id="net, another step",
    ),
    pytest.param(
        "nir",
        network(floats(4, threshold=3.0), potentials_from=2),
        f"nir, population 'two': {BOUND}. {HELD}",
        id="nir, spikes of what is read",
    ),
    pytest.param(
        "nir",
        network(silent(4, bias=0.1), potentials_from=2),
        f"nir, population 'two': {BOUND}. {HELD}",
        id="nir, biases of what is read",
    ),
    pytest.param(
        "net",
        network(integers(4), potentials_from=2),
        "net, population 'two': neurons that lava-dl reads by potential never spike, and "
        f"these may. {HELD}",
        id="net, spikes of what is read",
    ),
    pytest.param(
        "nir",
        network(silent(4, decay_v=0.0), potentials_from=2),
        f"nir, population 'two': {UNLEAKY}. Emit another kind.",
        id="nir, no leak",
    ),
    pytest.param(
        "nir",
        network(floats(4), silent(6), **read("one", potentials_from=1)),
        "nir, population 'one': NIR sends no spikes on from neurons that it reads by "
        f"potential. {HELD}",
        id="nir, a readout that sends on",
    ),
    pytest.param(
        "net",
        network(integers(4), **read("one")),
        f"net, readout: lava-dl reads out the last layer (one). {HELD}",
        id="net, an inner layer",
    ),
    pytest.param(
        "net",
        network(integers(4), inputs=INPUTS),
        "net: lava-dl has one input (2 against 1). Emit nir, or give the network one input.",
        id="net, two inputs",
    ),
]


@pytest.mark.parametrize(("kind", "original", "line"), REFUSED)
def test_what_a_format_cannot_hold_is_refused(kind, original, line):
    with pytest.raises(lc.InputError) as caught:
        exchange_file(kind, quantize(original, CHIP))
    assert str(caught.value) == f"--emit {line}"


@pytest.mark.parametrize(
    ("kind", "readout", "line"),
    [
        (
            "nir",
            {"potentials_from": (None, 2)},
            f"nir, readout: NIR cannot add spikes and potentials. {HELD}",
        ),
        ("net", {}, f"net, readout: lava-dl reads out the last layer (one, two). {HELD}"),
    ],
    ids=["nir, spikes and potentials", "net, two layers"],
)
def test_several_populations_that_a_format_cannot_read_out(kind, readout, line):
    original = network(integers(4, threshold=90_000))
    one = replace(original.populations[0], size=4, neuron=integers(4))
    parts = (
        replace(original.projections[0], mantissa=EVEN[2]),
        replace(original.projections[1], mantissa=EVEN[1][:, :4]),
    )
    original = replace(original, populations=(one, original.populations[1]), projections=parts)
    original = replace(original, readout=lc.Readout(("one", "two"), (1.0, 1.0), **readout))
    with pytest.raises(lc.InputError) as caught:
        exchange_file(kind, quantize(original, CHIP))
    assert str(caught.value) == f"--emit {line}"


@pytest.mark.parametrize("kind", ["nir", "net"])
def test_a_class_for_ties_is_refused(kind):
    original = network(integers(4))
    original = replace(original, readout=replace(original.readout, tie_class=1))
    with pytest.raises(lc.InputError) as caught:
        exchange_file(kind, quantize(original, CHIP))
    assert str(caught.value) == (
        f"--emit {kind}, readout: the format cannot name a class for ties (class 1). {HELD}"
    )


def test_weights_below_a_mantissa_are_written_as_the_chip_adds_them(tmp_path):
    """With an exponent below 0, the chip loses low bits of a mantissa, so the file must not have them either."""
    original = network(integers(4))
    odd = replace(original.projections[0], mantissa=EVEN[0] + 1, exponent=-1, signs="apart")
    original = replace(original, projections=(odd, original.projections[1]))
    read_back = emitted("nir", original, tmp_path)
    weights = np.asarray(read_back.projections[0].weights) * 1.0
    # A charge is 64 floor(mantissa 2^exponent).
    np.testing.assert_allclose(weights, 64 * np.floor((EVEN[0] + 1) / 2))
