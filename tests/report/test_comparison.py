"""``locsnn diff``: what changed between two builds, the answers to its three questions, and what cannot be compared.

The builds are two copies of the small report with known differences, and answers are written out by hand. Reports may
come from files that anybody wrote, so values of any type and size are tried as well.
"""

from __future__ import annotations

import copy
from typing import Any

import pytest

import hw_model as hw
from locsnn_compile.errors import InputError
from locsnn_compile.report.content import Notice, Table
from locsnn_compile.report.figures.entries import plain
from locsnn_compile.report.figures.flat import flatten
from locsnn_compile.report.figures.program import program_figures
from locsnn_compile.report.renderers.html import render_html
from locsnn_compile.report.sections.builds import Build, changes, percent
from locsnn_compile.report.sections.comparison import MAX_ROWS, comparison


@pytest.fixture
def builds(document: dict[str, Any]) -> tuple[Build, Build]:
    """The second build takes a quarter less energy and a core more, and one more of its spikes differs."""
    second = copy.deepcopy(document)
    second["energy"]["per_sample_pj"] = 75_000.0
    second["resources"]["cores"] = 3
    second["match"] |= {"spike_mismatches": 21, "spike_agreement": 0.895}
    program = {"cores": 2, "groups": {"time_output": {"synapses": 40}}}
    return Build("one", document, program), Build("two", second, {**program, "cores": 3})


def test_every_figure_that_changed_is_found(builds: tuple[Build, Build]) -> None:
    assert changes(*builds) == {
        "match.spike_agreement": (0.9, 0.895),
        "match.spike_mismatches": (20, 21),
        "energy.per_sample_pj": (100_000.0, 75_000.0),
        "resources.cores": (2, 3),
        "program.cores": (2, 3),
    }
    assert changes(builds[0], builds[0]) == {}


def test_histograms_are_left_to_the_reports(builds: tuple[Build, Build]) -> None:
    builds[1].report["margins"]["by_population"]["time_output"]["distance_histogram"] = [1]
    assert not [key for key in changes(*builds) if "margins" in key]


def test_three_questions_are_answered_before_the_figures(builds: tuple[Build, Build]) -> None:
    report = comparison(*builds)
    assert (report.title, report.notices) == ("one → two", ())
    assert (
        report.subtitle
        == "two-branches on loihi-sim, then two-branches on loihi-sim: 5 figures changed"
    )
    answers = [
        (verdict.status, verdict.answer, verdict.figure, verdict.figure_label)
        for verdict in report.verdicts
    ]
    assert answers == [
        (
            "nearly",
            "As before, but fewer spikes are equal",
            "95.0 %",
            "same prediction; 95.0 % before",
        ),
        (
            "yes",
            "Yes, 25.0 % less",
            "75.0 nJ",
            "dynamic energy per recording, profile davies2018; 100 nJ before",
        ),
        ("no", "No, more cores", "3 cores", "2 before"),
    ]
    assert [section.title for section in report.sections] == [
        "Key figures",
        "Match",
        "Energy",
        "Resources",
        "Program",
    ]
    (energy,) = (block for block in report.sections[2].blocks if isinstance(block, Table))
    assert energy.rows == (("per_sample_pj", "100,000.0", "75,000.0", "-25.0 %"),)


@pytest.mark.parametrize(
    ("scores", "spikes", "status", "answer", "fact"),
    [
        ((0.002, 0.433), (None, None), "nearly", "As before, but class scores differ more", "43.3 % of their spread off; 0.20 % of their spread off before"),
        ((0.433, 0.002), (None, None), "yes", "As before", "0.20 % of their spread off; 43.3 % of their spread off before"),
        ((0.002, 0.002), (0.9, 0.9), "yes", "As before", "0.20 % of their spread off"),
        ((0.0, 0.1), (0.9, 0.8), "nearly", "As before, but fewer spikes are equal and class scores differ more", "10.0 % of their spread off; 0 % of their spread off before"),
        ((None, 0.1), (0.9, 0.9), "yes", "As before", "10.0 % of their spread off; not compared before"),
    ],
    ids=["potentials off", "better", "equal", "both", "not compared before"],
)  # fmt: skip
def test_the_answer_on_the_match_counts_class_scores(
    builds: tuple[Build, Build], scores: Any, spikes: Any, status: str, answer: str, fact: str
) -> None:
    for build, error, agreement in zip(builds, scores, spikes, strict=True):
        build.report["match"] |= {"score_error": error, "spike_agreement": agreement}
    match = comparison(*builds).verdicts[0]
    assert (match.status, match.answer) == (status, answer)
    facts = {fact.label: fact.value for fact in match.facts}
    assert facts["class scores"] == fact


