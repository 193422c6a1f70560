"""Files that are read, written and read again: every number stays, and the network spikes as before."""

import nir
import numpy as np
import pytest

import locsnn_compile as lc
from hw_model import chip
from locsnn_compile.backends.exchange import exchange_file
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.reference.evaluate import evaluate
from tests.support.datasets import assert_equal_datasets, datasets_of
from tests.support.net_files import NETS, write_net
from tests.support.nir_graphs import DT, graphs, random_spikes

GRAPHS = graphs()
CHIP = chip("loihi-sim")


@pytest.mark.parametrize("name", GRAPHS)
def test_a_nir_graph_that_is_read_and_written_loses_nothing(name, tmp_path):
    nir.write(tmp_path / "before.nir", GRAPHS[name][0])
    network = lc.load(tmp_path / "before.nir", dt=DT)
    (tmp_path / "after.nir").write_bytes(exchange_file("nir", quantize(network, CHIP)))
    assert_equal_datasets(
        datasets_of(tmp_path / "before.nir", "node"), datasets_of(tmp_path / "after.nir", "node")
    )
    assert set(nir.read(tmp_path / "after.nir", type_check=False).nodes) == set(
        GRAPHS[name][0].nodes
    )


@pytest.mark.parametrize("name", NETS)
def test_a_lava_dl_file_that_is_read_and_written_loses_nothing(name, tmp_path):
    write_net(tmp_path / "before.net", NETS[name])
    network = lc.load(tmp_path / "before.net")
    (tmp_path / "after.net").write_bytes(exchange_file("net", quantize(network, CHIP)))
    assert_equal_datasets(
        datasets_of(tmp_path / "before.net", "layer"), datasets_of(tmp_path / "after.net", "layer")
    )


def test_the_quantised_integers_are_in_the_metadata(tmp_path):
    nir.write(tmp_path / "before.nir", GRAPHS["two layers"][0])
    quantized = quantize(lc.load(tmp_path / "before.nir", dt=DT), CHIP)
    (tmp_path / "after.nir").write_bytes(exchange_file("nir", quantized))
    metadata = nir.read(tmp_path / "after.nir", type_check=False).metadata
    for k, p in enumerate(quantized.projections):
        dense = np.zeros(p.mantissa.shape, dtype=int)
        dense[
            metadata[f"quantized.projection{k}.rows"], metadata[f"quantized.projection{k}.columns"]
        ] = metadata[f"quantized.projection{k}.mantissa"]
        np.testing.assert_array_equal(dense, p.mantissa)
    for q in quantized.populations:
        np.testing.assert_array_equal(
            metadata[f"quantized.{q.population.name}.decay_v"], q.neuron.decay_v
        )


@pytest.mark.parametrize(
    "name", ["dense", "bias", "one delay", "delay of a neuron", "recurrent", "conv"]
)
def test_a_net_as_nir_has_the_same_constants(name, tmp_path):
    write_net(tmp_path / "model.net", NETS[name])
    network = lc.load(tmp_path / "model.net")
    (tmp_path / "model.nir").write_bytes(exchange_file("nir", quantize(network, CHIP)))
    read_back = lc.load(tmp_path / "model.nir")
    for before in network.populations:
        after = next(p.neuron for p in read_back.populations if p.name == before.name)
        np.testing.assert_allclose(4096 * after.decay_v, before.neuron.decay_v)
        np.testing.assert_allclose(after.threshold, 64 * before.neuron.threshold)
    events = random_spikes((network.channels,))[None]
    first = network.populations[0].name
    exact, floats = (evaluate(n, events).spikes[first] for n in (network, read_back))
    assert (exact & floats).sum() > 0.9 * exact.sum()


def chain(*mantissas):
    """Return a network in integers: one layer behind ten channels, with one format per matrix of mantissas."""
    cells = lc.ChipCuba.of(3, decay_u=1024, decay_v=128, threshold=100)
    projections = tuple(
        lc.ChipProjection("touch", "cells", m, exponent, 8) for exponent, m in enumerate(mantissas)
    )
    touch, readout = lc.InputView("touch", "time", 10), lc.Readout(("cells",), (1.0,))
    return quantize(
        lc.Network(
            "chain",
            10,
            40,
            (touch,),
            (lc.Population("cells", "time", 3, cells),),
            projections,
            readout,
        ),
        CHIP,
    )


# The even mantissas that lava-dl needs.
EVEN = 2 * np.random.default_rng(5).integers(-60, 128, (3, 10))


def test_integers_go_to_lava_dl_and_back_spike_for_spike(tmp_path):
    quantized = chain(EVEN)
    (tmp_path / "model.net").write_bytes(exchange_file("net", quantized))
    events = random_spikes((10,))[None]
    spikes = evaluate(lc.load(tmp_path / "model.net"), events).spikes["layer1"]
    assert spikes.any()
    np.testing.assert_array_equal(spikes, evaluate(quantized.on_grid(), events).spikes["cells"])


@pytest.mark.parametrize(
    ("mantissas", "what"),
    [
        ((EVEN + 1,), "its weights are not even numbers of 8 bits (-119..255 against -256..254)"),
        ((EVEN, 64 * (EVEN > 0)), "its weights have several formats"),
    ],
    ids=["odd", "formats"],
)
def test_weights_that_lava_dl_has_no_place_for(mantissas, what):
    """The message names the reason: fewer weight bits would not make odd weights even, nor join two formats."""
    with pytest.raises(lc.InputError) as caught:
        exchange_file("net", chain(*mantissas))
    assert str(caught.value) == f"--emit net, population 'cells': {what}. Emit another kind."


def test_float_weights_above_their_threshold_do_not_go_to_lava_dl(tmp_path):
    nir.write(tmp_path / "model.nir", GRAPHS["lif"][0])
    with pytest.raises(lc.InputError, match="not even numbers of 8 bits"):
        exchange_file("net", quantize(lc.load(tmp_path / "model.nir", dt=DT), CHIP, weight_bits=6))
