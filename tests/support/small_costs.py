"""Entries of the small report about costs: energy, latency, and conventional networks for comparison.

See :mod:`tests.support.small_checks` about the small report. Costs come by profile, a set of published costs per
operation.
"""

from __future__ import annotations

from typing import Any


def energy() -> dict[str, Any]:
    """100,000 pJ per sample: three quarters in the time branch on core 0, a quarter in the location branch on core 1.

    A second profile gives 136,000 pJ.
    """
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
            "time_output": {
                "pj": 75000.0,
                "compartments": {"time_output/dendrite": 50000.0, "time_output": 25000.0},
            },
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
            {
                "class": 1,
                "recordings": 8,
                "min_pj": 20000.0,
                "mean_pj": 160000.0,
                "max_pj": 1200000.0,
            },
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
            {
                "what": "the transpose buffer",
                "at_most_pj": 1000.0,
                "bound_source": "20 pJ an event, at 45 nm",
            },
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
                    {
                        "count": "neuron_updates_active",
                        "energy_pj": 81.0,
                        "energy_pj_range": None,
                        **constant,
                    },
                ],
                "barrier_ns": {"one_tile": 113.0, "all_tiles": 465.0},
            },
            "sanafe": {
                "source": "an architecture file",
                "basis": "simulator calibration",
                "voltage_v": None,
                "constants": [
                    {
                        "count": "synaptic_ops",
                        "energy_pj": 35.5,
                        "energy_pj_range": None,
                        **constant,
                    }
                ],
                "barrier_ns": {"one_tile": 600.0, "all_tiles": 1800.0},
            },
        },
    }


def latency() -> dict[str, Any]:
    """1.4 ms per sample, 0.9 ms in the time branch and 0.5 ms in the location branch; the sensor takes 5,000 times as long."""
    time = {
        "updates": 300000.0,
        "sending": 0.0,
        "mesh": 0.0,
        "buffer": 0.0,
        "deliveries": 0.0,
        "synapses": 500000.0,
    }
    location = {
        **time,
        "updates": 90000.0,
        "mesh": 10000.0,
        "buffer": 50000.0,
        "synapses": 300000.0,
    }
    return {
        "profile": "davies2018",
        "basis": "pre-silicon simulation at 0.75 V",
        "timed": True,
        "per_sample_ns": 1400000.0,
        "per_sample_cycles": 1400000,
        "clock_ghz": 1.0,
        "range_ns": [None, 1400000.0],
        "by_branch_ns": {"time": 900000.0, "location": 500000.0},
        "by_part_ns": {part: time[part] + location[part] for part in time} | {"barrier": 150000.0},
        "by_branch_part_ns": {
            "time": time | {"barrier": 100000.0},
            "location": location | {"barrier": 50000.0},
        },
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
                "busy_ns": {
                    "updates": 300000.0,
                    "sending": 0.0,
                    "deliveries": 0.0,
                    "synapses": 300000.0,
                },
                "last_ns": last,
            }
            for core, phase, last in ((0, "time", 900000.0), (1, "location", 500000.0))
        ],
        "critical_paths": [
            {"phase": "time", "sender": 0, "last": 0, "ns": 900000.0},
            {"phase": "location", "sender": 0, "last": 1, "ns": 500000.0},
        ],
        "links": [
            {"phase": "location", "from": [0, 0], "to": [1, 0], "packets": 2.5, "most_in_a_step": 3}
        ],
        "over_samples_ns": {"min": 700.0, "p50": 1300000.0, "p99": 2700000.0, "max": 2800000.0},
        "worst_recording": {"recording": 7, "class": 1, "ns": 2800000.0},
        "by_class": [
            {
                "class": 0,
                "recordings": 12,
                "min_ns": 700.0,
                "mean_ns": 1000000.0,
                "max_ns": 1500000.0,
            },
            {
                "class": 1,
                "recordings": 8,
                "min_ns": 800000.0,
                "mean_ns": 2000000.0,
                "max_ns": 2800000.0,
            },
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


def ann(
    macs: int, multiplications: int, additions: int, ratio: float, chip_ratio: float
) -> dict[str, Any]:
    """A conventional network, compared with the 100,000 pJ of :func:`energy`.

    Picojoules per multiplication and addition are those of Horowitz, ISSCC 2014, at 45 nm.
    """
    energies = {
        "fp32": multiplications * 3.7 + additions * 0.9,
        "int8": multiplications * 0.2 + additions * 0.03,
        "int8_sums_of_32_bits": multiplications * 0.2 + additions * 0.1,
    }
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
