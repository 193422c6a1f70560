from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from locsnn_compile.verification.excerpt import Excerpt, NeuronPotential, SpikeRows
from locsnn_compile.verification.matching import Divergence


def error_budget() -> dict[str, Any]:
    """Two stages, of which one explains most of the difference."""

    def deviation(agreement: float, mismatches: int, changed: int) -> dict[str, Any]:
        spikes = {"spike_agreement": agreement, "spike_mismatches": mismatches}
        half = {"spike_agreement": agreement, "spike_mismatches": mismatches // 2}
        return {
            **spikes,
            "predictions_changed": changed,
            "score_error": 0.02 * changed,
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
            "latency_ns": 30000.0,
            "all_latency_ns": 40000.0,
            "profile": "davies2018",
        },
    }


@pytest.fixture
def excerpt() -> Excerpt:
    """Four steps of two neurons; the second fires a step later on the chip, and the third step is the first to differ."""
    reference = np.array([[1, 0], [0, 1], [0, 1], [1, 0]], dtype=np.uint8)
    chip = np.array([[1, 0], [0, 1], [0, 0], [1, 1]], dtype=np.uint8)
    touched = np.array([[1, 0, 0]] * 4, dtype=np.uint8)
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
        inputs=(SpikeRows("input", "time", "time", 5, np.array([0, 2, 4]), touched, touched, 2),),
        populations=(SpikeRows("time_output", "time", "time", 36, np.array([1, 3]), reference, chip),),
        populations_left_out=1,
        potential=potential,
    )


def energy() -> dict[str, Any]:
    """Two branches of a population each; core 0 has three quarters of it, and one more profile is dearer."""
    davies = "Davies et al., IEEE Micro 38(1), 2018, Table 2"
    constant = {"time_ns": 8.4, "time_ns_range": None, "source": davies}
    unpublished = {"at_most_pj": None, "bound_source": None}
    return {
        "profile": "davies2018",
        "source": davies,
        "basis": "pre-silicon simulation at 0.75 V",
        "voltage_v": 0.75,
        "per_sample_pj": 100000.0,
        "range_pj": [100000.0, None],
        "breakdown_pj": {"synaptic_ops": 60000.0, "neuron_updates_active": 40000.0, "hops_x": 0.0},
        "by_branch_pj": {"time": 75000.0, "location": 25000.0},
        "by_branch_breakdown_pj": {
            "time": {"synaptic_ops": 45000.0, "neuron_updates_active": 30000.0, "hops_x": 0.0},
            "location": {"synaptic_ops": 15000.0, "neuron_updates_active": 10000.0, "hops_x": 0.0},
        },
        "by_population_pj": {
            "time_output": {"pj": 75000.0, "compartments": {"time_output/dendrite": 50000.0, "time_output": 25000.0}},
            "location_output": {"pj": 25000.0, "compartments": {"location_output": 25000.0}},
        },
        "by_core_pj": [
            {"core": 0, "phase": "time", "slot": 0, "tile": [0, 0], "pj": 75000.0},
            {"core": 1, "phase": "location", "slot": 4, "tile": [1, 0], "pj": 25000.0},
        ],
        "by_step_pj": {
            "time": {"bin_steps": 4, "bins": [15000.0, 45000.0, 15000.0]},
            "location": {"bin_steps": 2, "bins": [5000.0, 20000.0]},
        },
        "elsewhere_pj": 0.0,
        "over_samples_pj": {"min": 800.0, "p50": 90000.0, "p99": 1150000.0, "max": 1200000.0},
        "worst_recording": {"recording": 7, "class": 1, "pj": 1200000.0},
        "by_class": [
            {"class": 0, "recordings": 12, "min_pj": 800.0, "mean_pj": 60000.0, "max_pj": 110000.0},
            {"class": 1, "recordings": 8, "min_pj": 20000.0, "mean_pj": 160000.0, "max_pj": 1200000.0},
        ],
        "other_profiles_pj": {"sanafe": 136000.0},
        "other_profiles_by_branch_pj": {"sanafe": {"time": 96000.0, "location": 40000.0}},
        "static": {
            "chip_mw": 104.4,
            "source": "derived from a board measurement",
            "chips": 1,
            "at_latency_pj": 146160000.0,
            "at_real_time_pj": 730800000000.0,
        },
        "not_included": ["host input and output (not published)", "the transpose buffer"],
        "not_included_bounds": [
            {"what": "host input and output (not published)", **unpublished},
            {"what": "the transpose buffer", "at_most_pj": 1000.0, "bound_source": "20 pJ an event, at 45 nm"},
        ],
        "profiles": {
            "davies2018": {
                "source": davies,
                "basis": "pre-silicon simulation at 0.75 V",
                "voltage_v": 0.75,
                "constants": [
                    {
                        "count": "synaptic_ops",
                        "energy_pj": 23.6,
                        "energy_pj_range": [23.6, None],
                        "time_ns": 3.5,
                        "time_ns_range": [None, 3.5],
                        "source": davies,
                    },
                    {"count": "neuron_updates_active", "energy_pj": 81.0, "energy_pj_range": None, **constant},
                ],
                "barrier_ns": {"one_tile": 113.0, "all_tiles": 465.0},
            },
            "sanafe": {
                "source": "an architecture file",
                "basis": "simulator calibration",
                "voltage_v": None,
                "constants": [{"count": "synaptic_ops", "energy_pj": 35.5, "energy_pj_range": None, **constant}],
                "barrier_ns": {"one_tile": 600.0, "all_tiles": 1800.0},
            },
        },
    }


