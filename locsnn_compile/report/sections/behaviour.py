"""Sections on what the program does: agreement with the network, operations, layers on the host, other networks."""

import math
from collections.abc import Mapping

from locsnn_compile.report.content import Bar, Block, Folded, Section, Table
from locsnn_compile.report.figures.document import ReportFigures
from locsnn_compile.report.figures.energy import EnergyFigures
from locsnn_compile.report.figures.host import HostFigures
from locsnn_compile.report.figures.match import MatchFigures, SpikesCompared
from locsnn_compile.report.figures.operations import (
    ConventionalNetwork,
    OperationFigures,
    PublishedOperations,
)
from locsnn_compile.report.format import (
    NONE,
    agreed,
    any_value,
    count,
    energy,
    known,
    plural,
    ratio,
    share,
    told_apart,
)
from locsnn_compile.report.sections.accuracy import (
    bars_words,
    cause,
    compared_bar,
    differing_at_most,
    no_spikes,
)
from locsnn_compile.report.sections.verdict import defined_anns
from locsnn_compile.report.words import listed, share_of, words

_Z = 1.959964
"""The two-sided 95 % point of the standard normal distribution, for confidence intervals."""
_AGREEMENT = (
    "A spike is equal where the same neuron fires at the same step in both: twice the common spikes "
    "over the sum of both sides, with no tolerance. Where a neuron has no reset, one early difference "
    "shifts later spikes."
)
_OPERATIONS = (
    "The chip's counts include what it adds to the network: joined compartments, their self-synapses, "
    "updates at rest. The published method counts on paper: spikes of the trained network times their "
    "fan-out, and the events that are transposed for the location branch."
)
_HOST = (
    "These layers run outside the chip, on numbers, and send spikes to it over {lines}. They are "
    "not in the program: its operations, energy and time begin with these spikes."
)
_COMPARISON = (
    "A multiplication and an addition of a conventional network are one operation each, at this "
    "network's input size. The trained network's operations are an estimate by the published method; "
    "those of the program are the synaptic operations that the chip counts, its own self-synapses "
    "included. Accuracy is not compared."
)


def agreement(match: MatchFigures) -> Section:
    """Return the section on agreement by population, the first spike that differs, wraps and clips."""
    helpers = match.helper_neurons
    return Section.of(
        "agreement",
        "Agreement by population",
        _AGREEMENT,
        _first_divergence(match),
        cause(match),
        _interval(match),
        _scores(match),
        _populations(match),
        _helpers(helpers) if helpers else None,
        Folded.of(
            "Wraps and clips by compartments", _wraps_and_clips(match.wraps_and_clips_by_population)
        ),
    )


def operations(figures: OperationFigures) -> Section:
    """Return the section on the counts of the chip by branch, next to the counts of the published method."""
    by_branch = {words(name): vars(counts) for name, counts in figures.by_branch.items()}
    columns = {**by_branch, "all": vars(figures.per_sample)}
    rows = (
        (words(key), *(count(counts[key]) for counts in columns.values()))
        for key in vars(figures.per_sample)
    )
    return Section.of(
        "operations",
        "Operations",
        _OPERATIONS,
        Table("Counted on the chip, mean per recording", ("operation", *columns), tuple(rows)),
        _published(figures.published_method),
    )


def host_layers(host: HostFigures | None) -> Section | None:
    """Return the section on the layers on the host, and what they compute; None without such layers."""
    if host is None:
        return None
    rows = tuple(
        (name, count(layer.neurons), count(layer.multiplications), count(layer.neuron_updates))
        for name, layer in host.layers.items()
    )
    columns = ("layer", "neurons", "multiplications", "neuron updates")
    return Section.of(
        "host",
        "Layers on the host",
        _HOST.format(lines=plural(host.lines, "line")),
        Table("Computed on the host, for each recording", columns, rows),
    )


def _published(paper: PublishedOperations) -> Table:
    rows = [
        (f"additions, {words(branch)}", count(additions))
        for branch, additions in paper.additions_by_branch.items()
    ]
    rows.append((words("transpose_events"), count(paper.transpose_events)))
    rows.append((words("operations"), count(paper.operations)))
    return Table(
        "Counted as published, mean per recording", ("operation", "all"), tuple(rows), total=True
    )


