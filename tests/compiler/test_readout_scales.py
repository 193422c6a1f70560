"""Readouts by potentials: scores of several populations are added in the same unit, although their scales differ.

A scale is how many units of the registers a potential of 1 becomes; the compiler divides it out of the weights of the
readout, which are whole numbers on the chip.
"""

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

CHIP = hw.chip("loihi-sim")
CHANNELS = 8
STEPS = 6
SMALLEST_WEIGHT = 16_384
"""The chip's readout weights are scaled so that the smallest has this magnitude, 2^14, which rounds all of them finely."""


def touches(seed: int, recordings: int = 40) -> np.ndarray:
    """Return random recordings (recordings, steps, channels) with events in 40 % of the bins."""
    random = np.random.default_rng(seed).random((recordings, STEPS, CHANNELS))
    return (random < 0.4).astype(np.uint8)


def two_outputs(threshold: float = 40.0) -> Network:
    """Return two populations of outputs, one with 30 times the weights and threshold of the other.

    At the threshold of 40 they never spike. They are read out by their potentials in the last step.
    """
    sizes = {"small": 1.0, "large": 30.0}
    rng = np.random.default_rng(5)
    return Network(
        name="two outputs",
        channels=CHANNELS,
        steps=STEPS,
        step_seconds=None,
        sensor=None,
        views=(InputView("touch", "time", CHANNELS),),
        populations=tuple(
            Population(name, "time", 3, Cuba.of(3, decay_v=0.5, threshold=threshold * size))
            for name, size in sizes.items()
        ),
        projections=tuple(
            Projection("touch", name, size * rng.normal(size=(3, CHANNELS)))
            for name, size in sizes.items()
        ),
        readout=Readout(tuple(sizes), (1.0, 0.1), potentials_from=5),
        sha256="0" * 64,
    )


def test_scores_of_the_chip_are_those_of_the_network() -> None:
    network = two_outputs()
    played = touches(seed=5)
    levels = lower(network, CHIP, weight_bits=8)
    scale_of_small = levels.quantized.population("small").scale[0]
    scale_of_large = levels.quantized.population("large").scale[0]
    assert scale_of_small > 10 * scale_of_large
    expected = evaluate(network, played).scores
    chip_scores = np.asarray(hw.simulate(levels.program, played).scores)
    assert np.array_equal(chip_scores, evaluate(levels.quantized.on_grid(), played).scores)
    weights = levels.program.readout.weights
    assert min(weights) == SMALLEST_WEIGHT
    assert all(weight.is_integer() for weight in weights)
    in_units_of_network = chip_scores / (scale_of_small * weights[0])
    assert np.abs(in_units_of_network - expected).max() < 0.02 * np.abs(expected).max()


def test_slightly_wrong_weights_show_in_scores_even_if_no_class_and_no_spike_differs() -> None:
    network = two_outputs()
    played = touches(seed=0)
    wrong_projections = tuple(
        replace(p, weights=p.weights * [[1.05], [1.0], [0.95]]) for p in network.projections
    )
    levels = lower(network, CHIP, weight_bits=8)
    wrong_levels = lower(replace(network, projections=wrong_projections), CHIP, weight_bits=8)
    right = compare(Observed(levels, played))
    # The wrong program against the right network.
    wrong = compare(Observed(replace(levels, program=wrong_levels.program), played))
    for match in (right, wrong):
        assert match.prediction_agreement == 1.0
        assert match.first_divergence is None
    assert right.scores.relative_error < 0.01
    assert wrong.scores.relative_error == pytest.approx(0.111, abs=0.001)

    report = report_figures(
        levels, wrong, Grounds(step_seconds=0.02, events_origin="given", assumptions=())
    )
    assert report.match.score_error == wrong.scores.relative_error
    spread = wrong.scores.mean_spread
    assert report.match.class_scores.mean_spread == spread
    assert report.match.class_scores.mean_error == pytest.approx(0.111 * spread, rel=0.01)
    verdict = matches(report)
    assert verdict.status == "nearly"
    assert verdict.answer == "Nearly, in every prediction"
    agreement, score_error = check_gates(
        report, {"--min-agreement": 1.0, "--max-score-error": 0.05}
    )
    assert agreement.holds
    assert not score_error.holds


@pytest.mark.parametrize("weights", [(1.0, 0.1), (0.3, -0.7), (0.0, 2.0)], ids=str)
@pytest.mark.parametrize("potentials", [5, (None, 5), None], ids=["potentials", "both", "spikes"])
def test_scores_are_compared_in_the_units_of_the_network(weights, potentials) -> None:
    played = touches(seed=1, recordings=20)
    # Where spikes are read, the threshold is so low that there are some.
    threshold = 40.0 if potentials == 5 else 0.125
    network = two_outputs(threshold)
    readout = replace(network.readout, weights=weights, potentials_from=potentials)
    network = replace(network, readout=readout)
    levels = lower(network, CHIP, weight_bits=8)
    chip_scores = hw.simulate(levels.program, played).scores / levels.quantized.score_scale
    expected = evaluate(network, played).scores
    assert np.count_nonzero(expected) >= 5
    spread = np.abs(expected - expected.mean(axis=1, keepdims=True)).mean()
    assert np.abs(chip_scores - expected).mean() <= 0.01 * spread


def test_spikes_and_potentials_are_added_in_whole_numbers(tmp_path) -> None:
    """A spike counts 1, and a potential 1 over its scale, to a part in 32,768.

    The program file and the text of the compartments say which population is read by spikes and which by potentials.
    """
    network = two_outputs()
    played = touches(seed=5)
    readout = replace(network.readout, weights=(0.3, -0.7), potentials_from=(None, 5))
    levels = lower(replace(network, readout=readout), CHIP, weight_bits=8)
    of_spikes, of_potential = levels.program.readout.weights
    scale = levels.quantized.population("large").scale[0]
    assert of_spikes == round(of_spikes)
    assert of_potential == -SMALLEST_WEIGHT
    # Their ratio is 0.3 to -0.7 / scale.
    assert abs(of_spikes / of_potential * -0.7 / scale / 0.3 - 1) < 2**-15
    scores = hw.simulate(levels.program, played).scores
    assert np.array_equal(scores, np.rint(scores))
    for engine in ("reference", "fast"):
        assert np.array_equal(hw.simulate(levels.program, played, engine=engine).scores, scores)
    assert np.array_equal(scores, evaluate(levels.quantized.on_grid(), played).scores)
    levels.program.save(tmp_path)
    assert hw.load_program(tmp_path).readout == levels.program.readout
    document = yaml.safe_load((tmp_path / "program.yaml").read_text())
    assert document["readout_potentials_from"] == {"large": 5}
    line = (
        f"readout: {of_spikes:g} * spikes of small "
        "+ -16384 * largest potential, from step 5 on, of large"
    )
    assert line in compartments_text(levels.compartments)
