"""The verdicts at the top of a report, and the notices that a reader must know before believing its figures.

A verdict is a question with its answer: does the program match the network, does it fit the chip, what does a
recording cost. ``counts_cores`` tells a mesh of cores from the open core, which is one core of our own RTL.
"""

from collections.abc import Mapping

from locsnn_compile.report.content import Fact, Facts, Notice, Status, Verdict
from locsnn_compile.report.figures.document import MemberFigures, ReportFigures, SharedFigures
from locsnn_compile.report.figures.energy import EnergyFigures
from locsnn_compile.report.figures.latency import LatencyFigures
from locsnn_compile.report.figures.match import MatchFigures
from locsnn_compile.report.figures.operations import ConventionalNetwork
from locsnn_compile.report.figures.resources import LimitUse, MemoryFigures
from locsnn_compile.report.format import (
    NONE,
    SILENT,
    count,
    energy,
    known,
    memory,
    plural,
    points,
    ratio,
    share,
    time,
)
from locsnn_compile.report.words import limit_words, listed, stage_words, words
from locsnn_compile.verification.chance import Chance

NEARLY = 0.95
"""The least prediction agreement for the answer "nearly", chosen by hand."""
MOST_SCORE_ERROR = 0.05
"""The largest error of class scores, as a share of their spread, for the answer "yes" where potentials are read.

Nothing else compares potentials, and a few recordings keep their class at errors that change the class of others.
"""
_ROUNDING = 1e-9
"""Class scores whose error is smaller differ only as floats round."""
_WIDTHS = {"charge", "join", "step", "later"}
"""Limits of the open core that are widths of numbers in bits: a program needs them, but does not fill them."""
SPIKE_FOR_SPIKE = "Yes, spike for spike"
SAME_CLASSES = "Nearly, in every prediction"


def matches(report: SharedFigures) -> Verdict:
    """Does the chip do what the network does?"""
    match = report.match
    status, answer = _answer(match)
    sentence = _comparison_of_both_sides(match, status, answer)
    # A program can match a network perfectly and both be useless, for instance on recordings that were
    # prepared in another way than those of the training.
    if report.chance is not None and not report.chance.told_apart:
        sentence += f". {_at_chance(report.chance.test)}"
        if status == "yes":
            status, answer = "nearly", f"{answer}, but it predicts no better than chance"
    same = _same_predictions(match)
    return Verdict(
        question="Does it match?",
        status=status,
        answer=answer,
        figure=known(match.prediction_agreement, share, SILENT if match.readout.silent else NONE),
        figure_label=f"same prediction, {same}" if same else "no prediction to compare",
        sentence=f"{sentence}.",
        facts=_facts_of_match(report).facts,
    )


def _facts_of_match(report: SharedFigures) -> Facts:
    """Return how well the chip agrees with the network, in short facts."""
    match = report.match
    return Facts.of(
        {
            "accuracy": _accuracy(report),
            "spikes": known(
                match.spikes.spike_agreement,
                lambda part: f"{share(part)} at the same neuron and step",
                "none on either side",
            ),
            "first difference": _first_difference(match),
            "class scores": _scores(match) if match.readout.reads_potentials else "",
        }
    )


def _answer(match: MatchFigures) -> tuple[Status, str]:
    """Return what the check proved.

    It proves nothing if the readout is silent, or if spikes differ and no class is predicted.
    """
    agreement = match.prediction_agreement
    spiked = match.spikes.spike_agreement is not None
    every_spike_equal = spiked and match.spikes.spike_mismatches == 0
    if match.readout.silent:
        return "unknown", "Not known"
    if agreement is None:
        return ("yes", SPIKE_FOR_SPIKE) if every_spike_equal else ("unknown", "Not known")
    if agreement < 1:
        return ("nearly", "Nearly") if agreement >= NEARLY else ("no", "No")
    score_error = match.score_error or 0
    if match.readout.reads_potentials and score_error > MOST_SCORE_ERROR:
        return "nearly", SAME_CLASSES
    return "yes", SPIKE_FOR_SPIKE if every_spike_equal else "Yes, in every prediction"