def comparison(report: ReportFigures) -> Section:
    """Return the section on operations and energy of conventional networks on the same input."""
    networks = defined_anns(report)
    blocks: tuple[Block, ...] = (
        "No comparison: the published networks are not defined for this network's input.",
    )
    if networks:
        blocks = (_operations_compared(report, networks),)
    if networks and report.energy is not None:
        blocks += _ann_energy(networks, report.energy)
    return Section.of("comparison", "Conventional networks", _COMPARISON, *blocks)


def _operations_compared(
    report: ReportFigures, networks: Mapping[str, ConventionalNetwork]
) -> Table:
    """Return a row per network: its operations, and how many times those of the spiking network they are."""
    on_paper = report.operations.published_method.operations
    on_chip = report.operations.per_sample.synaptic_ops
    largest = max(on_paper, on_chip, *(network.operations for network in networks.values()))

    def row(
        name: str, operations: float, times_paper: float | None, times_chip: float | None
    ) -> tuple[str | Bar, ...]:
        bar = Bar(share_of(operations, largest), plural(operations, "operation"))
        return name, bar, count(operations), known(times_paper, ratio), known(times_chip, ratio)

    # Each is once itself; the ratio of a count on paper to one on the chip would say nothing.
    rows = [
        row("the trained network, on paper", on_paper, 1 if on_paper else None, times_chip=None),
        row(
            "the program, synaptic operations",
            on_chip,
            times_paper=None,
            times_chip=1 if on_chip else None,
        ),
    ]
    for name, network in networks.items():
        rows.append(row(words(name), network.operations, network.ratio, network.chip_ratio))
    return Table(
        "Operations per recording",
        ("network", "", "operations", "times the trained network", "times the program"),
        tuple(rows),
    )


def _ann_energy(
    networks: Mapping[str, ConventionalNetwork], spiking: EnergyFigures
) -> tuple[Block, ...]:
    """Return a table of the energy of the conventional networks' arithmetic, and a paragraph on its source.

    Next to them stands the energy of this (the spiking) network, which does not depend on an arithmetic.
    """
    first = next(iter(networks.values()))
    arithmetics = list(first.energy_pj)
    spiking_energy = energy(spiking.per_sample_pj)
    rows = [("this network, as modelled", NONE, NONE, *[spiking_energy] * len(arithmetics))]
    for name, network in networks.items():
        energies = (_energy_cell(network, arithmetic) for arithmetic in arithmetics)
        rows.append(
            (words(name), count(network.multiplications), count(network.additions), *energies)
        )
    return (
        Table(
            "Energy of the arithmetic only; in brackets, as a multiple of this network's "
            f"(profile {spiking.profile})",
            ("network", "multiplications", "additions", *(words(key) for key in arithmetics)),
            tuple(rows),
        ),
        f"Source: {first.energy_source}. Not included for the conventional networks: "
        f"{listed(first.energy_not_included)}. This network's energy is for another process and "
        "includes its memories and its mesh: the ratio compares published figures, not two chips.",
    )


def _energy_cell(network: ConventionalNetwork, arithmetic: str) -> str:
    times = known(network.energy_ratio[arithmetic], ratio)
    return f"{energy(network.energy_pj[arithmetic])} ({times})"


def _scores(match: MatchFigures) -> str:
    """Say how far the class scores of both sides are apart; they may differ where classes and spikes are equal."""
    scores = match.class_scores
    if match.score_error is None:
        return "Class scores: not compared, as all scores of the network tie in every recording."
    return (
        f"Class scores of the chip differ from the network's by {scores.mean_error:.4g} on average: "
        f"{share(match.score_error)} of their spread, which is their mean distance from the mean of "
        f"all classes ({scores.mean_spread:.4g})."
    )


def _populations(match: MatchFigures) -> Table:
    """Return a row of spikes per population, and the row of all populations as the last."""
    compared = {**match.by_population, "all": match.spikes}
    full_at = differing_at_most(spikes.spike_agreement for spikes in compared.values())
    rows = [
        _spikes_row(name, spikes, no_spikes(match.readout, name), full_at)
        for name, spikes in compared.items()
    ]
    side = "network" if match.reference == "integers" else "float"
    return Table(
        f"Spikes over {plural(match.samples, 'recording')}; {bars_words(full_at)}",
        ("population", "", "spikes equal", f"{side} spikes", "chip spikes", "only on one side"),
        tuple(rows),
        total=True,
    )


