"""Checks of a graph of compartments: every parameter at the ends of its range and one beyond, impossible joins, and
phases that cannot begin at the first touch."""

from __future__ import annotations

from dataclasses import replace

import pytest

import hw_model as hw
from hw_model.mapping.check_graph import check_graph
from hw_model.mapping.graph import CompartmentGraph, Input, Phase

CHIP = hw.chip("loihi-sim")


DECAY = "Give an effective decay, what is subtracted from 4096."
SCALE = "Raise the bias exponent or scale the bias down."
# Lowest value, highest value, and the way out in the message.
RANGES = {
    "decay_u": (0, 4096, DECAY),
    "decay_v": (0, 4096, DECAY),
    "threshold": (0, 131071, "Give a 64th of the threshold, or scale the weights down."),
    "bias_mantissa": (-4096, 4095, SCALE),
    "bias_exponent": (0, 7, "Use a smaller exponent and a larger mantissa."),
    "refractory": (1, 63, "Shorten the refractory period; 1 blocks no step."),
}


def graph(group: int = 0, **changes: object) -> CompartmentGraph:
    """Return two groups of two compartments, the second joined to the first, with ``changes`` in one group."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 2)
    soma = b.add_compartments("soma", 2, threshold=5)
    b.connect(x, b.add_compartments("dendrite", 2, threshold=5, joined_to=soma), [[20, 0], [0, 20]])
    unchanged = b.graph()
    groups = list(unchanged.groups)
    groups[group] = replace(groups[group], **changes)
    return replace(unchanged, groups=tuple(groups))


@pytest.mark.parametrize("name", RANGES)
def test_a_parameter_has_its_own_range(name):
    low, high, fix = RANGES[name]
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
    made = graph(1, **changes)
    made = replace(made, synapses=(), phases=(*made.phases, replace(made.phases[0], name="later")))
    with pytest.raises(hw.InputError) as error:
        check_graph(made, CHIP)
    to = changes.get("joined_to", "soma")
    expected = f"compartments 'dendrite': cannot be joined to '{to}'. Join to another group of the same size and phase."
    assert str(error.value) == expected


TURNED = Input("turned", 2, "time", "x", positions=[0, 1])
"""An input through the transpose buffer, which makes a phase over time a mixed one."""


@pytest.mark.parametrize(
    ("phase", "inputs", "measured"),
    [
        (Phase("time", "time", None, 0), (), "align_events 0, axis 'time'"),
        (Phase("time", "time", None, -1), (), "align_events -1, axis 'time'"),
        (Phase("time", "time", 2, 1), (TURNED,), "align_events 1, axis 'time'"),
        (Phase("time", "location", 2, 1), (TURNED,), "align_events 1, axis 'location'"),
        (Phase("time", "location", 2, 1), (), "align_events 1, axis 'location'"),
    ],
    ids=["no event", "below 0", "mixed over time", "mixed over locations", "another axis"],
)
def test_a_phase_that_cannot_begin_at_a_touch_is_refused(phase, inputs, measured):
    made = graph()
    made = replace(made, inputs=(*made.inputs, *inputs))
    check_graph(replace(made, phases=(replace(phase, align_events=None),)), CHIP)
    with pytest.raises(hw.InputError) as error:
        check_graph(replace(made, phases=(phase,)), CHIP)
    assert str(error.value) == (
        f"phase 'time': it cannot be aligned ({measured}). Align to 1 event or more, with inputs of this axis alone."
    )


def test_a_phase_of_one_axis_can_begin_at_a_touch():
    check_graph(replace(graph(), phases=(Phase("time", "time", None, 1),)), CHIP)
