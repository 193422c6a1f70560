"""report.json as plain values: all figures, which the other forms of the report show."""

from dataclasses import asdict
from typing import Any

import hw_model as hw
from hw_model.description.counts import Counts, total
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.targets import target_of
from hw_model.values import AnyArray, IntArray, picked
from locsnn_compile.baselines import operations as paper
from locsnn_compile.network.network import Network
from locsnn_compile.pipeline import Levels
from locsnn_compile.report.content import Document
from locsnn_compile.report.figures.checks import (
    budget_entry,
    cause_entry,
    margins_entry,
    over_time_entry,
    spikes_entry,
)
from locsnn_compile.report.figures.energy import energy_entry
from locsnn_compile.report.figures.latency import latency_entry
from locsnn_compile.report.figures.spread import place
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.verification.diagnosis import Diagnosis
from locsnn_compile.verification.matching import Match, PopulationMatch
from locsnn_compile.verification.over_time import OverTime

SCHEMA = "locsnn-report/1"
OPERATION_KEYS = ("synaptic_ops", "neuron_updates", "spikes", "input_events", "transpose_events")


def report_document(
    levels: Levels,
    match: Match,
    grounds: Grounds,
    diagnosis: Diagnosis | None = None,
    followed: OverTime | str | None = None,
) -> Document:
    """Return the report; every ``per_sample`` figure is a mean over the recordings of the check.

    Only a diagnosis gives ``error_budget``, ``margins`` and the cause of the first divergence, and only predictions
    ``followed`` over time give ``over_time``.
    """
    network, program, samples = levels.network, levels.program, match.samples
    counts, binned = total(match.counts), grounds.binned
    energy = energy_entry(program, match, network, grounds.step_seconds)
    target = target_of(program.chip)
    accesses = target.memory_accesses(program, network.steps, counts, samples)
    return {
        "schema": SCHEMA,
        "model": {
            "name": network.name,
            "sha256": network.sha256,
            "members": _members(levels, match, energy),
        },
        "target": program.chip.name,
        "strategy": program.provenance["strategy"],
        "weight_bits": max(projection.weight_bits for projection in levels.quantized.projections),
        "match": {
            "reference": "float64" if network.has_float_weights else "integers",
            "events_origin": grounds.events_origin,
            **_match(match, counts, cause_entry(diagnosis.cause) if diagnosis else None),
            "readout": _readout(network, match),
        },
        "accuracy": match.accuracy,
        **_chance(match),
        **({"classes": list(network.class_names)} if network.class_names else {}),
        "operations": {
            "per_sample": _per_sample(counts, samples),
            "by_branch": {
                name: _per_sample(c, samples) for name, c in match.counts_by_phase.items()
            },
            "published_method": _published(network, match),
        },
        "energy": energy,
        **({"activity": accesses} if accesses else {}),
        "latency": latency_entry(program, match, network.steps, grounds.step_seconds),
        "resources": _resources(program, network.steps),
        "ann_comparison": _ann_comparison(
            network, match, energy["per_sample_pj"], counts["synaptic_ops"] / samples
        ),
        "skipped": {
            "steps": counts.skipped_steps,
            "events_dropped": counts.events_dropped,
            **({"binning": binned.document() | {"words": binned.words}} if binned else {}),
            "synapses_pruned": program.synapses_pruned,
            "biases_lost": sum(q.biases_lost for q in levels.quantized.populations),
            "compartments_pruned": sum(g.size for g in levels.compartments.groups)
            - sum(core.compartments for core in program.cores),
        },
        "input": _input(network, match),
        "assumptions": list(grounds.assumptions),
        "gates": [],
        "quantization": _quantization(levels),
        "range": _range(program),
        **(
            {"error_budget": budget_entry(diagnosis), "margins": margins_entry(diagnosis)}
            if diagnosis
            else {}
        ),
        **(
            {"over_time": over_time_entry(followed, program, grounds.step_seconds)}
            if followed
            else {}
        ),
    }


def _chance(match: Match) -> Document:
    """Return the test of the accuracy against chance; nothing where there are too few labels."""
    if match.chance is None:
        return {}
    return {"chance": asdict(match.chance) | {"told_apart": match.chance.told_apart}}