def _spikes_row(
    name: str, spikes: SpikesCompared, none: str, full_at: float
) -> tuple[str | Bar, ...]:
    return (
        name,
        compared_bar(spikes.spike_agreement, none, full_at),
        agreed(spikes.spike_agreement, none),
        count(spikes.reference_spikes),
        count(spikes.chip_spikes),
        count(spikes.spike_mismatches),
    )


def _helpers(helpers: Mapping[str, SpikesCompared]) -> str:
    """Say which neurons were not compared: those that a reader of model files added."""
    populations = []
    for name, compared in helpers.items():
        in_network = f"{plural(compared.reference_spikes, 'spike')} in the network"
        populations.append(f"{name} ({in_network}, {count(compared.chip_spikes)} on the chip)")
    return (
        "Not counted, because only the compiler needs these neurons and the model has none: "
        f"{listed(populations)}."
    )


def _wraps_and_clips(events: Mapping[str, Mapping[str, int]]) -> Table | None:
    """Return the counts of wraps and clips by group of compartments; None if there are none."""
    kinds = sorted({kind for counts in events.values() for kind in counts})
    rows = tuple(
        (name, *(count(counts.get(kind, 0)) for kind in kinds))
        for name, counts in events.items()
        if any(counts.values())
    )
    if not rows:
        return None
    columns = ("compartments", *(words(kind) for kind in kinds))
    return Table("Wraps and clips over all recordings, where there are any", columns, rows)


def _first_divergence(match: MatchFigures) -> str:
    first = match.first_divergence
    if first is None and match.spikes.spike_agreement is None:
        return "First difference: not known, because neither side spikes."
    if first is None:
        return "First difference: none, every spike is equal."
    spike = first.place
    fires = _which_side_fires(
        reference=spike.reference_potential, chip=spike.chip_potential, threshold=spike.threshold
    )
    return (
        f"First difference: recording {any_value(spike.recording)}, population "
        f"{spike.population}, neuron {any_value(spike.neuron)}, step {any_value(spike.step)} "
        f"(all counted from 0). {fires}"
    )


def _which_side_fires(*, reference: float, chip: float, threshold: float) -> str:
    """Say which of two potentials reaches the threshold; if that is not clear from them, only give the numbers."""
    # The potentials may be nearly equal, so they get as many digits as tell them apart.
    reference_text, chip_text, threshold_text = told_apart((reference, chip, threshold))
    if reference >= threshold > chip:
        return (
            f"The float potential {reference_text} reaches the threshold {threshold_text} and fires; "
            f"the chip's {chip_text} does not."
        )
    if chip >= threshold > reference:
        return (
            f"The chip's potential {chip_text} reaches the threshold {threshold_text} and fires; "
            f"the float potential {reference_text} does not."
        )
    # Both on one side of the threshold: then a refractory period or another rule of the chip decided.
    return (
        f"The potential is {reference_text} in the float network and {chip_text} on the chip; "
        f"the threshold is {threshold_text}."
    )


def _interval(match: MatchFigures) -> str:
    """Say how much the recordings of the check prove about others: few of them prove little."""
    agreement = match.prediction_agreement
    interval = agreement_interval(match)
    if agreement is None or interval is None:
        return "No prediction was compared: all class scores tie in every recording, on both sides."
    compared = match.samples - match.tied_predictions
    low, high = interval
    return (
        f"Predictions are the same in {share(agreement)} of {plural(compared, 'recording')}. For "
        f"recordings of this kind in general, this suggests an agreement between {100 * low:.1f} "
        f"and {100 * high:.1f} % (95 % confidence)."
    )


def agreement_interval(match: MatchFigures) -> tuple[float, float] | None:
    """Return the Wilson score interval (95 %) of the prediction agreement; None if nothing was compared.

    With agreement p over n recordings and the normal quantile z, it is

        (p + z² / 2n ± z √(p (1 - p) / n + z² / 4n²)) / (1 + z² / n).

    Unlike p ± z √(p (1 - p) / n), it is not empty where all predictions agree.
    """
    p = match.prediction_agreement
    if p is None:
        return None
    n = match.samples - match.tied_predictions
    z2 = _Z * _Z
    centre = (p + z2 / (2 * n)) / (1 + z2 / n)
    half_width = _Z / (1 + z2 / n) * math.sqrt(p * (1 - p) / n + z2 / (4 * n * n))
    # Floats may round slightly beyond the ends.
    return max(0.0, centre - half_width), min(1.0, centre + half_width)
