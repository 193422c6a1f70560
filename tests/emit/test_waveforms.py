"""``--emit vcd``: waveforms are read back with pyvcd and equal the simulator's registers; and what probes select."""

from __future__ import annotations

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.backends.played import play_recording
from locsnn_compile.backends.waves import probed, vcd_file
from locsnn_compile.errors import InputError
from tests.support.emitted_programs import CHIP, everything, played_streams, two_phases
from tests.support.vcd_values import read_vcd, values_by_step


def test_every_value_is_that_of_the_simulator():
    steps = 40
    program = everything()
    played = play_recording(program, played_streams(program))
    paths, end = read_vcd(vcd_file(played, ["h", "o[1:3]"])["waves.vcd"])
    assert end == steps
    result = played.result
    # The dendrites of neurons come with them.
    probed_neurons = {"h": range(7), "o": (1, 2), "o/dendrite": (1, 2)}
    for group, numbers in probed_neurons.items():
        for i in numbers:
            scope = f"time.{group.replace('/', '_')}.n{i}"
            for kind in ("u", "v", "potential"):
                simulated = getattr(result, kind)[group][:, i].tolist()
                assert values_by_step(paths[f"{scope}.{kind}"], 0, steps) == simulated
            if group in result.spikes:
                simulated = result.spikes[group][:, i].tolist()
                assert values_by_step(paths[f"{scope}.spike"], 0, steps) == simulated
            else:
                assert f"{scope}.spike" not in paths
    # Two's complement matters only if some value is negative.
    assert min(int(array.min()) for array in result.v.values()) < 0
    assert values_by_step(paths["time.step"], 0, steps) == list(range(steps))


def test_phases_follow_each_other():
    program = two_phases()
    played = play_recording(program, np.eye(5, 4, dtype=np.uint8))
    paths, end = read_vcd(vcd_file(played, ())["waves.vcd"])
    assert end == 5 + 4
    assert paths["time.running"] == [(0, "1"), (5, "0")]
    assert paths["location.running"] == [(0, "0"), (5, "1"), (9, "0")]
    assert paths["location.b.n0.u"][0] == (0, "x")
    assert (
        values_by_step(paths["location.b.n0.u"], start=5, steps=4)
        == played.result.u["b"][:, 0].tolist()
    )
    assert (
        values_by_step(paths["time.a.n0.v"], start=0, steps=5)
        == played.result.v["a"][:, 0].tolist()
    )


def test_steps_before_the_first_touch_do_not_run():
    """The time phase begins in step 3, the first with two events, and runs five steps."""
    recording = np.zeros((12, 4), dtype=np.uint8)
    recording[[3, 3, 5], [0, 2, 1]] = 1
    played = play_recording(two_phases(align_events=2, bias=700), recording)
    paths, end = read_vcd(vcd_file(played, ())["waves.vcd"])
    assert end == 5 + 4
    assert paths["time.running"] == [(0, "1"), (5, "0")]
    assert values_by_step(paths["time.step"], start=0, steps=5) == [3, 4, 5, 6, 7]
    assert (
        values_by_step(paths["time.a.n0.potential"], start=0, steps=5)
        == played.result.potential["a"][3:8, 0].tolist()
    )
    assert (
        values_by_step(paths["time.a.n0.spike"], start=0, steps=5)
        == played.result.spikes["a"][3:8, 0].tolist()
    )
    # No step of the rest has two events, so only the location phase runs.
    late = play_recording(played.program, recording[4:])
    paths, end = read_vcd(vcd_file(late, ())["waves.vcd"])
    assert end == 4
    assert paths["time.running"] == [(0, "0")]


def test_names_that_are_no_identifiers():
    b = hw.ProgramBuilder(CHIP, name="odd $end\n#0")
    x = b.add_input("x", 1)
    for name in ("a b", "a.b", "0", "$end", "é"):
        b.connect(x, b.add_compartments(name, 1, threshold=1), [[2]])
    content = vcd_file(play_recording(b.build(), [[1], [0]]), ())["waves.vcd"]
    paths, _ = read_vcd(content)
    assert {path.split(".")[1] for path in paths} - {"running", "step"} == {
        "a_b",
        "a_b_2",
        "_0",
        "_end",
        "_",
    }
    assert b"$comment\n\todd _end #0, recording 0; 1 us is one step\n" in content


def test_each_of_many_signals_has_a_code_of_its_own():
    """Codes of one letter are too few for so many signals."""
    neurons = 60
    b = hw.ProgramBuilder(CHIP)
    b.connect(
        b.add_input("x", 1),
        b.add_compartments("h", neurons, threshold=1),
        np.full((neurons, 1), 2),
    )
    paths, _ = read_vcd(vcd_file(play_recording(b.build(), [[1], [0]]), ["h"])["waves.vcd"])
    # Two signals of the phase; u, v, potential and spikes of each neuron.
    assert len(paths) == 2 + 4 * neurons


# Probes ---------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def played():
    """A recording that was played to a program with every kind of neuron."""
    program = everything()
    return play_recording(program, played_streams(program))


@pytest.mark.parametrize(
    ("probes", "compartments"),
    [
        (["h[3]"], [("h", 3)]),
        (["o[2]"], [("o/dendrite", 2), ("o", 2)]),
        (["o/dendrite[2]"], [("o/dendrite", 2)]),
        (["h[5:7]", "h[6]"], [("h", 5), ("h", 6)]),
        (["o"], [(name, i) for name in ("o/dendrite", "o") for i in range(5)]),
    ],
    ids=["neuron", "with its dendrite", "dendrite alone", "range, once each", "population"],
)
def test_probes_select_compartments_and_those_joined_to_them(played, probes, compartments):
    assert probed(played, probes) == tuple(compartments)


def test_the_most_active_neuron_is_shown_by_default(played):
    spikes = played.result.spikes
    most = {name: int(spikes[name].sum(axis=0).argmax()) for name in ("h", "o")}
    assert probed(played, ()) == (
        ("h", most["h"]),
        ("o/dendrite", most["o"]),
        ("o", most["o"]),
    )


@pytest.mark.parametrize(
    ("probe", "message"),
    [
        pytest.param(
            "hh[0]",
            "probe 'hh[0]': there is no population 'hh'. Did you mean 'h'?",
            id="unknown",
        ),
        pytest.param(
            "hh",
            "probe 'hh': there is no population 'hh'. Did you mean 'h'?",
            id="unknown population",
        ),
        pytest.param(
            "h[a]",
            "probe 'h[a]': not an index. Write population[index] or population[first:stop].",
            id="form",
        ),
        pytest.param(
            "h[7]",
            "probe 'h[7]': 'h' has no such compartment (7 compartments). Count from 0 to 6.",
            id="far",
        ),
        pytest.param(
            "h[3:3]",
            "probe 'h[3:3]': it holds no compartment. Let the stop be above the first.",
            id="empty",
        ),
        pytest.param(
            "h[-1]",
            "probe 'h[-1]': not an index. Write population[index] or population[first:stop].",
            id="negative",
        ),
    ],
)
def test_a_probe_that_selects_nothing_is_refused(played, probe, message):
    with pytest.raises(InputError) as caught:
        probed(played, [probe])
    assert str(caught.value) == message
