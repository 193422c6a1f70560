"""Readouts and inputs of networks made by hand, written as NIR and ``.net``: read back as they were, or refused."""

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
GIVEN = (RNG.random((6, 40, 10)) < 0.2).astype(np.uint8)
WEIGHTS = RNG.normal(0.2, 0.6, (6, 10)), RNG.normal(0, 1, (4, 6)), RNG.normal(0, 1, (4, 10))
EVEN = tuple(2 * np.rint(20 * weights).astype(int) for weights in WEIGHTS)
HELD = "program.yaml holds it, and --emit network shows it."
INPUTS = tuple(lc.InputView(name, "time", 10) for name in ("touch", "again"))


def floats(size, **given):
    """Float neurons without a current; by default they lose a fifth per step."""
    return lc.Cuba.of(size, **{"decay_u": 1.0, "decay_v": 0.2, "threshold": 1.0} | given)


def integers(size, **given):
    """Neurons in the chip's integers, without a current; by default they lose 400 of 4096 parts per step."""
    return lc.ChipCuba.of(size, **{"decay_u": 4096, "decay_v": 400, "threshold": 60} | given)


def silent(size, **given):
    """Neurons that never spike, by a threshold that nothing reaches."""
    return floats(size, threshold=1e6, **given)


def network(second, first=None, skip=False, inputs=INPUTS[:1], **readout):
    """Two layers, with a second input onto the first layer if there is one, and one past it if asked for."""
    make = integers if second.on_grid else floats
    one = lc.Population("one", "time", 6, first or make(6))
    two = lc.Population("two", "time", 4, second)
    held = EVEN if second.on_grid else WEIGHTS

    def joined(source, target, weights):
        kind = lc.ChipProjection if second.on_grid else lc.Projection
        return kind(source, target, weights, *((0, 8, "mixed") if second.on_grid else ()))

    parts = [joined(view.name, "one", held[0]) for view in inputs] + [joined("one", "two", held[1])]
    parts += [joined("touch", "two", held[2])] if skip else []
    read = lc.Readout(**{"populations": ("two",), "weights": (1.0,)} | readout)
    return lc.Network("by hand", 10, 40, inputs, (one, two), tuple(parts), read, any_length=True)


def emitted(kind, made, tmp_path):
    """Return the network that a reader finds in what is emitted."""
    path = tmp_path / f"model.{kind}"
    path.write_bytes(exchange_file(kind, quantize(made, CHIP)))
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
    """Potentials became spikes, and two inputs became one of twice the channels."""
    kind, made = HOLDS[name]
    again = emitted(kind, made, tmp_path)
    assert again.channels == made.channels
    assert bool(again.readout.from_step) == bool(made.readout.from_step)
    assert again.readout.weights == (1.0,)
    late = (
        "past a layer" in name
    )  # a reader delays what takes the shorter path, and with it the whole layer
    before, after = evaluate(made, GIVEN[:, : 40 - late]), evaluate(again, GIVEN)
    assert np.ptp(before.scores) > 0
    # Integers that become floats are no longer truncated.
    rounded = made.populations[1].on_grid and kind == "nir"
    np.testing.assert_allclose(
        after.scores, before.scores, rtol=0.05 if rounded else 1e-9, atol=2560 * rounded + 1e-9
    )
    np.testing.assert_array_equal(after.prediction, before.prediction)


def read(*populations, **given):
    return {"populations": populations, "weights": (1.0,) * len(populations)} | given


UNLEAKY = "a state that never decays has no time constant"
LATE = "counts potentials of 'two' from another step"
BOUND = "neurons that NIR reads by potential have no biases and never spike"
REFUSED = {
    "nir, a weight": ("nir", network(floats(4), weights=(2.0,)), f"nir, readout: the format cannot weigh what is read out (weights 2). {HELD}"),
    "net, a weight": ("net", network(integers(4), weights=(-1.0,)), f"net, readout: the format cannot weigh what is read out (weights -1). {HELD}"),
    "nir, another step": ("nir", network(silent(4), potentials_from=0), f"nir, readout: NIR {LATE} (2 against 0). {HELD}"),
    "nir, a later step": ("nir", network(silent(4), skip=True, potentials_from=2), f"nir, readout: NIR {LATE} (1 against 2). {HELD}"),
    "net, another step": ("net", network(integers(4, threshold=90_000), potentials_from=3), f"net, readout: lava-dl counts potentials from another step (2 against 3). {HELD}"),
    "nir, spikes of what is read": ("nir", network(floats(4, threshold=3.0), potentials_from=2), f"nir, population 'two': {BOUND}. {HELD}"),
    "nir, biases of what is read": ("nir", network(silent(4, bias=0.1), potentials_from=2), f"nir, population 'two': {BOUND}. {HELD}"),
    "net, spikes of what is read": ("net", network(integers(4), potentials_from=2), f"net, population 'two': neurons that lava-dl reads by potential never spike, and these may. {HELD}"),
    "nir, no leak": ("nir", network(silent(4, decay_v=0.0), potentials_from=2), f"nir, population 'two': {UNLEAKY}. Emit another kind."),
    "nir, a readout that sends on": ("nir", network(floats(4), silent(6), **read("one", potentials_from=1)), f"nir, population 'one': NIR sends no spikes on from neurons that it reads by potential. {HELD}"),
    "net, an inner layer": ("net", network(integers(4), **read("one")), f"net, readout: lava-dl reads out the last layer (one). {HELD}"),
    "net, two inputs": ("net", network(integers(4), inputs=INPUTS), "net: lava-dl has one input (2 against 1). Emit nir, or give the network one input."),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_a_format_cannot_hold_is_refused(name):
    kind, made, line = REFUSED[name]
    with pytest.raises(lc.InputError) as caught:
        exchange_file(kind, quantize(made, CHIP))
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
    made = network(integers(4, threshold=90_000))
    one = replace(made.populations[0], size=4, neuron=integers(4))
    parts = (
        replace(made.projections[0], mantissa=EVEN[2]),
        replace(made.projections[1], mantissa=EVEN[1][:, :4]),
    )
    made = replace(made, populations=(one, made.populations[1]), projections=parts)
    made = replace(made, readout=lc.Readout(("one", "two"), (1.0, 1.0), **readout))
    with pytest.raises(lc.InputError) as caught:
        exchange_file(kind, quantize(made, CHIP))
    assert str(caught.value) == f"--emit {line}"


@pytest.mark.parametrize("kind", ["nir", "net"])
def test_a_class_for_ties_is_refused(kind):
    made = network(integers(4))
    made = replace(made, readout=replace(made.readout, tie_class=1))
    with pytest.raises(lc.InputError) as caught:
        exchange_file(kind, quantize(made, CHIP))
    assert str(caught.value) == (
        f"--emit {kind}, readout: the format cannot name a class for ties (class 1). {HELD}"
    )


def test_weights_below_a_mantissa_are_written_as_the_chip_adds_them(tmp_path):
    """An exponent below 0 loses low bits; the file had these bits."""
    made = network(integers(4))
    odd = replace(made.projections[0], mantissa=EVEN[0] + 1, exponent=-1, signs="apart")
    made = replace(made, projections=(odd, made.projections[1]))
    again = emitted("nir", made, tmp_path)
    weights = np.asarray(again.projections[0].weights) * 1.0
    np.testing.assert_allclose(weights, 64 * np.floor((EVEN[0] + 1) / 2))
