"""The verdicts at the top of a report: questions, answers and facts for figures that are changed one by one.

Every test changes a few keys of the small report, and compares answers and sentences with words written out by hand.
"""

from __future__ import annotations

from typing import Any

import pytest

from locsnn_compile.report.compose import compose
from locsnn_compile.report.content import Bullets, Table
from locsnn_compile.report.sections.build import provenance
from locsnn_compile.report.sections.verdict import against, costs, fits, matches, notices, pace
from tests.support.small_report import costs_of, figures

POPULATIONS = ["time_output", "location_output"]
# Changes of the entry ``match`` of the report, which tests combine.
SILENT = {
    "prediction_agreement": None,
    "tied_predictions": 20,
    "readout": {"populations": POPULATIONS, "by": "spikes", "silent": True},
}
"""All class scores tie in all 20 recordings, because no output neuron spikes."""
LOUD = {"readout": {"populations": POPULATIONS, "by": "spikes", "silent": False}}
"""Some output neuron spikes."""
BY_POTENTIALS = {"readout": {"populations": POPULATIONS, "by": "potentials", "silent": True}}
"""Classes are read from potentials, which are all equal."""
READ = {"readout": {"populations": POPULATIONS, "by": "potentials", "silent": False}}
"""Classes are read from potentials, which differ."""
EQUAL = {"prediction_agreement": 1.0, "spike_mismatches": 0}
"""Every prediction and every spike is equal."""


@pytest.mark.parametrize(
    ("changes", "status", "answer"),
    [
        pytest.param(
            {"prediction_agreement": 1.0, "spike_mismatches": 0},
            "yes",
            "Yes, spike for spike",
            id="exact",
        ),
        pytest.param(
            {"prediction_agreement": 1.0}, "yes", "Yes, in every prediction", id="predictions"
        ),
        pytest.param({"prediction_agreement": 0.95}, "nearly", "Nearly", id="nearly"),
        pytest.param({"prediction_agreement": 0.9}, "no", "No", id="no"),
        pytest.param(
            {**SILENT, "spike_agreement": None, "spike_mismatches": 0},
            "unknown",
            "Not known",
            id="no-spike-at-all",
        ),
        pytest.param(
            {**SILENT, "spike_mismatches": 0}, "unknown", "Not known", id="silent-outputs"
        ),
        pytest.param(SILENT | LOUD, "unknown", "Not known", id="ties-and-other-spikes"),
        pytest.param(
            SILENT | LOUD | {"spike_mismatches": 0},
            "yes",
            "Yes, spike for spike",
            id="ties-and-equal-spikes",
        ),
        pytest.param(SILENT | BY_POTENTIALS, "unknown", "Not known", id="equal-potentials"),
        pytest.param(
            {"spike_agreement": None, "spike_mismatches": 0, "prediction_agreement": 1.0},
            "yes",
            "Yes, in every prediction",
            id="potentials-alone",
        ),
        pytest.param(
            {"spike_mismatches": 0, "prediction_agreement": 0.5},
            "no",
            "No",
            id="potentials-that-differ",
        ),
        pytest.param(
            EQUAL | READ | {"score_error": 0.05},
            "yes",
            "Yes, spike for spike",
            id="potentials-near-enough",
        ),
        pytest.param(
            EQUAL | READ | {"score_error": 0.0501},
            "nearly",
            "Nearly, in every prediction",
            id="potentials-apart",
        ),
        pytest.param(
            EQUAL | LOUD | {"score_error": 0.5},
            "yes",
            "Yes, spike for spike",
            id="spikes-tell-by-themselves",
        ),
    ],
)
def test_the_answer_on_the_match_is_what_the_check_proved(
    document: dict[str, Any], changes: dict[str, Any], status: str, answer: str
) -> None:
    document["match"] |= changes
    verdict = matches(figures(document))
    assert (verdict.status, verdict.answer) == (status, answer)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        pytest.param(
            {**SILENT, "spike_agreement": None},
            "No neuron spiked, in the float network or on the chip: nothing was compared.",
            id="no-spike-at-all",
        ),
        pytest.param(
            SILENT,
            "No output neuron spiked, in the float network or on the chip: no prediction was compared.",
            id="silent-outputs",
        ),
        pytest.param(
            SILENT | BY_POTENTIALS,
            "No class score is above another, in the float network or on the chip: no prediction was compared.",
            id="equal-potentials",
        ),
        pytest.param(
            SILENT | LOUD | {"spike_mismatches": 0},
            "Every class score ties, and every spike is equal.",
            id="ties",
        ),
        pytest.param(
            {"tied_predictions": 10, "prediction_agreement": 0.9},
            "The chip predicts the same class as the float network in 9 of 10 recordings; 10 more are not predicted, as "
            "all class scores tie on both sides.",
            id="some-ties",
        ),
    ],
)
def test_what_was_not_compared_is_said(
    document: dict[str, Any], changes: dict[str, Any], sentence: str
) -> None:
    document["match"] |= changes
    verdict = matches(figures(document))
    assert verdict.sentence == sentence
    assert "100 %" not in verdict.figure


