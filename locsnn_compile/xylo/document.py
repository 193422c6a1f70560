"""report.json of a program for a Xylo, with the keys that the reports of all targets share.

What no published table tells, energy and time, is None and named as missing.
"""

from dataclasses import asdict
from typing import Any

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.values import AnyArray, FloatArray, IntArray, picked
from hw_model.xylo.playing import XyloCounts
from hw_model.xylo.program import XyloProgram
from locsnn_compile.baselines.operations import ANN_NAMES
from locsnn_compile.network.network import Network
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.checks import spikes_entry
from locsnn_compile.report.figures.document import SCHEMA
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.verification.matching import PopulationMatch
from locsnn_compile.xylo.comparison import XyloMatch
from locsnn_compile.xylo.parts import neurons_of
from locsnn_compile.xylo.quantized import QuantizedXylo

NO_TABLE = "no table of the energies or times of this chip is published"
_SATURATIONS = ("current_saturations", "change_saturations", "potential_saturations")


def xylo_document(
    quantized: QuantizedXylo, program: XyloProgram, match: XyloMatch, grounds: Grounds
) -> Document:
    """Return the report; every ``per_sample`` figure is a mean over the recordings of the check."""
    network = quantized.parts.network
    counts = match.total_counts
    per_sample = _per_sample(counts, match.samples)
    chance = match.chance
    document: Document = {
        "schema": SCHEMA,
        "model": {"name": network.name, "sha256": network.sha256, "members": []},
        "target": program.chip.name,
        "strategy": program.provenance["strategy"],
        "weight_bits": xylo.WEIGHT_BITS,
        "match": _match(network, match, grounds),
        "accuracy": match.accuracy,
        "operations": {
            "per_sample": per_sample,
            "by_branch": {"time": per_sample},
            "extra_spikes": counts.extra_spikes / match.samples,
            "published_method": _published(match),
        },
        "energy": _not_known("profile", "source", "per_sample_pj", "breakdown_pj")
        | {"not_included": [NO_TABLE]},
        "latency": _latency(network, grounds),
        "resources": _resources(program),
        "ann_comparison": {
            name: _not_known("operations", "ratio", "chip_ratio") for name in ANN_NAMES
        },
        "skipped": _skipped(counts, grounds),
        "input": {"aligned_steps": 0.0, "aligned_steps_by_branch": {}},
        "assumptions": list(grounds.assumptions),
        "gates": [],
        "quantization": _quantization(quantized),
        "strategy_choice": None,
    }
    if chance is not None:
        document["chance"] = asdict(chance) | {"told_apart": chance.told_apart}
    if network.class_names:
        document["classes"] = list(network.class_names)
    return document


def _not_known(*keys: str) -> Document:
    return dict.fromkeys(keys)


def _per_sample(counts: XyloCounts, samples: int) -> Document:
    return {
        "synaptic_ops": counts.synaptic_ops / samples,
        "neuron_updates": counts.neuron_updates / samples,
        "spikes": counts.spikes / samples,
        "input_events": counts.input_events / samples,
        "transpose_events": 0.0,
    }


def _published(match: XyloMatch) -> Document:
    additions = match.additions / match.samples
    return {
        "additions": additions,
        "additions_by_branch": {"time": additions},
        "transpose_events": 0.0,
        "operations": additions,
    }


def _match(network: Network, match: XyloMatch, grounds: Grounds) -> Document:
    counts = match.total_counts
    first = match.first_divergence
    return {
        "reference": "float64",
        "events_origin": grounds.events_origin,
        **picked(match, "samples", "events_source", "prediction_agreement"),
        **_spikes(match.spikes),
        "tied_predictions": match.tied_predictions,
        "score_error": match.scores.relative_error,
        "class_scores": picked(match.scores, "mean_spread", "mean_error"),
        "by_population": {name: _spikes(each) for name, each in match.by_population.items()},
        "helper_neurons": {name: _spikes(each) for name, each in match.helpers.items()},
        "first_divergence": None if first is None else asdict(first) | {"cause": None},
        "wraps": 0,
        "clips": counts.saturations,
        "wraps_and_clips_by_population": {"all neurons": picked(counts, *_SATURATIONS)},
        "readout": _readout(network, match),
    }