def _comparison_of_both_sides(match: MatchFigures, status: Status, answer: str) -> str:
    """Return the sentence of the verdict, without its full stop."""
    network = "the float network"
    if match.reference == "integers":
        network = "the network in its own integers"
    same = _same_predictions(match)
    sentence = "Every class score ties"
    if status == "unknown":
        unproven = "no prediction was compared"
        if match.spikes.spike_agreement is None:
            unproven = "nothing was compared"
        sentence = f"{_not_compared(match)}, in {network} or on the chip: {unproven}"
    elif same:
        sentence = f"The chip predicts the same class as {network} {same}"
    if answer == SPIKE_FOR_SPIKE:
        sentence += ", and every spike is equal"
    if status != "unknown" and same and match.tied_predictions:
        tied = count(match.tied_predictions)
        sentence += f"; {tied} more are not predicted, as all class scores tie on both sides"
    if answer == SAME_CLASSES:
        sentence += f", but class scores {_scores(match)}"
    return sentence


def _same_predictions(match: MatchFigures) -> str:
    """Return in how many recordings both sides predict the same class; nothing if none was predicted."""
    if match.prediction_agreement is None:
        return ""
    # Where all class scores of both sides tie, no class is predicted.
    predicted = match.samples - match.tied_predictions
    same = round(match.prediction_agreement * predicted)
    return f"in {count(same)} of {plural(predicted, 'recording')}"


def _at_chance(test: Chance) -> str:
    return (
        f"The accuracy of {share(test.right / test.recordings)} on "
        f"{plural(test.recordings, 'recording')} cannot be told from guessing the commonest label, "
        f"which has {share(test.commonest_share)} of them: the recordings may be numbered, timed or "
        "labelled in another way than those of the training"
    )


def _not_compared(match: MatchFigures) -> str:
    """Say why no prediction was compared."""
    if not match.readout.silent or match.readout.by != "spikes":
        return "No class score is above another"
    if match.spikes.spike_agreement is None:
        return "No neuron spiked"
    return "No output neuron spiked"


def costs(report: ReportFigures, figures: EnergyFigures) -> Verdict:
    """How much energy and time does a recording take in the model?"""
    per_recording = energy(figures.per_sample_pj)
    spent = f"{per_recording} of dynamic energy (profile {figures.profile})"
    if counts_cores(report):
        answer = "Modelled, not measured"
        sentence = _cost_on_mesh(report.latency, spent)
    else:
        answer = "Cycles exact, energy modelled"
        sentence = _cost_on_open_core(report.latency, spent)
    return Verdict(
        question="What does it cost?",
        status="modelled",
        answer=answer,
        figure=per_recording,
        figure_label=f"dynamic energy per recording, profile {figures.profile}",
        sentence=sentence,
        facts=_facts_of_cost(report, figures),
    )


def _cost_on_mesh(latency: LatencyFigures, spent: str) -> str:
    latency_ns = latency.per_sample_ns if latency.timed else None
    duration = known(latency_ns, time, "an unknown time")
    return f"In the model, a recording takes {spent} and {duration}."


def _cost_on_open_core(latency: LatencyFigures, spent: str) -> str:
    """Say the cost on the open core, whose cycles are exact: its RTL is simulated rather than modelled."""
    cycles = f"{count(latency.per_sample_cycles)} cycles on the open core"
    clock = f"{1000 * latency.clock_ghz:g} MHz"
    duration = time(latency.per_sample_ns)
    return f"A recording takes {cycles}, {duration} at {clock}, and in the model {spent}."


def _facts_of_cost(report: ReportFigures, figures: EnergyFigures) -> tuple[Fact, ...]:
    """Return energy and latency of a recording in short facts."""
    spread = figures.over_samples_pj
    facts = [
        Fact("range", f"{energy(spread.min)} to {energy(spread.max)}, median {energy(spread.p50)}")
    ]
    for name, pj in figures.other_profiles_pj.items():
        facts.append(Fact("other profile", f"{energy(pj)} with {name}"))
    facts.append(Fact("latency", _latency(report)))
    for entry in report.model.members:
        facts.append(Fact(entry.member.name, member_words(entry)))
    if starts(report):
        steps = f"{report.input.aligned_steps:.1f} steps into a recording on average"
        facts.append(Fact("start", f"at the first touch, {steps}"))
    return (*facts, *against_anns(report))


def _latency(report: ReportFigures) -> str:
    figures = report.latency
    profile = f" (profile {figures.profile})" if counts_cores(report) else ""
    if not figures.timed:
        return f"not known, as no operation has a time{profile}"
    return f"{time(figures.per_sample_ns)}{against_real_time(figures)}{profile}"


