"""Names of the document's keys in words."""

from collections.abc import Mapping, Sequence
from typing import Any

from locsnn_compile.report.format import SILENT

ASSUMED = "What was assumed:"
"""Stands above the assumptions wherever they are shown."""
SIGNS = {"yes": "✓", "nearly": "≈", "no": "✗", "unknown": "?", "modelled": "~"}
"""Stand before the answers of verdicts."""
_WORDS = {
    "synaptic_ops": "synaptic operations",
    "neuron_updates_active": "neuron updates, active",
    "neuron_updates_inactive": "neuron updates, at rest",
    "transpose_events": "events through the transpose buffer",
    "axon_packets": "spike packets",
    "packets_within_tile": "packets within a tile",
    "hops_x": "mesh hops, east or west",
    "hops_y": "mesh hops, north or south",
    "axons_in": "input axons",
    "axons_out": "output axons",
    "updates": "compartment updates",
    "mesh": "mesh hops",
    "buffer": "transpose buffer",
    "time": "time branch",
    "location": "location branch",
    "together": "all branches together",
    "time_weighted": "time-weighted",
    "fp32": "FP32",
    "int8": "INT8",
    "int8_sums_of_32_bits": "INT8, sums of 32 bits",
    "cnn-3d": "CNN-3D",
    "gru-mlp": "GRU-MLP",
}

STAGES = {
    "kernel": "neuron model",
    "weights": "rounding of weights",
    "decays": "rounding of decays",
    "states": "truncation of states",
    "thresholds": "thresholds",
    "delays": "delays",
    "wraps_clips": "wraps and clips",
}
"""Stages of the error budget, in the order of the compiler."""


def stage_words(stage: str) -> str:
    """Return a stage of the error budget in words."""
    return STAGES.get(stage, stage)


def no_spikes(match: Mapping[str, Any], population: str) -> str:
    """Return what stands for the equal spikes of a population that has none."""
    readout = match["readout"]
    by_potential = readout.get("potentials_of", readout["populations"] if readout["by"] == "potentials" else ())
    return "read by potential" if population in by_potential else SILENT


def words(key: str) -> str:
    """Return a key of the document in words; one that is not known here, with its underscores as spaces."""
    return _WORDS.get(key, key.replace("_", " "))


def limit_words(name: str) -> str:
    """Return a limit of the chip in words."""
    return words(name) if name == "cores" else f"{words(name)} of a core"


def listed(items: Sequence[str]) -> str:
    """Return ``a, b and c``."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"


def core_words(row: Mapping[str, Any]) -> str:
    """Return a core of the document by its number and its branch."""
    return f"core {row['core']}, {words(row['phase'])}"
