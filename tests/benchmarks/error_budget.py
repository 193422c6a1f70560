"""Take the error of the example networks apart on all test recordings, by every strategy, and write the tables.

    python tests/benchmarks/error_budget.py --data FOLDER --page docs/research/accuracy/where-the-error-comes-from.md

``FOLDER`` holds Ev-Objects.zip and Ev-Containers.zip. The networks are the float ones that ship, rounded for the train
recordings as the compiler rounds; nothing is trained or chosen here.
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
    found = {}
    for strategy in STRATEGIES:
        levels = lower_as(network, chip, Setting(strategy, WEIGHT_BITS), calibration)
        observed = Observed(levels, recordings.spikes, recordings.labels)
        match = compare(observed)
        start = time.perf_counter()
        diagnosis = diagnose(observed, match.first_divergence, samples=None)
        print(f"{dataset} {strategy}: {time.perf_counter() - start:.1f} s")
        assert diagnosis.budget is not None
        assert diagnosis.budget.unexplained == 0
        assert dict(diagnosis.budget.together.by_population) == match.by_population
        found[strategy] = (levels, match, diagnosis)
    _, _, first = found["dendrite"]
    parts = [
        f"## {dataset.title()}, {len(recordings)} test recordings",
        by_strategy({strategy: diagnosis.budget for strategy, (_, _, diagnosis) in found.items()}),
        "By population, `dendrite`:",
        by_population(first.budget),
        "Distance of potentials to the threshold next to the error of the chip's arithmetic, `dendrite`, in thresholds:",
        by_margin(first.margins),
        *(
            f"- First difference of `{strategy}`: {why(*entry)}"
            for strategy, entry in found.items()
        ),
    ]
    tables, causes = parts[: -len(found)], parts[-len(found) :]
    return "\n\n".join([*tables, "\n".join(causes)])


def by_strategy(budgets: dict) -> str:
    """Rows: stages alone, all together, the tail; for every strategy spikes equal, and predictions changed."""

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
    return f"{share(found.spikes.agreement)}, {found.predictions_changed}"


def by_population(budget) -> str:
    variants = {stage_words(stage): found for stage, found in budget.alone.items()} | {
        "all together": budget.together
    }
    rows = [
        [name, *(share(found.by_population[name].agreement) for found in variants.values())]
        for name in budget.together.by_population
    ]
    return table(["population", *variants], rows)


def by_margin(margins) -> str:
    head = ["population", "nearest 0.1 %", "nearest 1 %", "nearest 10 %", "median error", "95 % below", "closer than the error", "decided differently", "fullest register", "clips"]  # fmt: skip
    rows = []
    for name, one in margins.populations.items():
        registers = [use for group, use in margins.registers.items() if group.split("/")[0] == name]
        rows.append(
            [
                name,
                *(short(one.nearest[p]) for p in (0.001, 0.01, 0.1)),
                *(short(one.error[p]) for p in (0.5, 0.95)),
                share(one.within_error),
                share(one.decided_otherwise),
                share(max(max(use.share_u, use.share_v) for use in registers)),
                count(sum(use.clips for use in registers)),
            ]
        )
    return table(head, rows)


def why(levels, match: Match, diagnosis) -> str:
    """Return the place and the cause of the first divergence, as the report words them."""
    grounds = Grounds(None, "given", ())
    report = report_figures(levels, match, grounds, Findings(diagnosis))
    first = match.first_divergence
    assert first is not None
    said = cause(report.match)
    assert said is not None
    place = f"{first.population}, neuron {first.neuron}, step {first.step} of recording {first.recording}"
    return f"{place}. {said}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


if __name__ == "__main__":
    write_by_network(__doc__, "error-budget", section)