def latency() -> dict[str, Any]:
    """Core 1 waits for core 0 in a third of the time; the sensor takes 5,000 times as long."""
    time = {"updates": 300000.0, "sending": 0.0, "mesh": 0.0, "buffer": 0.0, "deliveries": 0.0, "synapses": 500000.0}
    location = {**time, "updates": 90000.0, "mesh": 10000.0, "buffer": 50000.0, "synapses": 300000.0}
    return {
        "profile": "davies2018",
        "basis": "pre-silicon simulation at 0.75 V",
        "per_sample_ns": 1400000.0,
        "per_sample_cycles": 1400000,
        "clock_ghz": 1.0,
        "range_ns": [None, 1400000.0],
        "by_branch_ns": {"time": 900000.0, "location": 500000.0},
        "by_part_ns": {part: time[part] + location[part] for part in time} | {"barrier": 150000.0},
        "by_branch_part_ns": {"time": time | {"barrier": 100000.0}, "location": location | {"barrier": 50000.0}},
        "by_step_ns": {
            "time": {"bin_steps": 4, "bins": [200000.0, 500000.0, 200000.0]},
            "location": {"bin_steps": 2, "bins": [100000.0, 400000.0]},
        },
        "by_core": [
            {
                "core": core,
                "phase": phase,
                "slot": 4 * core,
                "tile": [core, 0],
                "busy_ns": {"updates": 300000.0, "sending": 0.0, "deliveries": 0.0, "synapses": 300000.0},
                "last_ns": last,
            }
            for core, phase, last in ((0, "time", 900000.0), (1, "location", 500000.0))
        ],
        "critical_paths": [
            {"phase": "time", "sender": 0, "last": 0, "ns": 900000.0},
            {"phase": "location", "sender": 0, "last": 1, "ns": 500000.0},
        ],
        "links": [{"phase": "location", "from": [0, 0], "to": [1, 0], "packets": 2.5, "most_in_a_step": 3}],
        "over_samples_ns": {"min": 700.0, "p50": 1300000.0, "p99": 2700000.0, "max": 2800000.0},
        "worst_recording": {"recording": 7, "class": 1, "ns": 2800000.0},
        "by_class": [
            {"class": 0, "recordings": 12, "min_ns": 700.0, "mean_ns": 1000000.0, "max_ns": 1500000.0},
            {"class": 1, "recordings": 8, "min_ns": 800000.0, "mean_ns": 2000000.0, "max_ns": 2800000.0},
        ],
        "critical_core": 1,
        "recording_ns": 7e9,
        "after_last_row_ns": {"mean": 501000.0, "max": 900000.0},
        "real_time": {
            "step_ns": 2e7,
            "factor": 5000.0,
            "slowest_factor": 2500.0,
            "slowest_step_ns": 4000.0,
            "slowest_step_factor": 5000.0,
        },
    }


def ann(macs: int, multiplications: int, additions: int, ratio: float, chip_ratio: float) -> dict[str, Any]:
    """A conventional network; 100,000 pJ is this network's energy."""
    float_pj, byte_pj = multiplications * 3.7 + additions * 0.9, multiplications * 0.2 + additions * 0.03
    energies = {"fp32": float_pj, "int8": byte_pj, "int8_sums_of_32_bits": multiplications * 0.2 + additions * 0.1}
    return {
        "operations": multiplications + additions,
        "ratio": ratio,
        "chip_ratio": chip_ratio,
        "macs": macs,
        "multiplications": multiplications,
        "additions": additions,
        "energy_pj": energies,
        "energy_ratio": {name: pj / 100000.0 for name, pj in energies.items()},
        "energy_source": "Horowitz, ISSCC 2014: arithmetic at 45 nm",
        "energy_not_included": ["memory traffic", "static power"],
    }


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
        "assumptions": ["A step lasts 0.7 s, as wide as the bins of the recordings; the model does not say."],
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
            "readout": {"populations": ["time_output", "location_output"], "by": "spikes", "silent": False},
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
                name: {"used": 2 if name == "cores" else core[name], "limit": limit} for name, limit in limits.items()
            },
            "mesh": {"chips": 1, "cores_per_chip": 128, "columns": 8, "rows": 4, "cores_per_tile": 4},
            "by_core": [
                {"core": 0, "phase": "time", "slot": 0, "tile": [0, 0], **core},
                {"core": 1, "phase": "location", "slot": 39, "tile": [1, 1], **core},
            ],
        },
        "ann_comparison": {
            "cnn-3d": ann(macs=9250, multiplications=9250, additions=9250, ratio=10.0, chip_ratio=9.25),
            "gru-mlp": ann(macs=450, multiplications=460, additions=465, ratio=0.5, chip_ratio=0.4625),
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
