"""Entries of the small report about checks: error budget, margins, figures over time, overflows, and bounds.

The small report is a report.json by hand, whose numbers are so simple that tests can follow them to the page. Each
function returns one entry, as ``locsnn_compile/report/figures`` describes it.
"""

from __future__ import annotations

from typing import Any


def error_budget() -> dict[str, Any]:
    """Five sources of error, of which rounded weights explain most of the difference between chip and trained network.

    ``alone`` has one source of error at a time, ``all_but`` all except one.
    """

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
            "weights": deviation(agreement=0.91, mismatches=18, changed=1),
            "decays": deviation(agreement=0.99, mismatches=2, changed=0),
            "states": deviation(agreement=0.995, mismatches=1, changed=0),
            "thresholds": deviation(agreement=1.0, mismatches=0, changed=0),
            "wraps_clips": deviation(agreement=1.0, mismatches=0, changed=0),
        },
        "all_but": {
            "weights": deviation(agreement=0.985, mismatches=3, changed=0),
            "decays": deviation(agreement=0.905, mismatches=19, changed=1),
            "states": deviation(agreement=0.9, mismatches=20, changed=1),
            "thresholds": deviation(agreement=0.9, mismatches=20, changed=1),
            "wraps_clips": deviation(agreement=0.9, mismatches=20, changed=1),
        },
        "together": deviation(agreement=0.9, mismatches=20, changed=1),
        "unexplained_spikes": 0,
        "kernel_tail": deviation(agreement=0.96, mismatches=8, changed=0),
    }


def margins() -> dict[str, Any]:
    """Distances from the threshold in four bins, from a thousandth of a threshold to ten, one per decade."""
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


def overflows() -> dict[str, Any]:
    """Four clips in two recordings, which change a spike, and another setting of the compiler without clips."""
    taken = {
        "strategy": "dendrite",
        "weight_bits": 8,
        "split_weights": 0.0,
        "wraps_and_clips": 4,
        "prediction_agreement": 1.0,
        "spike_agreement": 0.9,
        "score_error": 0.02,
        "energy_ratio": 1.0,
        "time_ratio": 1.0,
    }
    narrower = {
        "weight_bits": 6,
        "wraps_and_clips": 0,
        "spike_agreement": 0.8,
        "score_error": 0.05,
        "energy_ratio": 0.95,
        "time_ratio": 0.98,
    }
    return {
        "matters": "spikes or scores",
        "recordings": 2,
        "not_known": None,
        "wide_registers": {
            "spikes_changed": 1,
            "predictions_changed": 0,
            "prediction_agreement": 1.0,
            "spike_agreement": 0.91,
            "score_error": 0.01,
        },
        "settings": {
            "recordings": 2,
            "taken": taken,
            "tried": 3,
            "without": [{**taken, **narrower}],
        },
    }


def bounds_at(events: int, step_ns: float) -> dict[str, Any]:
    """Bounds of a step, an answer and a recording at a rate of events; no packet queues, so its share is undefined."""

    def bounded(bound: float, measured: float) -> dict[str, float | None]:
        return {"bound": bound, "measured": measured, "share": measured / bound if bound else None}

    return {
        "events_per_step": events,
        "slowest_step_ns": bounded(step_ns, 4000.0),
        "answer_ns": bounded(step_ns + 1e6, 900_000.0),
        "recording_ns": bounded(100 * step_ns + 1e6, 2_800_000.0),
        "queued_packets": bounded(0, 0),
        "buffered_events": bounded(100 * events, 80),
    }


def bounds() -> dict[str, Any]:
    """Bounds at three events per step, and at five: all channels at once."""
    return {
        "channels": 5,
        "as_recorded": bounds_at(3, 40_000.0),
        "any_input": bounds_at(5, 50_000.0),
        "step_ns": 2e7,
        "sustained_events_per_step": 5,
    }