def against_real_time(figures: LatencyFigures) -> str:
    """Return how the mean time compares with the duration of the recordings, after a comma."""
    if figures.recording_ns is None:
        return ""
    return f", {pace(figures.per_sample_ns, figures.recording_ns)}"


def member_words(entry: MemberFigures) -> str:
    """Return what a member of a committee takes, and the weight of its class scores."""
    return ", ".join(
        (
            known(entry.per_sample_pj, energy, "energy not known"),
            known(entry.per_sample_ns, time, "time not known"),
            plural(entry.cores, "core"),
            f"class scores times {entry.member.weight:.4g}",
        )
    )


def fits(report: ReportFigures) -> Verdict:
    """Does the chip hold the program, and how much room is left?"""
    resources = report.resources
    limits = resources.limits
    exceeded = {name for name, use in limits.items() if use.used > use.limit}
    if resources.memories is not None and not exceeded:
        return _fits_memories(report, resources.memories)
    # The limit to show: one that is exceeded, if any; else one that a program fills, if any; of these
    # the fullest.
    worst = max(
        limits,
        key=lambda name: (
            name in exceeded,
            _is_filled(name, limits[name]),
            fullness(limits[name]),
        ),
    )
    cores_in_use = "the open core"
    if counts_cores(report):
        cores = limits["cores"]
        cores_in_use = f"{count(cores.used)} of {plural(cores.limit, 'core')}"
    use = limits[worst]
    limit = limit_words(worst, of_cores=counts_cores(report))
    facts = {
        "fullest limit": f"{limit}, {count(use.used)} of {count(use.limit)} "
        f"({share(fullness(use))})",
        **_size(report),
    }
    return Verdict(
        question="Does it fit?",
        status="no" if exceeded else "yes",
        answer="No" if exceeded else "Yes",
        figure=cores_in_use,
        figure_label=f"of {report.target}; {limit} {share(fullness(use))} full",
        sentence=f"The program runs on {cores_in_use} of {report.target}.",
        facts=Facts.of(facts).facts,
    )


def _fits_memories(report: ReportFigures, memories: Mapping[str, MemoryFigures]) -> Verdict:
    """Answer with the fullest memory, for an open core that holds the program."""
    fullest = max(memories, key=lambda name: memories[name].used_bits / memories[name].bits)
    use = memories[fullest]
    filled = use.used_bits / use.bits
    all_used = sum(figures.used_bits for figures in memories.values())
    all_bits = sum(figures.bits for figures in memories.values())
    facts = {
        "fullest memory": f"{words(fullest)}, {count(use.used_bits)} of {count(use.bits)} bits "
        f"({share(filled)})",
        "all memories": f"{count(all_used)} of {count(all_bits)} bits "
        f"({share(all_used / all_bits)})",
        **_size(report),
    }
    return Verdict(
        question="Does it fit?",
        status="yes",
        answer="Yes",
        figure=share(filled),
        figure_label=f"of the fullest memory, {words(fullest)}",
        sentence=f"The open core of {report.target} holds the program, with {share(1 - filled)} of "
        "its fullest memory free.",
        facts=Facts.of(facts).facts,
    )


def _size(report: ReportFigures) -> dict[str, str]:
    """Return the size of the program."""
    resources = report.resources
    return {
        "compartments": count(resources.compartments),
        "synapses": f"{count(resources.synapses)} in {memory(resources.synapse_bits)}",
    }


def _is_filled(name: str, use: LimitUse) -> bool:
    """Whether a limit is a resource that a program fills up.

    Otherwise it is the width of a number, or a limit of 0 or 1, which says whether a core has a feature.
    """
    return use.limit > 1 and name not in _WIDTHS


def counts_cores(report: ReportFigures) -> bool:
    """Whether the target is a mesh, whose cores a program fills one after the other, and not the open core."""
    return "cores" in report.resources.limits


def notices(report: SharedFigures) -> tuple[Notice, ...]:
    """Return warnings about what limits the figures of this report; most reports have none."""
    warnings = []
    if report.match.wraps:
        warnings.append(Notice("Registers wrapped.", _wrapped(report.match.wraps)))
    dropped = report.skipped.events_dropped
    if dropped:
        where = f"{plural(dropped, 'event')} lay {outside(report)}"
        warnings.append(Notice("Events were dropped.", f"{where} and never reached the chip."))
    binning = report.skipped.binning
    if binning is not None and binning.dropped:
        warnings.append(Notice("Binning left events out.", f"{binning.words}."))
    return tuple(warnings)