def test_predictions_that_were_not_compared_are_not_called_different(
    builds: tuple[Build, Build],
) -> None:
    builds[0].report["match"]["prediction_agreement"] = None
    match = comparison(*builds).verdicts[0]
    assert match.answer == "Not known"
    assert match.sentence == (
        "The chip predicts the same class as the network in 95.0 % of recordings, an unknown share before."
    )


def test_a_report_of_a_version_without_scores_is_compared(builds: tuple[Build, Build]) -> None:
    del builds[0].report["match"]["score_error"]
    assert comparison(*builds).verdicts[0].answer == "As before, but fewer spikes are equal"


def test_equal_builds_are_as_before(builds: tuple[Build, Build]) -> None:
    report = comparison(builds[0], builds[0])
    assert [verdict.answer for verdict in report.verdicts] == ["As before", "The same", "The same"]
    assert [verdict.status for verdict in report.verdicts] == ["yes"] * 3


@pytest.mark.parametrize(
    ("before", "after", "answer"),
    [
        (100, 41, ("yes", "Yes, 59.0 % less")),
        (100, 112, ("no", "No, 12.0 % more")),
        (0, 5, ("no", "No, more")),
        (5, 5, ("yes", "The same")),
    ],
    ids=["less", "more", "from nothing", "equal"],
)
def test_the_answer_on_costs(
    builds: tuple[Build, Build], before: float, after: float, answer: tuple[str, str]
) -> None:
    for build, energy in zip(builds, (before, after), strict=True):
        build.report["energy"]["per_sample_pj"] = energy
    cost = comparison(*builds).verdicts[1]
    assert (cost.status, cost.answer) == answer


def test_other_models_recordings_and_profiles_are_noticed(builds: tuple[Build, Build]) -> None:
    builds[1].report["model"]["sha256"] = "cd" * 32
    builds[1].report["match"]["events_source"] = "others.npz"
    builds[1].report["energy"]["profile"] = "sanafe"
    report = comparison(*builds)
    assert report.notices == (
        Notice(
            "The models differ.", "What changed may come from the model, not from the compiler."
        ),
        Notice(
            "They were checked on different recordings.",
            "20 recordings of touches.npz and 20 recordings of others.npz: figures per recording cannot be compared.",
        ),
        Notice("Their energy profiles differ.", "Their energies and times cannot be compared."),
    )
    assert (report.verdicts[1].status, report.verdicts[1].answer) == ("unknown", "Not comparable")


def test_a_time_that_a_build_does_not_know_is_not_compared(builds: tuple[Build, Build]) -> None:
    assert "latency" in str(comparison(*builds).verdicts[1])
    # The figures of a build are cached.
    builds[1].__dict__.pop("figures", None)
    builds[1].report["latency"]["timed"] = False
    report = comparison(*builds)
    assert "latency" not in str(report.verdicts[1])
    assert "time per recording" not in str(report.sections[0])


def test_committees_with_other_weights_are_other_models(builds: tuple[Build, Build]) -> None:
    for build, weight in zip(builds, (1.0, 5.0), strict=True):
        build.report["model"]["members"] = [
            {"name": "a", "weight": 1.0},
            {"name": "b", "weight": weight},
        ]
    assert "The models differ." in [notice.title for notice in comparison(*builds).notices]


NOT_KNOWN = Notice(
    "Whether the models are equal is not known.",
    "A network that was made in Python has no file to tell by. What changed may come from the model.",
)
CHIPS = Notice(
    "The chips differ.", "What changed may come from what their cores and registers hold."
)
PROFILES = Notice("Their energy profiles differ.", "Their energies and times cannot be compared.")
RECORDINGS = Notice(
    "They were checked on different recordings.",
    "20 recordings of touches.npz and 20 recordings of touches.npz: figures per recording cannot be compared.",
)


