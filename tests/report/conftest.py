from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from locsnn_compile.excerpt import Excerpt, InputSpikes, NeuronPotential, PopulationSpikes
from locsnn_compile.matching import Divergence


def error_budget() -> dict[str, Any]:
    """Two stages, of which one explains most of the difference."""

    def deviation(agreement: float, mismatches: int, changed: int) -> dict[str, Any]:
        spikes = {"spike_agreement": agreement, "spike_mismatches": mismatches}
        half = {"spike_agreement": agreement, "spike_mismatches": mismatches // 2}
        return {
            **spikes,
            "predictions_changed": changed,
            "by_population": {"time_output": half, "location_output": dict(half)},
        }

    return {
        "recordings": [0, 6, 13, 19],
        "recordings_available": 20,
        "alone": {
            "weights": deviation(0.91, 18, 1),
            "decays": deviation(0.99, 2, 0),
            "states": deviation(0.995, 1, 0),
            "thresholds": deviation(1.0, 0, 0),
            "wraps_clips": deviation(1.0, 0, 0),
        },
        "all_but": {
            "weights": deviation(0.985, 3, 0),
            "decays": deviation(0.905, 19, 1),
            "states": deviation(0.9, 20, 1),
            "thresholds": deviation(0.9, 20, 1),
            "wraps_clips": deviation(0.9, 20, 1),
        },
        "together": deviation(0.9, 20, 1),
        "unexplained_spikes": 0,
        "kernel_tail": deviation(0.96, 8, 0),
    }


def margins() -> dict[str, Any]:
    """Bins from a thousandth of a threshold to ten, one a decade."""
    population = {
        "neuron_steps": 1000,
        "nearest": {"0.001": 0.0021, "0.01": 0.019, "0.5": 1.0},
        "error": {"0.5": 0.012, "0.95": 0.055, "1": 1.5},
        "within_error": 0.006,
        "decided_otherwise": 0.003,
        "distance_histogram": [1, 19, 480, 500],
        "error_histogram": [100, 700, 20, 2],
    }
    return {
        "recordings": [0, 6, 13, 19],
        "recordings_available": 20,
        "histogram_edges": [0.001, 0.01, 0.1, 1.0, 10.0],
        "by_population": {"time_output": population, "location_output": dict(population)},
        "registers": {
            "time_output/dendrite": {
                "peak_u": 1048576,
                "share_u": 0.125,
                "peak_v": 8388607,
                "share_v": 1.0,
                "headroom_bits": 0.0,
                "wraps": 0,
                "clips": 4,
            },
            "time_output": {
                "peak_u": 0,
                "share_u": 0.0,
                "peak_v": 0,
                "share_v": 0.0,
                "headroom_bits": None,
                "wraps": 0,
                "clips": 0,
            },
        },
    }


def over_time() -> dict[str, Any]:
    """Four figures over a recording of ten steps; the time branch is right early, the location branch late."""
    return {
        "recordings": [0, 6, 13, 19],
        "recordings_available": 20,
        "right_is": "the label",
        "psi": 10.0,
        "step_seconds": 0.7,
        "steps": [2, 4, 6, 8, 10],
        "right": {
            "together": [0.0, 0.25, 0.5, 0.5, 1.0],
            "time": [0.25, 0.5, 0.5, 0.75, 0.75],
            "location": [0.0, 0.0, 0.25, 0.25, 0.5],
            "time_weighted": [0.25, 0.5, 0.5, 0.75, 1.0],
        },
        "proven_stop": {
            "steps": 15.0,
            "all_steps": 20.0,
            "synaptic_ops": 1500.0,
            "all_synaptic_ops": 2000.0,
            "energy_pj": 80000.0,
            "all_energy_pj": 100000.0,
            "profile": "davies2018",
        },
    }


@pytest.fixture
def excerpt() -> Excerpt:
    """Four steps of two neurons; the second fires a step later on the chip, and the third step is the first to differ."""
    reference = np.array([[1, 0], [0, 1], [0, 1], [1, 0]], dtype=np.uint8)
    chip = np.array([[1, 0], [0, 1], [0, 0], [1, 1]], dtype=np.uint8)
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
        first=Divergence(0, "time_output", 3, 41, 10.25, 9.75, 10.0),
        steps={"time": range(39, 43)},
        all_steps={"time": 100},
        inputs=(InputSpikes("input", "time", 5, 2, np.array([[1, 0, 0]] * 4, dtype=np.uint8)),),
        populations=(PopulationSpikes("time_output", "time", 36, np.array([1, 3]), reference, chip),),
        populations_left_out=1,
        potential=potential,
    )


