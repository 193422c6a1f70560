"""Potentials of several populations are added in one unit, whatever scale each has in its registers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

import hw_model as hw
from hw_model.mapping.graph import Readout
from hw_model.program.text import compartments_text
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba
from locsnn_compile.network.projections import Projection
from locsnn_compile.pipeline import lower
from locsnn_compile.reference.evaluate import evaluate
from locsnn_compile.report.figures.document import report_figures
from locsnn_compile.report.gates import check_gates
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.report.sections.verdict import matches
from locsnn_compile.verification.matching import compare
from locsnn_compile.verification.observation import Observed

RNG = np.random.default_rng(5)


def two_outputs(threshold: float = 40.0) -> Network:
    """Outputs that are read, of weights 30 times as large in one population as in the other; at 40 they never spike."""
    sizes, rng = {"small": 1.0, "large": 30.0}, np.random.default_rng(5)
    return Network(
        name="two outputs",
        channels=8,
        steps=6,
        step_seconds=None,
        sensor=None,
        views=(InputView("touch", "time", 8),),
        populations=tuple(
            Population(name, "time", 3, Cuba.of(3, decay_v=0.5, threshold=threshold * size))
            for name, size in sizes.items()
        ),
        projections=tuple(
            Projection("touch", name, size * rng.normal(size=(3, 8)))
            for name, size in sizes.items()
        ),
        readout=Readout(tuple(sizes), (1.0, 0.1), potentials_from=5),
        sha256="0" * 64,
    )


def test_scores_of_the_chip_are_those_of_the_network() -> None:
    network, x = two_outputs(), (RNG.random((40, 6, 8)) < 0.4).astype(np.uint8)
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8)
    scales = [levels.quantized.population(name).scale[0] for name in ("small", "large")]
    assert scales[0] > 10 * scales[1]
    wanted, played = evaluate(network, x).scores, np.asarray(hw.simulate(levels.program, x).scores)
    assert np.array_equal(played, evaluate(levels.quantized.on_grid(), x).scores)
    weights = levels.program.readout.weights
    assert (min(weights), all(weight.is_integer() for weight in weights)) == (16_384, True)
    assert np.abs(played / (scales[0] * weights[0]) - wanted).max() < 0.02 * np.abs(wanted).max()


def test_weights_that_are_a_little_wrong_show_in_scores_where_no_class_and_no_spike_tells() -> None:
    network, x = two_outputs(), (np.random.default_rng(0).random((40, 6, 8)) < 0.4).astype(np.uint8)
    wrong = tuple(
        replace(p, weights=p.weights * [[1.05], [1.0], [0.95]]) for p in network.projections
    )
    levels, other = (
        lower(one, hw.chip("loihi-sim"), weight_bits=8)
        for one in (network, replace(network, projections=wrong))
    )
    right, fault = (
        compare(Observed(replace(levels, program=program), x))
        for program in (levels.program, other.program)
    )
    for match in (right, fault):
        assert (match.prediction_agreement, match.first_divergence) == (1.0, None)
    assert right.scores.relative_error < 0.01
    assert fault.scores.relative_error == pytest.approx(0.111, abs=0.001)

    report = report_figures(levels, fault, Grounds(0.02, "given", ()))
    assert report.match.score_error == fault.scores.relative_error
    spread = fault.scores.mean_spread
    assert report.match.class_scores.mean_spread == spread
    assert report.match.class_scores.mean_error == pytest.approx(0.111 * spread, rel=0.01)
    said = matches(report)
    assert (said.status, said.answer) == ("nearly", "Nearly, in every prediction")
    assert [
        gate.holds
        for gate in check_gates(report, {"--min-agreement": 1.0, "--max-score-error": 0.05})
    ] == [
        True,
        False,
    ]


@pytest.mark.parametrize("weights", [(1.0, 0.1), (0.3, -0.7), (0.0, 2.0)], ids=str)
@pytest.mark.parametrize("potentials", [5, (None, 5), None], ids=["potentials", "both", "spikes"])
def test_scores_are_compared_in_the_units_of_the_network(weights, potentials) -> None:
    x = (np.random.default_rng(1).random((20, 6, 8)) < 0.4).astype(np.uint8)
    network = two_outputs(40.0 if potentials == 5 else 0.125)
    network = replace(
        network, readout=replace(network.readout, weights=weights, potentials_from=potentials)
    )
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8)
    found = hw.simulate(levels.program, x).scores / levels.quantized.score_scale
    wanted = evaluate(network, x).scores
    assert np.count_nonzero(wanted) >= 5
    assert (
        np.abs(found - wanted).mean()
        <= 0.01 * np.abs(wanted - wanted.mean(axis=1, keepdims=True)).mean()
    )


def test_spikes_and_potentials_are_added_in_whole_numbers(tmp_path) -> None:
    """A spike counts 1 and a potential 1 over its scale, to a part in 32,768; the file and the text say which is which."""
    network, x = two_outputs(), (RNG.random((40, 6, 8)) < 0.4).astype(np.uint8)
    network = replace(
        network, readout=replace(network.readout, weights=(0.3, -0.7), potentials_from=(None, 5))
    )
    levels = lower(network, hw.chip("loihi-sim"), weight_bits=8)
    spikes, potential = levels.program.readout.weights
    scale = levels.quantized.population("large").scale[0]
    assert (spikes, potential) == (round(spikes), -16_384)
    assert abs(spikes / potential * -0.7 / scale / 0.3 - 1) < 2**-15
    played = hw.simulate(levels.program, x)
    assert np.array_equal(played.scores, np.rint(played.scores))
    for engine in ("reference", "fast"):
        assert np.array_equal(hw.simulate(levels.program, x, engine=engine).scores, played.scores)
    assert np.array_equal(played.scores, evaluate(levels.quantized.on_grid(), x).scores)
    levels.program.save(tmp_path)
    loaded = hw.load_program(tmp_path)
    assert loaded.readout == levels.program.readout
    assert yaml.safe_load((tmp_path / "program.yaml").read_text())["readout_potentials_from"] == {
        "large": 5
    }
    assert (
        f"readout: {spikes:g} * spikes of small + -16384 * largest potential, from step 5 on, of large"
        in compartments_text(levels.compartments)
    )