@pytest.mark.parametrize(
    ("change", "notice", "answer"),
    [
        ({"model": {"sha256": ""}}, NOT_KNOWN, "Yes, 25.0 % less"),
        ({"target": "mine"}, CHIPS, "Yes, 25.0 % less"),
        ({"resources": {"limits": {"compartments": {"limit": 7}}}}, CHIPS, "Yes, 25.0 % less"),
        ({"energy": {"profiles": {"davies2018": {"voltage_v": 0.5}}}}, PROFILES, "Not comparable"),
        (
            {"operations": {"by_branch": {"time": {"input_events": 9.0}}}},
            RECORDINGS,
            "Not comparable",
        ),
    ],
    ids=[
        "made in Python",
        "another target",
        "another core",
        "another profile of one name",
        "another array",
    ],
)
def test_things_of_the_same_name_may_differ(
    builds: tuple[Build, Build], change: dict[str, Any], notice: Notice, answer: str
) -> None:
    """Both builds get the figures that are compared in addition to names; then one of them changes."""

    def merge(document: dict[str, Any], changes: dict[str, Any]) -> None:
        for key, value in changes.items():
            if isinstance(value, dict):
                merge(document.setdefault(key, {}), value)
            else:
                document[key] = value

    common = {
        "energy": {"profiles": {"davies2018": {"voltage_v": 0.75}}},
        "resources": {"limits": {"compartments": {"used": 5, "limit": 8}}},
        "operations": {"by_branch": {"time": {"input_events": 8.0}}},
    }
    for build in builds:
        merge(build.report, common)
    # How much of a limit is used does not make another chip.
    builds[1].report["resources"]["limits"]["compartments"]["used"] = 3
    merge(builds[1].report, change)
    # New builds, because figures are cached.
    before, after = (Build(build.name, build.report, build.program) for build in builds)
    report = comparison(before, after)
    assert report.notices == (notice,)
    assert report.verdicts[1].answer == answer


@pytest.mark.parametrize(
    "change", [{"events_source": "others.npz"}, {"samples": 3}], ids=["others", "fewer"]
)
def test_costs_of_different_recordings_are_not_comparable(
    builds: tuple[Build, Build], change: dict[str, Any]
) -> None:
    builds[1].report["match"] |= change
    cost = comparison(*builds).verdicts[1]
    assert (cost.status, cost.answer) == ("unknown", "Not comparable")


@pytest.mark.parametrize("value", [None, "much", True, float("nan"), 10**400, [1]])
def test_a_report_without_a_number_is_refused(builds: tuple[Build, Build], value: Any) -> None:
    builds[1].report["energy"]["per_sample_pj"] = value
    with pytest.raises(InputError) as caught:
        comparison(*builds)
    assert str(caught.value) == (
        "build 'two': report.json has no number 'energy.per_sample_pj'. Compile it again with this version."
    )


def test_the_page_is_small_whatever_changed(builds: tuple[Build, Build]) -> None:
    builds[1].report["<script>"] = {f"<b>{i}</b>": "x" * 10_000 for i in range(5000)}
    page = render_html(comparison(*builds))
    assert len(page) < 200_000
    assert "<script" not in page
    assert f"5,000 figures changed, the first {MAX_ROWS}; --json has all" in page


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        pytest.param(4, 5, "+25.0 %", id="a quarter more"),
        pytest.param(0, 5, "", id="from nothing"),
        pytest.param("a", 1, "", id="a text"),
        pytest.param(True, 2, "", id="a truth value"),
        pytest.param(10**400, 1, "", id="too large for a float"),
        pytest.param(float("inf"), 1, "", id="infinite"),
    ],
)
def test_a_change_in_percent_is_of_two_usual_numbers(before: Any, after: Any, text: str) -> None:
    assert percent(before, after) == text


def test_figures_of_a_program_are_those_counted_by_hand() -> None:
    """Two compartments and three synapses; a weight counts 64 times its mantissa."""
    builder = hw.ProgramBuilder(hw.chip("loihi-sim"), name="tiny")
    line = builder.add_input("line", 2)
    cell = builder.add_compartments(
        "cell", 2, decay_u=[4096, 2048], decay_v=128, threshold=15, bias=64, refractory=2
    )
    builder.connect(line, cell, [[20, -2], [0, 4]], delay=3)
    figures = plain(program_figures(builder.build()))
    assert figures.pop("registers")["voltage_bits"] == 23
    assert {"readout", "cores.mantissa", "inputs.line", "chip"} < figures.pop("contents").keys()
    assert figures == {
        "cores": 1,
        "groups": {
            "cell": {
                "compartments": 2,
                "synapses": 3,
                "weights_sum": 64 * 22,
                "weights_magnitude": 64 * 26,
                "least_decay_u": 2048,
                "least_decay_v": 128,
                "least_refractory": 2,
                "least_threshold_voltage": 960,
                "least_bias": 64,
                "least_synaptic_delay": 3,
                "least_weight": -128,
                "largest_decay_u": 4096,
                "largest_decay_v": 128,
                "largest_refractory": 2,
                "largest_threshold_voltage": 960,
                "largest_bias": 64,
                "largest_synaptic_delay": 3,
                "largest_weight": 1280,
            }
        },
    }


def test_flatten_keeps_the_order_at_any_depth() -> None:
    assert list(flatten({"b": [1, {"a": 2}], "a": {}, "c": None}).items()) == [
        ("b.0", 1),
        ("b.1.a", 2),
        ("c", None),
    ]
    # Deeper than Python can call functions.
    deep: Any = 1
    for _ in range(5000):
        deep = [deep]
    assert list(flatten(deep).values()) == [1]