def test_an_accuracy_at_chance_is_said_in_the_verdict(document: dict[str, Any]) -> None:
    document["match"] |= EQUAL
    document["chance"] = {
        "recordings": 100,
        "right": 10,
        "commonest_share": 0.15,
        "p_value": 0.94,
        "told_apart": False,
    }
    verdict = matches(figures(document))
    assert (verdict.status, verdict.answer) == (
        "nearly",
        "Yes, spike for spike, but it predicts no better than chance",
    )
    assert verdict.sentence == (
        "The chip predicts the same class as the float network in 20 of 20 recordings, and every spike is equal. "
        "The accuracy of 10.0 % on 100 recordings cannot be told from guessing the commonest label, which has 15.0 % of "
        "them: the recordings may be numbered, timed or labelled in another way than those of the training."
    )
    document["chance"] |= {"right": 90, "p_value": 0.0, "told_apart": True}
    verdict = matches(figures(document))
    assert (verdict.status, verdict.answer) == ("yes", "Yes, spike for spike")


def test_scores_that_are_apart_are_said(document: dict[str, Any]) -> None:
    document["match"] |= EQUAL | READ | {"score_error": 0.25}
    assert matches(figures(document)).sentence == (
        "The chip predicts the same class as the float network in 20 of 20 recordings, but class scores differ by "
        "25.0 % of their spread."
    )


@pytest.mark.parametrize(
    ("error", "comparison"),
    [
        (2e-13, "equal"),
        (0.0, "equal"),
        (2e-9, "differ by < 0.000001 % of their spread"),
        (None, "not compared"),
    ],
    ids=["float rounding", "nothing", "little", "unknown"],
)
def test_scores_that_differ_only_by_rounding_of_floats_are_equal(
    document: dict[str, Any], error: float | None, comparison: str
) -> None:
    document["match"] |= EQUAL | READ | {"score_error": error}
    facts = {fact.label: fact.value for fact in matches(figures(document)).facts}
    assert facts["class scores"] == comparison


def test_a_network_in_its_own_integers_is_as_trained(document: dict[str, Any]) -> None:
    document["match"]["reference"] = "integers"
    accuracy = matches(figures(document)).facts[0].value
    assert accuracy == "85.0 % on the chip, 90.0 % as trained (\N{MINUS SIGN}5.00 points)"


@pytest.mark.parametrize(
    ("cores", "status", "fullest"),
    [
        pytest.param(
            (2, 128), "yes", "synapse formats of a core, 3 of 16 (18.8 %)", id="room-left"
        ),
        pytest.param((128, 128), "yes", "cores, 128 of 128 (100 %)", id="full"),
        pytest.param((192, 128), "no", "cores, 192 of 128 (150.0 %)", id="over"),
        pytest.param(
            (0, 0), "yes", "synapse formats of a core, 3 of 16 (18.8 %)", id="limit-of-nothing"
        ),
        pytest.param(
            (1, 1), "yes", "synapse formats of a core, 3 of 16 (18.8 %)", id="what-it-can-do"
        ),
        pytest.param((1, 0), "no", "cores, 1 of 0 (100 %)", id="what-it-cannot-do"),
    ],
)
def test_a_program_fits_unless_it_exceeds_a_limit(
    document: dict[str, Any], cores: tuple[int, int], status: str, fullest: str
) -> None:
    used, limit = cores
    document["resources"]["limits"]["cores"] = {"used": used, "limit": limit}
    verdict = fits(figures(document))
    assert verdict.status == status
    assert verdict.facts[0].value == fullest


