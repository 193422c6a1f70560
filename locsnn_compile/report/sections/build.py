"""Sections on the program itself: resources, what was left out, rounding, provenance, and the settings compared.

``counts_cores`` tells the two kinds of targets apart: a mesh has many cores, each with limits on what it
holds; the open core is one core with memories that fill up.
"""

from collections.abc import Iterator, Mapping, Sequence

from locsnn_compile.network.quantized import KernelFit
from locsnn_compile.report.content import Bar, Block, Bullets, Cell, Facts, Folded, Section, Table
from locsnn_compile.report.figures.checks import CandidateFigures, ChoiceFigures
from locsnn_compile.report.figures.document import GateFigures, ReportFigures, SharedFigures
from locsnn_compile.report.figures.entries import keys_of
from locsnn_compile.report.figures.resources import (
    CoreUse,
    LimitUse,
    MemoryFigures,
    PopulationNumbers,
    ProvenRange,
    ResourceFigures,
)
from locsnn_compile.report.format import (
    any_value,
    count,
    energy,
    known,
    memory,
    plural,
    share,
    time,
)
from locsnn_compile.report.sections.verdict import counts_cores, fullness, outside, starts
from locsnn_compile.report.words import limit_words, listed, words
from locsnn_compile.request.choose_strategy import Choice
from locsnn_compile.settings import LAYOUTS

QUANTISATION = "Quantisation"
NUMBERS = "Numbers of the chip by population"
_WITHOUT_JOINED = {"reset", "native"}
"""Strategies in which a neuron is a single compartment; in all others, compartments join."""
_ABOUT_NUMBERS = (
    "A potential of 1 in the float network is the scale in the chip's registers. Decays are in "
    "4096ths. Where two numbers are given, they are the smallest and the largest in the population. "
    "The kernel fit compares the chip's responses to an input spike and to the neuron's own spike with "
    "the kernels: the largest error (max) as a share of the kernel's peak, and the root mean square of "
    "the error (rms) as a share of the kernel's."
)
_RANGE = (
    "Bounds on every register, derived only from weights, decays and thresholds. Registers that are "
    "not proven safe were monitored: the wraps and clips above are all that occurred."
)
PROVENANCE = "Everything needed to reproduce this report; the same input gives the same bytes."
_MODELLED = "Energy and latency are models: counts times published costs. No board was used."
_MODELLED_ENERGY = (
    "Energy is a model: counts times the costs of the profile. Latency is an exact number of "
    "cycles, at the clock that the target's description states. No such chip was made."
)
_JOINED = (
    "Joined compartments (dendrites) are an assumption about the chip: public sources name them, but "
    "none gives their integer timing."
)
_SILENT_SOURCES = (
    "Where public sources on the chip are silent or disagree, the target's description decides."
)


def resources(report: ReportFigures) -> Section:
    """Return the section on how full the chip is: every limit, the fullest first, and then core by core."""
    figures = report.resources
    facts = {
        "compartments": count(figures.compartments),
        "synapses": f"{count(figures.synapses)}, {memory(figures.synapse_bits)} of synapse memory",
        "axons": f"{count(figures.axons_in)} in, {count(figures.axons_out)} out",
    }
    return Section.of(
        "resources",
        "Resources",
        f"How much of {report.target} the program uses.",
        Facts.of(facts),
        *_memories_and_limits(figures, of_cores=counts_cores(report)),
    )


def _memories_and_limits(figures: ResourceFigures, *, of_cores: bool) -> tuple[Block | None, ...]:
    """Return the limits of cores and what each core holds or, for the open core, its memories."""
    limits = _limits(figures.limits, of_cores=of_cores)
    if of_cores:
        return limits, Folded.of("What each core holds", _by_core(figures.by_core))
    if figures.memories is None:
        return (limits,)
    return _memories(figures.memories), Folded.of("Parameters of the core", limits)


def _memories(memories: Mapping[str, MemoryFigures]) -> Table:
    """Return how full each memory is, the fullest first, and all together."""
    rows: list[tuple[Cell, ...]] = []
    fullest_first = sorted(memories.items(), key=lambda named: -named[1].used_bits / named[1].bits)
    for name, use in fullest_first:
        filled = use.used_bits / use.bits
        bar = Bar(filled, f"{share(filled)} used")
        rows.append(_memory_row(words(name), bar, use.used_bits, use.bits))
    used_bits = sum(use.used_bits for use in memories.values())
    bits = sum(use.bits for use in memories.values())
    rows.append(_memory_row("all", "", used_bits, bits))
    return Table(
        "Memories of the core in bits, the fullest first",
        ("memory", "", "used", "of", "share"),
        tuple(rows),
        total=True,
    )


def _memory_row(name: str, bar: Cell, used_bits: int, bits: int) -> tuple[Cell, ...]:
    return name, bar, count(used_bits), count(bits), share(used_bits / bits)


