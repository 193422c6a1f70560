"""Write the tables of what each improvement of rounding buys, on all test recordings.

    python tests/benchmarks/improvements.py --data FOLDER --page docs/research/accuracy/what-each-improvement-buys.md

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip. The networks are the float ones that ship. Weights are rounded, and
settings chosen, on training recordings; test recordings are only played.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from page_section import write_by_network

import hw_model as hw
import locsnn_compile as lc
from hw_model.arithmetic.fixed_point import weight_grid
from hw_model.description.counts import total
from hw_model.mapping.arrangement import arrange_cores
from hw_model.mapping.placement import place_cores
from hw_model.mapping.routing import route_axons
from hw_model.program.assemble import assemble
from locsnn_compile.data.read import read_recordings
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.passes.kernels import one_decay
from locsnn_compile.passes.lower_neurons import lower_neurons
from locsnn_compile.passes.quantize import quantize
from locsnn_compile.passes.rounding.task import FINE, Rounding
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import Calibration, calibrate, evaluate
from locsnn_compile.report.format import energy, share
from locsnn_compile.request.recordings import recordings_for
from locsnn_compile.verification.matching import PopulationMatch, compare
from locsnn_compile.verification.observation import Observed

ROOT = Path(__file__).parents[2]
CHIP = hw.chip("loihi-sim")
BITS = 8
PAIRED = "paired-dendrite"
KEEP_SR, KEEP_REF = 3706 / 4096, 1507 / 4096
"""What a current keeps of itself in a step, for the decays of the chip that are nearest to the published time constants."""


def section(data: Path, dataset: str) -> str:
    """Return the tables of one network."""
    network = lc.load(ROOT / f"examples/models/{dataset}-hybrid.pt")
    archive = data / f"Ev-{dataset.title()}.zip"
    train, test = (read_recordings(archive, split=split) for split in ("train", "test"))
    calibration = calibrate(network, train, CHIP.registers)
    names = [p.name for p in network.populations]
    head = [
        "rounding, each row with all above",
        "same prediction",
        "accuracy",
        "same spikes",
        *names,
        "energy",
    ]
    rows = [measured(words, quantized, test) for words, quantized in steps(network, calibration)]
    synthetic = calibrate(network, recordings_for(network, events=None), CHIP.registers)
    other = [
        measured("default, for 16 synthetic touches", fine(network, synthetic), test),
        *(
            measured(f"default, {strategy}", fine(network, calibration, strategy=strategy), test)
            for strategy in ("delay-line", "reset")
        ),
    ]
    gridded = on_the_grid(network)
    grid_calibration = calibrate(gridded, train, CHIP.registers)
    grid_rows = [
        measured("default", fine(gridded, grid_calibration), test),
        measured("all weights split", fine(gridded, grid_calibration, split=1.0), test),
        measured("paired dendrites", fine(gridded, grid_calibration, strategy=PAIRED), test),
        measured(
            "paired dendrites, all weights split",
            fine(gridded, grid_calibration, strategy=PAIRED, split=1.0),
            test,
        ),
    ]
    gridded_accuracy = float((evaluate(gridded, test.spikes).prediction == test.labels).mean())
    accuracy = float((evaluate(network, test.spikes).prediction == test.labels).mean())
    return "\n\n".join(
        [
            f"## {dataset.title()}: {len(test)} test recordings, float accuracy {accuracy:.3f}",
            table(head, rows + other),
            f"The same weights, with time constants on the grid of decays, float accuracy {gridded_accuracy:.3f}:",
            table(head, grid_rows),
        ]
    )


def steps(network: Network, calibration: Calibration) -> Iterator[tuple[str, QuantizedNetwork]]:
    """Yield the improvements, from naive rounding on."""
    plain = quantize(network, CHIP, BITS)
    yield "naive: nearest, signs in one format", by_hand(network, plain, "mixed", over=0)
    yield "signs apart", by_hand(network, plain, "apart", over=0)
    yield "exact threshold", by_hand(network, plain, "apart", over=1)
    yield "gain fitted to the decay", plain
    rounding = Rounding(fitted_decays=True)
    yield "two decays", quantize(network, CHIP, BITS, "dendrite", rounding, calibration)
    rounding = replace(rounding, graded=True)
    yield "formats by size", quantize(network, CHIP, BITS, "dendrite", rounding, calibration)
    rounding = replace(rounding, error_aware=True)
    yield "rounded together", quantize(network, CHIP, BITS, "dendrite", rounding, calibration)
    yield "a scale for each neuron (the default)", fine(network, calibration)
    yield "a quarter of the weights split", fine(network, calibration, split=0.25)
    yield "all weights split", fine(network, calibration, split=1.0)
    yield "paired dendrites, none split", fine(network, calibration, strategy=PAIRED)
    yield "paired dendrites, all split", fine(network, calibration, strategy=PAIRED, split=1.0)


def fine(
    network: Network, calibration: Calibration, *, strategy: str = "dendrite", split: float = 0.0
) -> QuantizedNetwork:
    """Return the network as the compiler rounds it by default, with a share of its weights split into two synapses."""
    return quantize(network, CHIP, BITS, strategy, replace(FINE, split=split), calibration)


def by_hand(network: Network, plain: QuantizedNetwork, signs: str, over: int) -> QuantizedNetwork:
    """Round each weight to the nearest with the gain of the float kernel, as a simple compiler would.

    ``signs``: one format for both signs (``mixed``) or one for each (``apart``). A threshold mantissa T is taken to be 64 T +
    ``over`` units: with 1 exactly the first potential at which the chip spikes, because it spikes above 64 T.
    """
    grid = weight_grid(BITS, "mixed" if signs == "mixed" else "excitatory")
    populations, projections = [], []
    for quantized_population in plain.populations:
        neuron = quantized_population.population.neuron
        populations.append(
            replace(
                quantized_population,
                scale=(64 * quantized_population.neuron.threshold + over) / neuron.theta,
            )
        )
    for float_projection, p in zip(network.projections, plain.projections, strict=True):
        quantized_population = next(
            quantized_population
            for quantized_population in populations
            if quantized_population.population.name == p.target
        )
        tau = quantized_population.population.neuron.tau_sr
        ideal = (
            float_projection.weights
            * (math.exp(1 - 1 / tau) / tau)
            * quantized_population.scale[:, None]
            / (64 * 2.0**p.exponent)
        )
        mantissa = (
            grid.round(ideal) if signs == "mixed" else np.sign(ideal) * grid.round(np.abs(ideal))
        )
        projections.append(replace(p, mantissa=mantissa.astype(np.int64), signs=signs))
    pruned = sum(int((p.mantissa == 0).sum()) for p in projections)
    return replace(
        plain, populations=tuple(populations), projections=tuple(projections), weights_pruned=pruned
    )


def on_the_grid(network: Network) -> Network:
    """Return the network with time constants whose decays are effective decays of the chip."""
    neurons = {"tau_sr": -1 / math.log(KEEP_SR), "tau_ref": -1 / math.log(KEEP_REF)}
    populations = tuple(
        replace(p, neuron=replace(p.neuron, **neurons)) for p in network.populations
    )
    gridded = replace(network, populations=populations)
    assert one_decay(neurons["tau_sr"], "").error < 1e-7
    return gridded


def measured(words: str, quantized: QuantizedNetwork, test: Recordings) -> list[str]:
    """Return a row: agreement, accuracy and energy on the test recordings."""
    compartments = lower_neurons(quantized, CHIP)
    placed = arrange_cores(place_cores(compartments, CHIP))
    routed = route_axons(placed)
    program = assemble(routed)
    levels = Levels(quantized.network, quantized, compartments, placed, routed, program)
    match = compare(Observed(levels, test.spikes, test.labels))
    assert match.accuracy is not None
    pj = (
        sum(hw.energy_pj(total(match.counts), CHIP.profile(CHIP.default_profile)).values())
        / match.samples
    )
    row = [
        words,
        share(match.prediction_agreement),
        f"{match.accuracy['chip']:.3f}",
        *agreements(match.by_population),
    ]
    print(*row, sep=" | ", flush=True)
    return [*row, energy(pj)]


def agreements(matches: dict[str, PopulationMatch]) -> list[str]:
    """Return the share of equal spikes over all populations, then of each."""
    return [
        share(m.agreement)
        for m in (sum(matches.values(), start=PopulationMatch()), *matches.values())
    ]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    write_by_network(__doc__, "improvements", section)