def _spikes(match: PopulationMatch) -> Document:
    return spikes_entry(match) | picked(match, "reference_spikes", "chip_spikes")


def _readout(network: Network, match: XyloMatch) -> Document:
    populations = list(network.readout.populations)
    spiked = any(match.by_population[name].agreement is not None for name in populations)
    return {"populations": populations, "by": "spikes", "silent": not spiked}


def _latency(network: Network, grounds: Grounds) -> Document:
    seconds = grounds.step_seconds
    recording_ns = None if seconds is None else network.steps * seconds * 1e9
    unknown = _not_known("profile", "per_sample_ns", "per_sample_cycles", "critical_core")
    return unknown | {"basis": NO_TABLE, "timed": False, "recording_ns": recording_ns}


def _resources(program: XyloProgram) -> Document:
    network = program.network
    chip = program.chip
    groups = (network.weights_in, network.weights_hidden, network.weights_out)
    synapses = sum(int(np.count_nonzero(weights)) for weights in groups)
    used_and_limit = {
        "inputs": (program.inputs, chip.inputs),
        "hidden_neurons": (network.hidden.size, chip.hidden),
        "outputs": (network.outputs.size, chip.outputs),
        "currents_of_a_hidden_neuron": (network.hidden.states, chip.states),
    }
    return {
        "cores": 1,
        "compartments": network.hidden.size + network.outputs.size,
        "synapses": synapses,
        "synapse_bits": synapses * xylo.WEIGHT_BITS,
        "axons_in": program.inputs,
        "axons_out": network.outputs.size,
        "limits": {
            name: {"used": used, "limit": limit} for name, (used, limit) in used_and_limit.items()
        },
    }


def _skipped(counts: XyloCounts, grounds: Grounds) -> Document:
    skipped: Document = {
        "steps": 0,
        "events_dropped": counts.lost_input_events,
        "synapses_pruned": 0,
        "biases_lost": 0,
        "compartments_pruned": 0,
    }
    binned = grounds.binned
    if binned is not None:
        skipped["binning"] = binned.document() | {"words": binned.words}
    return skipped


def _quantization(quantized: QuantizedXylo) -> Document:
    return {
        population.name: _population(quantized, population.name)
        for population in quantized.populations
    }


def _population(quantized: QuantizedXylo, name: str) -> Document:
    population = next(each for each in quantized.populations if each.name == name)
    neurons = neurons_of((population,))
    dash_syn, dash_mem = quantized.dashes_of(name)
    network = quantized.network
    if name == quantized.parts.outputs.name:
        threshold = network.outputs.threshold
        shifts = [network.shift_out]
    else:
        threshold = network.hidden.threshold[quantized.place(name)]
        shifts = [network.shift_in, network.shift_hidden]
    return {
        "strategy": "native",
        "scale": _ends(quantized.scales_of(name)),
        "threshold_mantissa": _ends(threshold),
        "dash_syn": _ends(dash_syn),
        "dash_mem": _ends(dash_mem),
        "current_decay_error": _decay_error(neurons.decay_u, dash_syn),
        "potential_decay_error": _decay_error(neurons.decay_v, dash_mem),
        "weight_shifts": shifts,
    }


def _decay_error(decay: FloatArray, dash: IntArray) -> float:
    """Return the largest difference of a decay from that of its dash, as a share of the decay."""
    return float(np.max(np.abs(xylo.share_lost(dash) - decay) / decay))


def _ends(values: AnyArray) -> Any:
    """Return the value that all neurons share, or else the least and the largest."""
    low = values.min().item()
    high = values.max().item()
    return low if low == high else [low, high]