def _wrapped(wraps: int) -> str:
    return (
        f"A register overflowed {plural(wraps, 'time')} and its value wrapped around to the other "
        "sign. What the neuron does after that says little about the float network."
    )


def outside(report: SharedFigures) -> str:
    """Return where events lie that are not played, in words."""
    return "before the start or after the last step" if starts(report) else "after the last step"


def starts(report: SharedFigures) -> Mapping[str, float]:
    """Return the mean steps before each branch starts, at the first event; empty if all start with the recording."""
    return report.input.aligned_steps_by_branch


def pace(latency_ns: float, recording_ns: float) -> str:
    """Return how a latency compares with the duration of the recording."""
    if latency_ns <= 0:
        return "no time at all"
    comparison = _times(recording_ns / latency_ns, "faster", "slower")
    return f"{comparison} than the {time(recording_ns)} recorded"


def against(name: str, times: float) -> str:
    """Return how operations compare with those of the conventional network ``name``, which has ``times`` as many."""
    return f"{_times(times, 'fewer', 'more')} than {words(name)}"


def _times(factor: float, more: str, less: str) -> str:
    """Return a factor in words: with ``more`` from 1 on, else its inverse with ``less``."""
    if factor >= 1:
        return f"{ratio(factor)} times {more}"
    inverse = ratio(1 / factor) if factor else "infinitely many"
    return f"{inverse} times {less}"


def defined_anns(report: ReportFigures) -> dict[str, ConventionalNetwork]:
    """Return the conventional networks that are defined for this network's input."""
    return {
        name: network
        for name, network in report.ann_comparison.items()
        if isinstance(network, ConventionalNetwork)
    }


def against_anns(report: ReportFigures) -> tuple[Fact, ...]:
    """Return how the operations compare with those of conventional networks, counted on paper and on the chip."""
    networks = defined_anns(report)
    if not networks:
        return ()
    paper = _against_anns({name: network.ratio for name, network in networks.items()})
    chip = _against_anns({name: network.chip_ratio for name, network in networks.items()})
    return (
        Fact("paper operations", f"{paper} (the trained network, by the published method)"),
        Fact("chip operations", f"{chip} (synaptic operations of the program)"),
    )


def _against_anns(times_by_name: Mapping[str, float | None]) -> str:
    """Return the comparisons in words, given how many times as many operations each conventional network has."""
    comparisons = []
    for name, times in times_by_name.items():
        # The spiking network has no operations at all, so there is no ratio to any network.
        if times is None:
            return "nothing to compare: there were none"
        comparisons.append(against(name, times))
    return listed(comparisons)


def _accuracy(report: SharedFigures) -> str:
    """Return the accuracy of the chip and of the network, or why there is none."""
    if report.match.events_origin == "made up":
        return "not known, because the recordings are made up"
    if report.accuracy is None:
        return "not known, because the recordings have no labels"
    chip = report.accuracy.chip
    reference = report.accuracy.reference
    network = "as trained" if report.match.reference == "integers" else "float"
    return f"{share(chip)} on the chip, {share(reference)} {network} ({points(chip - reference)})"


def _scores(match: MatchFigures) -> str:
    """Return how class scores compare, in words that follow "class scores"."""
    error = match.score_error
    if error is None:
        return "not compared"
    return f"differ by {share(error)} of their spread" if error > _ROUNDING else "equal"


def _first_difference(match: MatchFigures) -> str:
    """Return where the spikes differ first, and by which stage of the compilation."""
    first = match.first_divergence
    if first is None:
        return NONE if match.spikes.spike_agreement is None else "none, every spike is equal"
    spike = first.place
    place = (
        f"{spike.population}, neuron {spike.neuron}, step {spike.step} of recording "
        f"{spike.recording}"
    )
    if first.cause is None:
        return place
    return f"{place}, by {stage_words(first.cause.largest)}"


def fullness(use: LimitUse) -> float:
    """Return the share of a limit in use; a limit of 0 is full as soon as anything is used."""
    if use.limit:
        return use.used / use.limit
    return float(use.used > 0)
