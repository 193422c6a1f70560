"""Checks of a graph of compartments: every parameter with a range at both ends and one beyond, impossible joins, synapses
and visits, and phases that cannot begin at the first touch.

A phase with ``align_events`` begins at the first touch: the first step with that many events, over all inputs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import pytest

import hw_model as hw
from hw_model.arithmetic import loihi
from hw_model.mapping import check_graph as checks
from hw_model.mapping.check_graph import check_graph
from hw_model.mapping.graph import CompartmentGraph, Input, Phase

CHIP = hw.chip("loihi-sim")
DECAY = "Give an effective decay, what is subtracted from 4096."
SCALE = "Raise the bias exponent or scale the bias down."


class Range(NamedTuple):
    """The lowest and the highest value of a parameter, and the way out in the message beyond them."""

    low: int
    high: int
    fix: str


RANGES = {
    "decay_u": Range(low=0, high=4096, fix=DECAY),
    "decay_v": Range(low=0, high=4096, fix=DECAY),
    "threshold": Range(
        low=0, high=131071, fix="Give a 64th of the threshold, or scale the weights down."
    ),
    "bias_mantissa": Range(low=-4096, high=4095, fix=SCALE),
    "bias_exponent": Range(low=0, high=7, fix="Use a smaller exponent and a larger mantissa."),
    "refractory": Range(low=1, high=63, fix="Shorten the refractory period; 1 blocks no step."),
}
SOMA = 0
DENDRITE = 1


def graph(group: int = SOMA, **changes: object) -> CompartmentGraph:
    """Return two somas and two dendrites, joined to them and driven by input ``x``, with ``changes`` in one group."""
    builder = hw.ProgramBuilder(CHIP)
    x = builder.add_input("x", 2)
    soma = builder.add_compartments("soma", 2, threshold=5)
    dendrite = builder.add_compartments("dendrite", 2, threshold=5, joined_to=soma)
    builder.connect(x, dendrite, [[20, 0], [0, 20]])
    unchanged = builder.graph()
    groups = list(unchanged.groups)
    groups[group] = replace(groups[group], **changes)
    return replace(unchanged, groups=tuple(groups))


def test_the_table_has_every_parameter_of_a_compartment_that_has_a_range():
    # The only other range is that of the delay of a synapse.
    assert {*RANGES, "delay"} == loihi.domains(CHIP.registers).keys()


@pytest.mark.parametrize("name", RANGES)
def test_a_parameter_has_its_own_range(name):
    low, high, fix = RANGES[name]
    # Compartment 1 has the value, so that the message must find the place as well.
    for value in (low, high):
        check_graph(graph(**{name: [low, value]}), CHIP)
    for value in (low - 1, high + 1):
        with pytest.raises(hw.TargetError) as error:
            check_graph(graph(**{name: [low, value]}), CHIP)
        expected = f"compartments 'soma': {name} of compartment 1 is out of range ({value} against {low}..{high}). {fix}"
        assert str(error.value) == expected


@pytest.mark.parametrize(
    "changes",
    [{"joined_to": "nobody"}, {"joined_to": "dendrite"}, {"phase": "later"}],
    ids=["nobody", "itself", "a group of another phase"],
)
def test_a_group_cannot_join_itself_or_a_group_of_another_phase(changes):
    impossible = graph(DENDRITE, **changes)
    # The phase "later" exists, so that nothing but the join is wrong.
    phases = (*impossible.phases, replace(impossible.phases[0], name="later"))
    impossible = replace(impossible, phases=phases)
    with pytest.raises(hw.InputError) as error:
        check_graph(impossible, CHIP)
    to = changes.get("joined_to", "soma")
    expected = f"compartments 'dendrite': cannot be joined to '{to}'. Join to another group of the same size and phase."
    assert str(error.value) == expected


TURNED = Input(name="turned", size=2, phase="time", stream="x", positions=[0, 1])
"""An input of the same phase that comes through the transpose buffer, which exchanges steps and channels: two lines,
which are time steps, hear channel 0 in step 0 and channel 1 in step 1."""


def phase_of(axis: str, *, steps: int | None, align_events: int | None) -> Phase:
    """Return the phase of the graph's compartments and inputs, which is named "time" whatever its axis."""
    return Phase(name="time", axis=axis, steps=steps, align_events=align_events)


@pytest.mark.parametrize(
    ("phase", "inputs", "measured"),
    [
        pytest.param(
            phase_of("time", steps=None, align_events=0),
            (),
            "align_events 0, axis 'time'",
            id="no event",
        ),
        pytest.param(
            phase_of("time", steps=None, align_events=-1),
            (),
            "align_events -1, axis 'time'",
            id="below 0",
        ),
        pytest.param(
            phase_of("time", steps=2, align_events=1),
            (TURNED,),
            "align_events 1, axis 'time'",
            id="mixed over time",
        ),
        pytest.param(
            phase_of("location", steps=2, align_events=1),
            (TURNED,),
            "align_events 1, axis 'location'",
            id="mixed over locations",
        ),
        pytest.param(
            phase_of("location", steps=2, align_events=1),
            (),
            "align_events 1, axis 'location'",
            id="another axis",
        ),
    ],
)
def test_a_phase_that_cannot_begin_at_a_touch_is_refused(phase, inputs, measured):
    unaligned = graph()
    unaligned = replace(
        unaligned,
        inputs=(*unaligned.inputs, *inputs),
        phases=(replace(phase, align_events=None),),
    )
    # Nothing but the alignment is wrong.
    check_graph(unaligned, CHIP)
    aligned = replace(unaligned, phases=(phase,))
    with pytest.raises(hw.InputError) as error:
        check_graph(aligned, CHIP)
    assert str(error.value) == (
        f"phase 'time': it cannot be aligned ({measured}). Align to 1 event or more, with inputs of this axis alone."
    )