LIMITS_OF_OPEN_CORE = {
    "synapses": {"used": 12_942, "limit": 16_384},
    "join": {"used": 26, "limit": 28},
    "later": {"used": 2, "limit": 2},
    "groups": {"used": 1, "limit": 1},
}
"""Limits of an open core, of which a program fills only the first; ``join`` and ``later`` are widths."""


def test_the_fullest_limit_of_an_open_core_is_something_that_a_program_fills(
    document: dict[str, Any],
) -> None:
    document["resources"]["limits"] = LIMITS_OF_OPEN_CORE
    assert fits(figures(document)).facts[0].value == (
        "places for synapses, two in a word, 12,942 of 16,384 (79.0 %)"
    )


MEMORIES = {
    "synapse_pairs": {"used_words": 6_471, "words": 8_192, "word_bits": 48},
    "waiting_charges": {"used_words": 816, "words": 8_192, "word_bits": 18},
}


def test_an_open_core_names_its_fullest_memory_in_bits(document: dict[str, Any]) -> None:
    document["resources"] |= {"limits": LIMITS_OF_OPEN_CORE, "memories": MEMORIES}
    verdict = fits(figures(document))
    assert (verdict.status, verdict.figure) == ("yes", "79.0 %")
    assert verdict.figure_label == "of the fullest memory, synapses, two in a word"
    # 6,471 of 8,192 words of 48 bits, and 816 of 8,192 words of 18.
    assert [(fact.label, fact.value) for fact in verdict.facts] == [
        ("fullest memory", "synapses, two in a word, 310,608 of 393,216 bits (79.0 %)"),
        ("all memories", "325,296 of 540,672 bits (60.2 %)"),
        ("compartments", "12"),
        ("synapses", "80 in 320 B"),
    ]


def test_one_open_core_has_no_table_of_cores(document: dict[str, Any]) -> None:
    """A program in two phases has two cores, but the device holds one core, which runs both."""
    document["resources"] |= {"limits": LIMITS_OF_OPEN_CORE, "memories": MEMORIES}
    report = compose(figures(document))
    captions = {
        block.caption
        for section in report.sections
        for block in section.unfolded
        if isinstance(block, Table)
    }
    assert "Memories of the core in bits, the fullest first" in captions
    assert not {caption for caption in captions if " core" in caption and "by core" in caption}
    assert "Core by core" not in captions


def test_a_width_that_is_too_small_is_named(document: dict[str, Any]) -> None:
    document["resources"]["limits"] = LIMITS_OF_OPEN_CORE | {"join": {"used": 29, "limit": 28}}
    assert fits(figures(document)).facts[0].value == "bits of joined voltages, 29 of 28 (103.6 %)"


MODELLED = "Energy and latency are models: counts times published costs. No board was used."
MODELLED_ENERGY = (
    "Energy is a model: counts times the costs of the profile. Latency is an exact number of cycles, "
    "at the clock that the target's description states. No such chip was made."
)
OF_LOIHI = (
    "Joined compartments (dendrites) are an assumption about the chip: public sources name them, "
    "but none gives their integer timing.",
    "Where public sources on the chip are silent or disagree, the target's description decides.",
)


def test_joined_compartments_are_assumed_of_a_chip_but_not_of_an_open_core(
    document: dict[str, Any],
) -> None:
    assert provenance(figures(document)).blocks[-1] == Bullets(
        "Keep in mind", (MODELLED, *OF_LOIHI)
    )
    document["resources"]["limits"] = LIMITS_OF_OPEN_CORE
    assert provenance(figures(document)).blocks[-1] == Bullets("Keep in mind", (MODELLED_ENERGY,))