@pytest.fixture
def document() -> dict[str, Any]:
    """A small report in which every number can be followed by hand; the check played 20 recordings."""
    branch = {"synaptic_ops": 1000.0, "neuron_updates": 400.0, "spikes": 12.5}
    population = {"spike_agreement": 0.9, "spike_mismatches": 10, "reference_spikes": 49, "chip_spikes": 51}
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
        "model": {"name": "two-branches", "sha256": "ab" * 32},
        "target": "loihi-sim",
        "strategy": "dendrite",
        "weight_bits": 8,
        "match": {
            "reference": "float64",
            "samples": 20,
            "events_source": "touches.npz",
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
        "energy": {
            "profile": "davies2018",
            "source": "Davies et al., IEEE Micro 38(1), 2018, Table 2",
            "basis": "pre-silicon simulation at 0.75 V",
            "per_sample_pj": 100000.0,
            "breakdown_pj": {"synaptic_ops": 60000.0, "neuron_updates_active": 40000.0, "hops_x": 0.0},
            "by_branch_pj": {"time": 75000.0, "location": 25000.0},
            "over_samples_pj": {"min": 800.0, "p50": 90000.0, "max": 1200000.0},
            "other_profiles_pj": {"sanafe": 136000.0},
            "not_included": ["host input and output (not published)", "weight loading (not published)"],
        },
        "latency": {
            "profile": "davies2018",
            "per_sample_ns": 1400000.0,
            "per_sample_cycles": 1400000,
            "by_branch_ns": {"time": 900000.0, "location": 500000.0},
            "over_samples_ns": {"min": 700.0, "p50": 1300000.0, "max": 2800000.0},
            "critical_core": 1,
            "recording_ns": 7e9,
        },
        "resources": {
            "cores": 2,
            "compartments": 12,
            "synapses": 80,
            "synapse_bits": 2560,
            "axons_in": 16,
            "axons_out": 4,
            "limits": {
                name: {"used": 2 if name == "cores" else core[name], "limit": limit} for name, limit in limits.items()
            },
            "mesh": {"chips": 1, "cores_per_chip": 128, "columns": 8, "rows": 4, "cores_per_tile": 4},
            "by_core": [
                {"core": 0, "phase": "time", "slot": 0, "tile": [0, 0], **core},
                {"core": 1, "phase": "location", "slot": 39, "tile": [1, 1], **core},
            ],
        },
        "ann_comparison": {
            "cnn-3d": {"operations": 18500, "ratio": 10.0},
            "gru-mlp": {"operations": 925, "ratio": 0.5},
        },
        "skipped": {"steps": 7, "events_dropped": 0, "synapses_pruned": 5, "compartments_pruned": 0},
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
        "range": {
            "time_output/dendrite": {"compartments": 4, "cannot_wrap": 4, "cannot_clip": 1, "safe_period_steps": 12},
            "time_output": {"compartments": 4, "cannot_wrap": 4, "cannot_clip": 4, "safe_period_steps": 1},
            "location_output": {"compartments": 4, "cannot_wrap": 3, "cannot_clip": 0, "safe_period_steps": None},
        },
    }