def _limits(limits: Mapping[str, LimitUse], *, of_cores: bool) -> Table:
    """Return how full each limit is, the fullest first."""
    # A limit of 0 that nothing uses is of something that the target does not have.
    present = ((name, use) for name, use in limits.items() if use.used or use.limit)
    rows = []
    for name, use in sorted(present, key=lambda named: -fullness(named[1])):
        filled = share(fullness(use))
        bar = Bar(fullness(use), f"{filled} used")
        limit = limit_words(name, of_cores=of_cores)
        rows.append((limit, bar, count(use.used), count(use.limit), filled))
    caption = "Limits, the fullest first"
    if of_cores:
        caption = f"{caption}; for limits of a core, its fullest core"
    return Table(
        caption,
        ("limit", "", "used", "of", "share"),
        tuple(rows),
    )


def _by_core(cores: Sequence[CoreUse]) -> Table | str:
    if not cores:
        return "No core is in use."
    return Table(
        "Core by core",
        ("core", *(words(name) for name in vars(cores[0].contents))),
        tuple(
            (
                f"{core.place.core}, {words(core.place.phase)}",
                *(any_value(number) for number in vars(core.contents).values()),
            )
            for core in cores
        ),
    )


def left_out(report: SharedFigures) -> Section:
    """Return the section on what was left out: steps, events, synapses, compartments and biases."""
    skipped = report.skipped
    lost = skipped.biases_lost
    # Facts.of leaves out what is None.
    facts = {
        "steps skipped": f"{count(skipped.steps)} over all recordings, in which nothing could change",
        "steps before the touch": _steps_before(starts(report)),
        "events dropped": f"{count(skipped.events_dropped)} over all recordings, {outside(report)}",
        "binning": None if skipped.binning is None else skipped.binning.words,
        "synapses pruned": f"{count(skipped.synapses_pruned)}, whose weight rounds to 0",
        "compartments pruned": count(skipped.compartments_pruned),
        "biases lost": f"{count(lost)}, which round to 0" if lost else None,
    }
    lead = "What was skipped, dropped, pruned or lost."
    return Section.of("left-out", "Left out", lead, Facts.of(facts))


def _steps_before(steps_by_branch: Mapping[str, float]) -> str | None:
    """Say how many steps before the first event of a recording are not played; None if all are."""
    if not steps_by_branch:
        return None
    branches = [f"{number:.1f} ({words(name)})" for name, number in steps_by_branch.items()]
    return f"{listed(branches)} per recording, which starts after them"


def quantization(report: ReportFigures) -> Section:
    """Return the section on scales, decays and rounding errors by population."""
    table = Table(
        NUMBERS,
        ("population", *(words(key) for key in keys_of(PopulationNumbers))),
        tuple((name, *_numbers(numbers)) for name, numbers in report.quantization.items()),
    )
    return Section.of("quantization", QUANTISATION, _ABOUT_NUMBERS, table)


def _numbers(numbers: PopulationNumbers) -> tuple[str, ...]:
    """Return the cells of a population, in the order of the fields, which head the columns."""
    return (
        numbers.strategy,
        any_value(numbers.scale),
        any_value(numbers.threshold_mantissa),
        any_value(numbers.decay_u),
        any_value(numbers.decay_v),
        known(numbers.kernel_fit, _fit),
        any_value(numbers.weight_exponents),
    )


def _fit(fit: KernelFit) -> str:
    errors = vars(fit).items()
    return ", ".join(f"{words(name)} {share(error)}" for name, error in errors if error is not None)


def ranges(report: ReportFigures) -> Section:
    """Return the section on what is proven about the registers for any input, and up to which input rate."""
    table = Table(
        "Compartments that are safe for any input",
        (
            "compartments",
            "number",
            "cannot wrap",
            "cannot clip",
            "all safe if no source spikes twice within",
        ),
        tuple(
            (
                name,
                count(proven.compartments),
                count(proven.cannot_wrap),
                count(proven.cannot_clip),
                _period(proven),
            )
            for name, proven in report.range.items()
        ),
    )
    return Section.of("range", "Proof of range", _RANGE, table)


def _period(proven: ProvenRange) -> str:
    steps = proven.safe_period_steps
    if steps is None:
        return "no rate is proven safe"
    # Every source may spike once per step, which no input exceeds.
    return "any input is safe" if steps == 1 else f"{count(steps)} steps"


def provenance(report: ReportFigures) -> Section:
    """Return the section on what was compiled, how, for which target, and checked on which recordings."""
    strategies = report.strategy.split(", ")
    notes = tuple(_caveats(report, strategies))
    return Section.of(
        "provenance",
        "Provenance",
        PROVENANCE,
        origin(report),
        gates(report.gates),
        Bullets("Keep in mind", notes) if notes else None,
    )