def _members(levels: Levels, match: Match, energy: Document) -> list[Document]:
    """Return, for each network of a committee, its cores, the energy of its compartments, and its time by itself.

    Energy and time are None if not known, as where one core hosts all members, one after the other.
    """
    rows = []
    target = target_of(levels.program.chip)
    times_members = target.timed and target.times_cores
    for member in levels.network.members:
        cores = [c for c in levels.program.cores if c.slices[0].group.startswith(f"{member.name}/")]
        by_population = energy["by_population_pj"]
        its = [
            found["pj"]
            for name, found in (by_population or {}).items()
            if name.startswith(f"{member.name}/")
        ]
        per_sample_pj = None if by_population is None else sum(its)
        per_sample_ns = match.member_ns[member.name] / match.samples if times_members else None
        costs = {"per_sample_pj": per_sample_pj, "per_sample_ns": per_sample_ns}
        rows.append({**asdict(member), "cores": len(cores), **costs})
    return rows


def _input(network: Network, match: Match) -> Document:
    """Return the mean steps before the start of recordings: of the phase that starts last, and of each that aligns."""
    aligned = any(view.align_events for view in network.views)
    steps = {
        name: counts.aligned_steps / match.samples
        for name, counts in match.counts_by_phase.items()
        if aligned
    }
    return {"aligned_steps": max(steps.values(), default=0.0), "aligned_steps_by_branch": steps}


def _match(match: Match, counts: Counts, cause: Document | None) -> Document:
    first = match.first_divergence
    return {
        **picked(match, "samples", "events_source", "prediction_agreement"),
        **_spikes(match.spikes),
        "tied_predictions": match.tied_predictions,
        "score_error": match.scores.relative_error,
        "class_scores": picked(match.scores, "mean_spread", "mean_error"),
        "by_population": {name: _spikes(found) for name, found in match.by_population.items()},
        "helper_neurons": {name: _spikes(found) for name, found in match.helpers.items()},
        "first_divergence": None if first is None else asdict(first) | {"cause": cause},
        **picked(counts, "wraps", "clips"),
        "wraps_and_clips_by_population": match.wraps_and_clips,
    }


def _spikes(found: PopulationMatch) -> Document:
    return spikes_entry(found) | picked(found, "reference_spikes", "chip_spikes")


def _readout(network: Network, match: Match) -> Document:
    """Return what predicts: spikes or potentials of these populations; silent if neither side has any."""
    populations, read = list(network.readout.populations), list(network.readout.from_step)
    spiked = any(match.by_population[name].agreement is not None for name in populations)
    silent = match.tied_predictions == match.samples if read else not spiked
    if not read or read == populations:
        return {
            "populations": populations,
            "by": "potentials" if read else "spikes",
            "silent": silent,
        }
    return {
        "populations": populations,
        "by": "spikes and potentials",
        "potentials_of": read,
        "silent": silent,
    }


def _per_sample(counts: Counts, samples: int) -> dict[str, float]:
    return {key: counts[key] / samples for key in OPERATION_KEYS}


def _published(network: Network, match: Match) -> Document:
    """Return operations on paper: spikes of the reference times fan-out, and events through the transpose buffer."""
    by_branch = {axis: n / match.samples for axis, n in match.additions.items()}
    transposed = total(match.counts).transpose_events / match.samples
    return {
        "additions": sum(by_branch.values()),
        "additions_by_branch": by_branch,
        "transpose_events": transposed,
        "operations": sum(by_branch.values()) + transposed,
    }


def _resources(program: ChipProgram, steps: int) -> Document:
    """Return what a program takes, for recordings of ``steps`` steps."""
    target = target_of(program.chip)
    limits = program.chip.limits
    rows = [_core_use(program, core) for core in program.cores]
    uses = target.limits_used(program, steps)
    return {
        "cores": target.cores_used(program),
        "compartments": sum(row["compartments"] for row in rows),
        "synapses": sum(row["synapses"] for row in rows),
        "synapse_bits": sum(row["synapse_words"] for row in rows)
        * program.chip.synapse_memory.word_bits,
        "axons_in": sum(row["axons_in"] for row in rows),
        "axons_out": sum(row["axons_out"] for row in rows),
        "limits": {name: use._asdict() for name, use in uses.items()},
        "mesh": picked(program.chip, "chips")
        | picked(limits, "cores_per_chip")
        | asdict(program.chip.mesh),
        "by_core": rows,
    }


