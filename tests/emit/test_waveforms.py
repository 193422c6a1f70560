"""The value change dump, read back by the reader of pyvcd and equal to the simulator; and what probes name."""

from __future__ import annotations

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.backends.played import play_recording
from locsnn_compile.backends.waves import probed, vcd_file
from locsnn_compile.errors import InputError
from tests.support.emitted_programs import CHIP, everything, played_streams, two_phases
from tests.support.vcd_values import read_vcd, values_by_step


def test_every_value_is_the_simulators():
    program = everything()
    played = play_recording(program, played_streams(program))
    paths, end = read_vcd(vcd_file(played, ["h", "o[1:3]"])["waves.vcd"])
    assert end == 40
    result, checked = played.result, 0
    for group, indices, name in (
        ("h", range(7), "h"),
        ("o", (1, 2), "o"),
        ("o/dendrite", (1, 2), "o_dendrite"),
    ):
        for i in indices:
            for kind in ("u", "v", "potential"):
                wanted = getattr(result, kind)[group][:, i].tolist()
                assert values_by_step(paths[f"time.{name}.n{i}.{kind}"], 0, 40) == wanted
                checked += 1
            if group in result.spikes:
                assert (
                    values_by_step(paths[f"time.{name}.n{i}.spike"], 0, 40)
                    == result.spikes[group][:, i].tolist()
                )
            else:
                assert f"time.{name}.n{i}.spike" not in paths
    assert checked == 33
    assert min(int(array.min()) for array in result.v.values()) < 0
    assert values_by_step(paths["time.step"], 0, 40) == list(range(40))


def test_phases_follow_each_other():
    program = two_phases()
    played = play_recording(program, np.eye(5, 4, dtype=np.uint8))
    paths, end = read_vcd(vcd_file(played, ())["waves.vcd"])
    assert end == 5 + 4
    assert paths["time.running"] == [(0, "1"), (5, "0")]
    assert paths["location.running"] == [(0, "0"), (5, "1"), (9, "0")]
    assert paths["location.b.n0.u"][0] == (0, "x")
    assert values_by_step(paths["location.b.n0.u"], 5, 4) == played.result.u["b"][:, 0].tolist()
    assert values_by_step(paths["time.a.n0.v"], 0, 5) == played.result.v["a"][:, 0].tolist()


def test_steps_before_the_first_touch_do_not_run():
    recording = np.zeros((12, 4), dtype=np.uint8)
    recording[[3, 3, 5], [0, 2, 1]] = 1
    played = play_recording(two_phases(align_events=2, bias=700), recording)
    paths, end = read_vcd(vcd_file(played, ())["waves.vcd"])
    assert end == 5 + 4
    assert paths["time.running"] == [(0, "1"), (5, "0")]
    assert values_by_step(paths["time.step"], 0, 5) == [3, 4, 5, 6, 7]
    assert (
        values_by_step(paths["time.a.n0.potential"], 0, 5)
        == played.result.potential["a"][3:8, 0].tolist()
    )
    assert (
        values_by_step(paths["time.a.n0.spike"], 0, 5) == played.result.spikes["a"][3:8, 0].tolist()
    )
    never, end = read_vcd(vcd_file(play_recording(played.program, recording[4:]), ())["waves.vcd"])
    assert end == 4
    assert never["time.running"] == [(0, "0")]


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
    many = hw.ProgramBuilder(CHIP)
    many.connect(
        many.add_input("x", 1), many.add_compartments("h", 60, threshold=1), np.full((60, 1), 2)
    )
    paths, _ = read_vcd(vcd_file(play_recording(many.build(), [[1], [0]]), ["h"])["waves.vcd"])
    assert len(paths) == 2 + 4 * 60


# Probes ---------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def played():
    """A program of every kind of neuron, and one recording played on it."""
    program = everything()
    return play_recording(program, played_streams(program))


@pytest.mark.parametrize(
    ("probes", "found"),
    [
        (["h[3]"], [("h", 3)]),
        (["o[2]"], [("o/dendrite", 2), ("o", 2)]),
        (["o/dendrite[2]"], [("o/dendrite", 2)]),
        (["h[5:7]", "h[6]"], [("h", 5), ("h", 6)]),
        (["o"], [(name, i) for name in ("o/dendrite", "o") for i in range(5)]),
    ],
    ids=["neuron", "with its dendrite", "dendrite alone", "range, once each", "population"],
)
def test_probes(played, probes, found):
    assert probed(played, probes) == tuple(found)


def test_the_most_active_neuron_is_shown_by_default(played):
    spikes = played.result.spikes
    most = {name: int(spikes[name].sum(axis=0).argmax()) for name in ("h", "o")}
    assert probed(played, ()) == (
        ("h", most["h"]),
        ("o/dendrite", most["o"]),
        ("o", most["o"]),
    )


BAD_PROBES = [
    ("unknown", "hh[0]", "probe 'hh[0]': there is no population 'hh'. Did you mean 'h'?"),
    ("unknown population", "hh", "probe 'hh': there is no population 'hh'. Did you mean 'h'?"),
    (
        "form",
        "h[a]",
        "probe 'h[a]': not an index. Write population[index] or population[first:stop].",
    ),
    (
        "far",
        "h[7]",
        "probe 'h[7]': 'h' has no such compartment (7 compartments). Count from 0 to 6.",
    ),
    (
        "empty",
        "h[3:3]",
        "probe 'h[3:3]': it holds no compartment. Let the stop be above the first.",
    ),
    (
        "negative",
        "h[-1]",
        "probe 'h[-1]': not an index. Write population[index] or population[first:stop].",
    ),
]


@pytest.mark.parametrize(
    ("probe", "line"), [row[1:] for row in BAD_PROBES], ids=[row[0] for row in BAD_PROBES]
)
def test_bad_probes(played, probe, line):
    with pytest.raises(InputError) as caught:
        probed(played, [probe])
    assert str(caught.value) == line