def test_latency_of_an_open_core_is_no_model(document: dict[str, Any]) -> None:
    document["resources"]["limits"] = LIMITS_OF_OPEN_CORE
    document["latency"] |= {"per_sample_ns": 1.5e6, "per_sample_cycles": 150_000, "clock_ghz": 0.1}
    document["latency"]["recording_ns"] = 3e9
    document["energy"] |= {"per_sample_pj": 9.11e6, "profile": "ihp-sg13g2"}
    report = figures(document)
    cost = costs(report, report.energy)
    assert cost.answer == "Cycles exact, energy modelled"
    assert cost.sentence == (
        "A recording takes 150,000 cycles on the open core, 1.50 ms at 100 MHz, and in the model "
        "9.11 µJ of dynamic energy (profile ihp-sg13g2)."
    )
    latency = next(fact for fact in cost.facts if fact.label == "latency")
    assert latency.value == "1.50 ms, 2,000 times faster than the 3.00 s recorded"


def test_notices_are_for_what_limits_the_figures(document: dict[str, Any]) -> None:
    assert notices(figures(document)) == ()
    document["match"]["wraps"] = 3
    document["skipped"]["events_dropped"] = 1
    assert [notice.title for notice in notices(figures(document))] == [
        "Registers wrapped.",
        "Events were dropped.",
    ]
    assert (
        notices(figures(document))[1].text
        == "1 event lay after the last step and never reached the chip."
    )


@pytest.mark.parametrize(
    ("latency_ns", "text"),
    [
        pytest.param(1e6, "5,000 times faster than the 5.00 s recorded", id="faster"),
        pytest.param(1e10, "2.00 times slower than the 5.00 s recorded", id="slower"),
        pytest.param(0.0, "no time at all", id="nothing"),
    ],
)
def test_the_pace_compares_a_latency_with_five_seconds_recorded(
    latency_ns: float, text: str
) -> None:
    assert pace(latency_ns, recording_ns=5e9) == text


@pytest.mark.parametrize(
    ("times", "text"),
    [
        pytest.param(12.67, "12.7 times fewer than CNN-3D", id="fewer"),
        pytest.param(0.5, "2.00 times more than CNN-3D", id="more"),
    ],
)
def test_operations_are_compared_with_those_of_a_conventional_network(
    times: float, text: str
) -> None:
    assert against("cnn-3d", times) == text


@pytest.mark.parametrize(
    ("changes", "paper", "chip"),
    [
        pytest.param(
            {},
            "10.0 times fewer than CNN-3D and 2.00 times more than GRU-MLP",
            "9.25 times fewer than CNN-3D and 2.16 times more than GRU-MLP",
            id="both",
        ),
        pytest.param(
            {"ratio": None},
            "nothing to compare: there were none",
            "9.25 times fewer than CNN-3D and 2.16 times more than GRU-MLP",
            id="nothing on paper, said once",
        ),
    ],
)
def test_operations_are_of_the_float_network_or_of_the_program(
    document: dict[str, Any], changes: dict[str, Any], paper: str, chip: str
) -> None:
    for entry in document["ann_comparison"].values():
        entry |= changes
    facts = {fact.label: fact.value for fact in costs_of(document).facts}
    assert facts["paper operations"] == f"{paper} (the trained network, by the published method)"
    assert facts["chip operations"] == f"{chip} (synaptic operations of the program)"


def test_the_energy_is_called_dynamic(document: dict[str, Any]) -> None:
    verdict = costs_of(document)
    assert (
        verdict.sentence
        == "In the model, a recording takes 100 nJ of dynamic energy (profile davies2018) and 1.40 ms."
    )
    assert verdict.figure_label == "dynamic energy per recording, profile davies2018"


def test_no_time_is_claimed_where_no_operation_has_one(document: dict[str, Any]) -> None:
    document["latency"]["timed"] = False
    verdict = costs_of(document)
    assert verdict.sentence == (
        "In the model, a recording takes 100 nJ of dynamic energy (profile davies2018) and an unknown time."
    )
    fact = next(fact.value for fact in verdict.facts if fact.label == "latency")
    assert fact == "not known, as no operation has a time (profile davies2018)"
    sections = {section.key: section for section in compose(figures(document)).sections}
    latency = sections["latency"]
    assert latency.lead == (
        "Not known, as profile davies2018 has no times of operations: only barriers and the buffer are timed."
    )
    (links,) = latency.blocks
    assert isinstance(links, Table)
    assert links.caption == "Packets on the links of the mesh, mean per recording"
    assert "Time of a step" not in str(sections["over-time"])


