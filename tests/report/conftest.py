from __future__ import annotations

from typing import Any

import pytest


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
            },
            "wraps": 0,
            "clips": 4,
            "wraps_and_clips_by_population": {
                "time_output/dendrite": {"charge_wraps": 0, "current_wraps": 0, "voltage_clips": 4},
                "time_output": {"charge_wraps": 0, "current_wraps": 0, "voltage_clips": 0},
            },
        },
        "accuracy": {"reference": 0.9, "chip": 0.85},
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
            "by_core": [{"core": 0, "phase": "time", **core}, {"core": 1, "phase": "location", **core}],
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
