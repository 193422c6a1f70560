"""Write the tables that take the error of the example networks apart, by stage of compiling, strategy and population.

    python tests/benchmarks/error_budget.py --data FOLDER --page docs/research/accuracy/where-the-error-comes-from.md

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip; all test recordings are played. The networks are the float networks
that ship, rounded for the train recordings as the compiler rounds; nothing is trained or chosen here.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from page_section import write_by_network

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.data.read import read_recordings
from locsnn_compile.reference.evaluate import calibrate
from locsnn_compile.report.figures.document import Findings, report_figures
from locsnn_compile.report.format import count, share, short
from locsnn_compile.report.grounds import Grounds
from locsnn_compile.report.sections.accuracy import cause
from locsnn_compile.report.words import STAGES, stage_words
from locsnn_compile.request.choose_strategy import lower_as
from locsnn_compile.settings import STRATEGIES, Setting
from locsnn_compile.verification.diagnosis import diagnose
from locsnn_compile.verification.error_budget.budget import Deviation
from locsnn_compile.verification.matching import Match, compare
from locsnn_compile.verification.observation import Observed

ROOT = Path(__file__).parents[2]
WEIGHT_BITS = 8


def section(data: Path, dataset: str) -> str:
    """Return the tables of one network."""
    network = lc.load(ROOT / f"examples/models/{dataset}-hybrid.pt")
    chip, archive = hw.chip("loihi-sim"), data / f"Ev-{dataset.title()}.zip"
    train, recordings = (read_recordings(archive, split=split) for split in ("train", "test"))
    calibration = calibrate(network, train, chip.registers)
    results_of_strategy = {}
    for strategy in STRATEGIES:
        levels = lower_as(network, chip, Setting(strategy, WEIGHT_BITS), calibration)
        observed = Observed(levels, recordings.spikes, recordings.labels)
        match = compare(observed)
        start = time.perf_counter()
        diagnosis = diagnose(observed, match.first_divergence, samples=None)
        print(f"{dataset} {strategy}: {time.perf_counter() - start:.1f} s")
        # All stages together must give exactly the simulator's spikes, or the stages would not be the whole error.
        assert diagnosis.budget is not None
        assert diagnosis.budget.unexplained == 0
        assert dict(diagnosis.budget.together.by_population) == match.by_population
        results_of_strategy[strategy] = (levels, match, diagnosis)
    _, _, dendrite = results_of_strategy["dendrite"]
    parts = [
        f"## {dataset.title()}, {len(recordings)} test recordings",
        by_strategy(
            {
                strategy: diagnosis.budget
                for strategy, (_, _, diagnosis) in results_of_strategy.items()
            }
        ),
        "By population, `dendrite`:",
        by_population(dendrite.budget),
        "Distance of potentials to the threshold next to the error of the chip's arithmetic, `dendrite`, in thresholds:",
        by_margin(dendrite.margins),
        *(
            f"- First difference of `{strategy}`: {why(*entry)}"
            for strategy, entry in results_of_strategy.items()
        ),
    ]
    tables, causes = parts[: -len(results_of_strategy)], parts[-len(results_of_strategy) :]
    return "\n\n".join([*tables, "\n".join(causes)])


def by_strategy(budgets: dict) -> str:
    """Return the table of stages alone, all together, all but one, and the cut of kernels, with a column for each strategy.

    A cell has the share of equal spikes and the number of changed predictions; a dash if the stage changes no number.
    """

    def cells(variants: dict[str, dict[str, Deviation]], key: str) -> list[str]:
        return [
            entry(variants[strategy][key]) if key in variants[strategy] else "-"
            for strategy in budgets
        ]

    alone = {strategy: budget.alone for strategy, budget in budgets.items()}
    without = {strategy: budget.without for strategy, budget in budgets.items()}
    rows = [[f"{stage_words(stage)} alone", *cells(alone, stage)] for stage in STAGES]
    rows.append(
        ["**all together: the chip**", *(entry(budget.together) for budget in budgets.values())]
    )
    rows += [
        [f"all but {stage_words(stage)}", *cells(without, stage)]
        for stage in ("kernel", "weights", "decays")
    ]
    rows.append(
        [
            "(kernels cut as by slayerPytorch)",
            *(entry(budget.kernel_tail) for budget in budgets.values()),
        ]
    )
    return table(["on the chip", *(f"`{strategy}`" for strategy in budgets)], rows)


def entry(found: Deviation) -> str:
    """Return the cell of a deviation."""
    return f"{share(found.spikes.agreement)}, {found.predictions_changed}"


def by_population(budget) -> str:
    """Return the share of equal spikes in each population, for each stage alone and all together."""
    variants = {stage_words(stage): found for stage, found in budget.alone.items()} | {
        "all together": budget.together
    }
    rows = [
        [name, *(share(found.by_population[name].agreement) for found in variants.values())]
        for name in budget.together.by_population
    ]
    return table(["population", *variants], rows)


def by_margin(margins) -> str:
    """Return how near potentials come to the threshold, next to the error of the chip's arithmetic."""
    head = ["population", "nearest 0.1 %", "nearest 1 %", "nearest 10 %", "median error", "95 % below", "closer than the error", "decided differently", "fullest register", "clips"]  # fmt: skip
    rows = []
    for name, margin in margins.populations.items():
        registers = [use for group, use in margins.registers.items() if group.split("/")[0] == name]
        rows.append(
            [
                name,
                *(short(margin.nearest[p]) for p in (0.001, 0.01, 0.1)),
                *(short(margin.error[p]) for p in (0.5, 0.95)),
                share(margin.within_error),
                share(margin.decided_otherwise),
                share(max(max(use.share_u, use.share_v) for use in registers)),
                count(sum(use.clips for use in registers)),
            ]
        )
    return table(head, rows)


def why(levels, match: Match, diagnosis) -> str:
    """Return the place and the cause of the first divergence, as the report words them."""
    grounds = Grounds(step_seconds=None, events_origin="given", assumptions=())
    report = report_figures(levels, match, grounds, Findings(diagnosis))
    first = match.first_divergence
    assert first is not None
    cause_text = cause(report.match)
    assert cause_text is not None
    place = f"{first.population}, neuron {first.neuron}, step {first.step} of recording {first.recording}"
    return f"{place}. {cause_text}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    write_by_network(__doc__, "error-budget", section)