def _core_use(program: ChipProgram, core: Core) -> Document:
    return {
        **place(program, core),
        "compartments": core.compartments,
        "synapses": len(core.axons.target),
        "synapse_words": core.axons.synapse_words,
        "axons_in": core.axons.input_axons,
        "axons_out": core.axons.output_axons,
        "synapse_formats": len(core.axons.formats),
        "compartment_profiles": len(core.profiles),
        "threshold_profiles": len(core.thresholds),
    }


def _ann_comparison(network: Network, match: Match, own_pj: float, synaptic_ops: float) -> Document:
    """Return the published comparison at this network's input size.

    ``ratio`` is to the float network's operations on paper, and ``chip_ratio`` to the program's synaptic operations;
    they are None if there are no such operations, or if the other network is not defined for this input.
    """
    own = _published(network, match)["operations"]
    found: Document = {}
    for name in paper.ANN_NAMES:
        counted = _ann_counts(name, network)
        if counted is None:
            found[name] = dict.fromkeys(("operations", "ratio", "chip_ratio"))
            continue
        energies = paper.ann_energy_pj(counted)
        found[name] = {
            "operations": counted.operations,
            "ratio": counted.operations / own if own else None,
            "chip_ratio": counted.operations / synaptic_ops if synaptic_ops else None,
            **picked(counted, "macs", "multiplications", "additions"),
            "energy_pj": energies,
            "energy_ratio": {
                arithmetic: pj / own_pj if own_pj else None for arithmetic, pj in energies.items()
            },
            "energy_source": paper.ANN_ENERGY_SOURCE,
            "energy_not_included": list(paper.ANN_NOT_INCLUDED),
        }
    return found


def _ann_counts(name: str, network: Network) -> paper.AnnCounts | None:
    """Return the operations of an artificial network on this input; None if it is not defined for it."""
    if network.sensor is None:
        return None
    try:
        return paper.ann_counts(
            name, sensor=network.sensor, steps=network.steps, classes=network.classes
        )
    except hw.InputError:  # no frames, or a recording too short for that network's kernels
        return None


def _quantization(levels: Levels) -> Document:
    quantized = levels.quantized
    return {
        q.population.name: {
            "strategy": q.strategy,
            "scale": _spread(q.scale),
            "threshold_mantissa": _spread(q.neuron.threshold),
            "decay_u": _spread(q.neuron.decay_u),
            "decay_v": _spread(q.neuron.decay_v),
            "kernel_fit": None if q.fit is None else asdict(q.fit),
            "weight_exponents": [
                p.exponent for p in quantized.projections if p.target == q.population.name
            ],
        }
        for q in quantized.populations
    }


def _spread(values: AnyArray) -> Any:
    """Return the value that all neurons share, or else the least and the largest."""
    low, high = values.min().item(), values.max().item()
    return low if low == high else [low, high]


def _range(program: ChipProgram) -> Document:
    """Return what is proven of the registers, by group; the period is the longest that a compartment needs."""
    proven = {
        core.number: bounds
        for core, bounds in zip(program.cores, hw.prove_range(program), strict=True)
    }

    def by_column(phase: str, key: str) -> IntArray:
        return program.by_column(phase, lambda core: getattr(proven[core.number], key))

    found: Document = {}
    for phase in program.phases:
        wrap, clip, period = (
            by_column(phase.name, key) for key in ("cannot_wrap", "cannot_clip", "safe_period")
        )
        for group, here in program.columns_of(phase.name).items():
            found[group] = {
                "compartments": program.populations[group],
                "cannot_wrap": int(wrap[here].sum()),
                "cannot_clip": int(clip[here].sum()),
                "safe_period_steps": int(period[here].max()) if period[here].all() else None,
            }
    return found
