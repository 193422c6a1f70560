"""Fixtures of the report's tests: a small report.json in which every number can be followed by hand, and an excerpt.

The report is of an imaginary build: a network of two branches, checked on 20 recordings. Tests change a few of its keys
and compare what the report then says with sentences and numbers written out by hand. The excerpt is the part of one
recording that the report draws.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from locsnn_compile.verification.excerpt import Excerpt, NeuronPotential, SpikeRows
from locsnn_compile.verification.matching import Divergence
from tests.support.small_checks import bounds, error_budget, margins, over_time, overflows
from tests.support.small_costs import ann, energy, latency


@pytest.fixture
def excerpt() -> Excerpt:
    """Steps 39 to 42 of neurons 1 and 3 of a population, and of an input.

    Neuron 3 spikes in step 41 only in the reference, which is the first difference, and in step 42 only on the chip.
    """
    # (steps, neurons)
    reference = np.array([[1, 0], [0, 1], [0, 1], [1, 0]], dtype=np.uint8)
    chip = np.array([[1, 0], [0, 1], [0, 0], [1, 1]], dtype=np.uint8)
    # The first of three rows has an event in every step; two lines share a row.
    input_events = np.array([[1, 0, 0]] * 4, dtype=np.uint8)
    potential = NeuronPotential(
        population="time_output",
        axis="time",
        neuron=3,
        first_step=39,
        reference=np.array([4.0, 10.5, 10.25, 2.0]),
        chip=np.array([4.0, 10.5, 9.75, 12.0]),
        threshold=10.0,
        reference_spikes=np.array([False, True, True, False]),
        chip_spikes=np.array([False, True, False, True]),
    )
    return Excerpt(
        recording=0,
        first=Divergence(
            0,
            "time_output",
            neuron=3,
            step=41,
            reference_potential=10.25,
            chip_potential=9.75,
            threshold=10.0,
        ),
        steps={"time": range(39, 43)},
        all_steps={"time": 100},
        inputs=(
            SpikeRows(
                "input",
                "time",
                "time",
                size=5,
                numbers=np.array([0, 2, 4]),
                reference=input_events,
                chip=input_events,
                together=2,
            ),
        ),
        populations=(
            SpikeRows(
                "time_output",
                "time",
                "time",
                size=36,
                numbers=np.array([1, 3]),
                reference=reference,
                chip=chip,
            ),
        ),
        populations_left_out=1,
        potential=potential,
    )


@pytest.fixture
def document() -> dict[str, Any]:
    """A small report in which every number can be followed by hand; the check played 20 recordings."""
    branch = {"synaptic_ops": 1000.0, "neuron_updates": 400.0, "spikes": 12.5}
    population = {
        "spike_agreement": 0.9,
        "spike_mismatches": 10,
        "reference_spikes": 49,
        "chip_spikes": 51,
    }
    core = {
        "compartments": 6,
        "synapses": 40,
        "synapse_words": 20,
        "axons_in": 8,
        "axons_out": 2,
        "synapse_formats": 3,
        "compartment_profiles": 3,
        "threshold_profiles": 2,
    }
    limits = {"cores": 128, "compartments": 1024, "synapse_words": 16384, "synapse_formats": 16}
    return {
        "schema": "locsnn-report/1",
        "model": {"name": "two-branches", "sha256": "ab" * 32, "members": []},
        "target": "loihi-sim",
        "strategy": "dendrite",
        "weight_bits": 8,
        "assumptions": [
            "A step lasts 0.7 s, like the bins of the recordings, because the model does not say."
        ],
        "gates": [],
        "match": {
            "reference": "float64",
            "samples": 20,
            "events_source": "touches.npz",
            "events_origin": "given",
            "tied_predictions": 0,
            "score_error": 0.02,
            "class_scores": {"mean_spread": 4.5, "mean_error": 0.09},
            "helper_neurons": {},
            "readout": {
                "populations": ["time_output", "location_output"],
                "by": "spikes",
                "silent": False,
            },
            "prediction_agreement": 0.95,
            "spike_agreement": 0.9,
            "spike_mismatches": 20,
            "reference_spikes": 98,
            "chip_spikes": 102,
            "by_population": {"time_output": dict(population), "location_output": dict(population)},
            "first_divergence": {
                "recording": 0,
                "population": "time_output",
                "neuron": 3,
                "step": 41,
                "reference_potential": 10.00000002,
                "chip_potential": 9.97762002,
                "threshold": 10.0,
                "cause": {
                    "moved_by": {"weights": -0.03, "decays": 0.0075, "thresholds": 0.0},
                    "moved_by_interaction": 0.00012,
                    "moved_together": -0.02238,
                    "largest": "weights",
                    "enough_alone": ["weights"],
                },
            },
            "wraps": 0,
            "clips": 4,
            "wraps_and_clips_by_population": {
                "time_output/dendrite": {"charge_wraps": 0, "current_wraps": 0, "voltage_clips": 4},
                "time_output": {"charge_wraps": 0, "current_wraps": 0, "voltage_clips": 0},
            },
        },
        "accuracy": {"reference": 0.9, "chip": 0.85},
        "error_budget": error_budget(),
        "margins": margins(),
        "over_time": over_time(),
        "operations": {
            "per_sample": {
                "synaptic_ops": 2000.0,
                "neuron_updates": 800.0,
                "spikes": 25.0,
                "input_events": 50.0,
                "transpose_events": 50.0,
            },
            "by_branch": {
                "time": {**branch, "input_events": 50.0, "transpose_events": 0.0},
                "location": {**branch, "input_events": 0.0, "transpose_events": 50.0},
            },
            "published_method": {
                "additions": 1800.0,
                "additions_by_branch": {"time": 1000.0, "location": 800.0},
                "transpose_events": 50.0,
                "operations": 1850.0,
            },
        },
        "energy": energy(),
        "latency": latency(),
        "resources": {
            "cores": 2,
            "compartments": 12,
            "synapses": 80,
            "synapse_bits": 2560,
            "axons_in": 16,
            "axons_out": 4,
            "limits": {
                name: {"used": 2 if name == "cores" else core[name], "limit": limit}
                for name, limit in limits.items()
            },
            "mesh": {
                "chips": 1,
                "cores_per_chip": 128,
                "columns": 8,
                "rows": 4,
                "cores_per_tile": 4,
            },
            "by_core": [
                {"core": 0, "phase": "time", "slot": 0, "tile": [0, 0], **core},
                {"core": 1, "phase": "location", "slot": 39, "tile": [1, 1], **core},
            ],
        },
        "ann_comparison": {
            "cnn-3d": ann(
                macs=9250, multiplications=9250, additions=9250, ratio=10.0, chip_ratio=9.25
            ),
            "gru-mlp": ann(
                macs=450, multiplications=460, additions=465, ratio=0.5, chip_ratio=0.4625
            ),
        },
        "skipped": {
            "steps": 7,
            "events_dropped": 0,
            "synapses_pruned": 5,
            "biases_lost": 0,
            "compartments_pruned": 0,
        },
        "input": {"aligned_steps": 0.0, "aligned_steps_by_branch": {}},
        "strategy_choice": None,
        "quantization": {
            name: {
                "strategy": "dendrite",
                "scale": 44236.9,
                "threshold_mantissa": 6912,
                "decay_u": 390,
                "decay_v": 390,
                "kernel_fit": {
                    "input_max": 0.0004,
                    "input_rms": 0.0005,
                    "refractory_max": 6.25e-05,
                    "refractory_rms": 0.0001,
                },
                "weight_exponents": [0, 1],
            }
            for name in ("time_output", "location_output")
        },
        "overflows": overflows(),
        "bounds": bounds(),
        "range": {
            "time_output/dendrite": {
                "compartments": 4,
                "cannot_wrap": 4,
                "cannot_clip": 1,
                "safe_period_steps": 12,
            },
            "time_output": {
                "compartments": 4,
                "cannot_wrap": 4,
                "cannot_clip": 4,
                "safe_period_steps": 1,
            },
            "location_output": {
                "compartments": 4,
                "cannot_wrap": 3,
                "cannot_clip": 0,
                "safe_period_steps": None,
            },
        },
    }