def test_a_phase_of_one_axis_can_begin_at_a_touch():
    phase = phase_of("time", steps=None, align_events=1)
    check_graph(replace(graph(), phases=(phase,)), CHIP)


def with_synapses(**changes: object) -> CompartmentGraph:
    """Return the two groups, with ``changes`` in the two synapses from the input onto the dendrites."""
    unchanged = graph()
    return replace(unchanged, synapses=(replace(unchanged.synapses[0], **changes),))


def test_synapses_from_what_does_not_exist_are_refused():
    with pytest.raises(hw.InputError) as error:
        check_graph(with_synapses(source="nobody"), CHIP)
    expected = (
        "synapses 'nobody' -> 'dendrite': it joins something that does not exist. "
        "Add it before connecting."
    )
    assert str(error.value) == expected


def test_synapses_to_what_does_not_exist_are_refused():
    with pytest.raises(hw.InputError) as error:
        check_graph(with_synapses(target="nobody"), CHIP)
    expected = (
        "synapses 'x' -> 'nobody': it joins something that does not exist. "
        "Add it before connecting."
    )
    assert str(error.value) == expected


@pytest.mark.parametrize(
    ("delay", "measured", "fix"),
    [
        (-1, "-1 against 0..0 steps; 1 of 2 delays outside", "Give 0 or more."),
        (
            1,
            "1 against 0..0 steps; 1 of 2 delays outside",
            "Relay the spike through 1 compartment, or shorten the delay.",
        ),
    ],
    ids=["below 0", "one step"],
)
def test_a_delay_that_a_chip_without_delays_lacks_is_refused(delay, measured, fix):
    chip = replace(CHIP, registers=replace(CHIP.registers, delay_max=0))
    with pytest.raises(hw.TargetError) as error:
        check_graph(with_synapses(delay=[delay, 0]), chip)
    assert str(error.value) == (
        f"synapses 'x' -> 'dendrite': a delay is out of range ({measured}). {fix}"
    )


def test_the_longest_delay_of_a_phase_decides_how_many_charges_are_in_flight(monkeypatch):
    """Four compartments and a delay of 3 steps keep 4 times 5 charges; other synapses without delay do not matter."""
    delayed = with_synapses(delay=[3, 0])
    with_others = replace(delayed, synapses=(*delayed.synapses, *graph().synapses))
    monkeypatch.setattr(checks, "MOST_CHARGES", 20)
    check_graph(with_others, CHIP)
    monkeypatch.setattr(checks, "MOST_CHARGES", 19)
    with pytest.raises(hw.TargetError) as error:
        check_graph(with_others, CHIP)
    assert str(error.value) == (
        "phase 'time': its longest delay keeps more charges in flight than the simulator allows "
        "(5 steps of 4 compartments against 19). Shorten the delay, or relay the spike through compartments."
    )


def with_visits(steps: int | None, **changes: object) -> CompartmentGraph:
    """Return the two groups with an input through the transpose buffer, in a phase of ``steps`` steps."""
    unchanged = graph()
    return replace(
        unchanged,
        phases=(phase_of("location", steps=steps, align_events=None),),
        inputs=(*unchanged.inputs, replace(TURNED, **changes)),
    )


def test_a_visit_after_the_end_of_its_phase_is_refused():
    # The second channel is visited in step 1, so a phase needs two steps.
    check_graph(with_visits(2), CHIP)
    check_graph(with_visits(None), CHIP)
    with pytest.raises(hw.InputError) as error:
        check_graph(with_visits(1), CHIP)
    assert str(error.value) == (
        "input 'turned': a channel is visited outside its phase (step 1 of 1, counted from 0). "
        "Give the phase more steps."
    )


@pytest.mark.parametrize(
    ("first_lines", "measured"),
    [
        ([0], "1 within 0..0 against 2 within 0..1"),
        ([0, -1], "2 within -1..0 against 2 within 0..1"),
        ([0, 2], "2 within 0..2 against 2 within 0..1"),
    ],
    ids=["one too few", "below 0", "after the last line"],
)
def test_first_lines_that_do_not_fit_are_refused(first_lines, measured):
    check_graph(with_visits(2, first_lines=[0, 1]), CHIP)
    with pytest.raises(hw.InputError) as error:
        check_graph(with_visits(2, first_lines=first_lines), CHIP)
    assert str(error.value) == (
        f"input 'turned': its first lines do not fit ({measured}). Give one per channel."
    )


@pytest.mark.parametrize(
    ("first_lines", "shared"),
    [([0, 2, 4], False), ([0, 1, 4], True), ([4, 0, 3], True)],
    ids=["apart", "the first two", "the last and the first"],
)
def test_two_channels_of_three_that_share_lines_are_enough(first_lines, shared):
    """Of 6 lines, each channel takes 2 if the last one begins at line 4."""
    together = with_visits(1, size=6, positions=[0, 0, 0], first_lines=first_lines)
    if not shared:
        check_graph(together, CHIP)
        return
    with pytest.raises(hw.InputError) as error:
        check_graph(together, CHIP)
    assert str(error.value) == (
        "input 'turned': two channels of one step share lines. Give each lines of its own."
    )