def origin(report: SharedFigures) -> Facts:
    """Return what was compiled, for which target, how, and on which recordings it was checked."""
    strategies = report.strategy.split(", ")
    layouts = (f"{name}: {LAYOUTS[name]}" if name in LAYOUTS else name for name in strategies)
    return Facts.of(
        {
            "model": report.model.name,
            "model sha256": any_value(report.model.sha256),
            "target": report.target,
            "strategy": "; ".join(layouts),
            "weight bits": any_value(report.weight_bits),
            "recordings": f"{count(report.match.samples)} of {report.match.events_source}",
            "schema": report.schema,
        }
    )


def _caveats(report: ReportFigures, strategies: Sequence[str]) -> Iterator[str]:
    """Yield notes on what is modelled or assumed about the chip.

    Nothing is assumed about how the open core computes, because its RTL defines it.
    """
    if not counts_cores(report):
        if report.energy is not None:
            yield _MODELLED_ENERGY
        return
    if report.energy is not None:
        yield _MODELLED
    if not _WITHOUT_JOINED.issuperset(strategies):
        yield _JOINED
    yield _SILENT_SOURCES


def gates(bounds: Sequence[GateFigures]) -> Table | None:
    """Return a table of the bounds that the user sets on figures; None without any."""
    if not bounds:
        return None
    return Table(
        "Gates",
        ("gate", "bound", "measured", "passed"),
        tuple(
            (
                any_value(gate.name),
                any_value(gate.bound),
                any_value(gate.measured),
                any_value(gate.passed),
            )
            for gate in bounds
        ),
    )


def settings_chosen_from(choice: ChoiceFigures | None) -> Section | None:
    """Return the section on the setting that ``auto`` chose, by which rule, out of which; None if it did not."""
    if choice is None:
        return None
    lead = "The setting of the program was chosen among these, on calibration recordings."
    return Section.of(
        "choice", "Choice of the setting", lead, _weighing(choice), settings_compared(choice)
    )


def _weighing(choice: ChoiceFigures) -> str | None:
    """Say by which rule settings were weighed; None if the budget alone decided."""
    if choice.spike_worth is None or not choice.kept:
        return None
    return (
        f"A setting that loses another percent of the spikes has to save {choice.spike_worth:g} % "
        "of the cost (--spike-worth). Weighed is the cost, relative to the cheapest setting within "
        "the error budget, with that added."
    )


def settings_compared(choice: ChoiceFigures) -> Table:
    """Return a table of the settings that were compared; without energy, their cost is time."""
    priced = choice.candidates[0].energy_pj is not None
    weighed_column = () if choice.weighed(choice.candidates[0]) is None else ("weighed",)
    recordings = f"{plural(choice.calibration_samples, 'recording')} of {choice.calibration_source}"
    return Table(
        f"Settings compared on {recordings}; taken: {choice.taken}, {_reason(choice)}",
        (
            "setting",
            "same prediction",
            "spikes that differ",
            "error of class scores",
            "energy" if priced else "time",
            *weighed_column,
            "within the error budget",
        ),
        tuple(_candidate(choice, candidate, priced=priced) for candidate in choice.candidates),
    )


def _candidate(
    choice: ChoiceFigures, candidate: CandidateFigures, *, priced: bool
) -> tuple[str, ...]:
    weighed = choice.weighed(candidate)
    cost = time(candidate.chip_time_ns)
    if priced:
        cost = known(candidate.energy_pj, energy, "")
    return (
        str(candidate.setting),
        known(candidate.prediction_agreement, share, "all tie"),
        known(candidate.spike_error, share, "silent"),
        known(candidate.score_error, share, "all tie"),
        cost,
        *(() if weighed is None else (f"{weighed:.3f}",)),
        any_value(candidate.within_budget),
    )


def unmet_budget(choice: Choice) -> str:
    """Say in one line that no setting keeps the budget, what the best one loses, and what to do."""
    best = choice.taken
    budget = choice.budget
    # Then the recordings are at fault: nothing that the budget bounds was compared.
    is_silent = best.spike_agreement is None or (
        budget.min_agreement is not None and best.prediction_agreement is None
    )
    fix = "Train for the chip with locsnn train --target, or allow more."
    if is_silent:
        fix = "Give --calibration recordings in which outputs spike."
    unknown = "an unknown share"
    return (
        f"no setting keeps {budget.words()} on {plural(choice.samples, 'recording')} of "
        f"{choice.source}: the best of {len(choice.candidates)} is {best.setting}, with "
        f"{known(best.prediction_error, share, unknown)} of the predictions changed, "
        f"{known(best.spike_error, share, unknown)} of the spikes different and class scores off by "
        f"{known(best.score_error, share, unknown)} of their spread. {fix}"
    )


def _reason(choice: ChoiceFigures) -> str:
    """Say why a setting was taken."""
    if not choice.budget.given:
        return "the most exact one, as nothing was compared"
    if choice.kept and choice.spike_worth is not None:
        return "the least weighed cost within the error budget"
    if choice.kept:
        return "the cheapest within the error budget"
    return "the most accurate, as none is within the error budget"