@pytest.mark.parametrize(
    ("reference", "chip", "sentence"),
    [
        pytest.param(
            10.5,
            9.5,
            "The float potential 10.5 reaches the threshold 10 and fires; the chip's 9.5",
            id="float",
        ),
        pytest.param(
            9.5,
            10.0,
            "The chip's potential 10 reaches the threshold 10 and fires; the float",
            id="chip",
        ),
        pytest.param(
            9.5,
            9.75,
            "The potential is 9.5 in the float network and 9.75 on the chip",
            id="neither",
        ),
    ],
)
def test_first_divergence_says_which_side_fired(
    document: dict[str, Any], reference: float, chip: float, sentence: str
) -> None:
    document["match"]["first_divergence"] |= {
        "reference_potential": reference,
        "chip_potential": chip,
    }
    first = next(
        section for section in compose(figures(document)).sections if section.key == "agreement"
    ).blocks[0]
    assert isinstance(first, str)
    assert sentence in first


@pytest.mark.parametrize("strategy", ["dendrite", "delay-line", "reset", "another"])
def test_the_assumption_is_named_where_it_is_made(document: dict[str, Any], strategy: str) -> None:
    """Only strategy ``reset`` has no joined compartments, whose timing is an assumption."""
    document["strategy"] = strategy
    provenance_section = str(compose(figures(document)).sections[-1])
    is_named = "are an assumption about the chip" in provenance_section
    assert is_named == (strategy != "reset")


def test_nothing_at_all_still_makes_a_report(document: dict[str, Any]) -> None:
    """Where every cost is 0, nothing is divided by 0."""
    energy = document["energy"]
    energy |= {"per_sample_pj": 0.0, "breakdown_pj": dict.fromkeys(energy["breakdown_pj"], 0.0)}
    nothing = dict.fromkeys(("min", "p50", "p99", "max"), 0.0)
    energy |= {
        "by_branch_pj": {"time": 0.0},
        "over_samples_pj": nothing,
        "by_core_pj": [],
        "by_population_pj": {},
    }
    energy |= {
        "other_profiles_pj": {"sanafe": 0.0},
        "other_profiles_by_branch_pj": {"sanafe": {"time": 0.0}},
    }
    document["latency"] |= {
        "per_sample_ns": 0.0,
        "over_samples_ns": nothing,
        "by_core": [],
        "critical_paths": [],
    }
    for entry, unit in ((energy, "pj"), (document["latency"], "ns")):
        costs_of_class = {f"min_{unit}": 0.0, f"mean_{unit}": 0.0, f"max_{unit}": 0.0}
        entry["by_class"] = [{"class": 0, "recordings": 1, **costs_of_class}]
    document["operations"]["published_method"] |= {"operations": 0.0}
    document["operations"]["per_sample"]["neuron_updates"] = 0.0
    document["operations"]["per_sample"]["synaptic_ops"] = 0.0
    document["ann_comparison"]["cnn-3d"] |= {"ratio": None, "chip_ratio": None}
    document["ann_comparison"]["cnn-3d"] |= {
        "energy_ratio": {"fp32": None},
        "energy_pj": {"fp32": 1.0},
    }
    del document["ann_comparison"]["gru-mlp"]
    document["resources"]["by_core"] = []
    document["quantization"] = {}
    report = str(compose(figures(document)))
    assert (
        "nothing to compare: there were none (the trained network, by the published method)"
        in report
    )
    assert "nothing to compare: there were none (synaptic operations of the program)" in report
    assert "No core is in use." in report


def test_every_row_has_every_column(document: dict[str, Any]) -> None:
    tables = [
        block
        for section in compose(figures(document)).sections
        for block in section.unfolded
        if isinstance(block, Table)
    ]
    # So that the loop below cannot pass for want of tables.
    assert len(tables) == 35
    assert all(len(row) == len(table.columns) for table in tables for row in table.rows)


def test_a_network_of_integers_is_called_so(document: dict[str, Any]) -> None:
    document["match"]["reference"] = "integers"
    sentence = matches(figures(document)).sentence
    assert sentence.startswith(
        "The chip predicts the same class as the network in its own integers in "
    )
