"""The files for SANA-FE, as YAML: what is mapped where, and why somas play spikes back. SANA-FE itself: tests/peers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml

import hw_model as hw
from locsnn_compile.backends.played import play_recording
from locsnn_compile.backends.sanafe.files import sanafe_files
from locsnn_compile.backends.sanafe.rules import obstacles
from locsnn_compile.backends.vectors.vectors import vectors_files
from locsnn_compile.errors import InputError
from tests.support.emitted_programs import CHIP, everything, played_streams, small_chip, two_phases


def documents(played):
    """The YAML files for SANA-FE as plain values, by name without the folder."""
    files = sanafe_files(played)
    return {
        name.removeprefix("sanafe/"): yaml.safe_load(text)
        for name, text in files.items()
        if name.endswith("yaml")
    }


def one(chip=CHIP, weight=20, steps=3, **settings):
    """Return one compartment driven by one line in every step."""
    b = hw.ProgramBuilder(chip)
    given = {"decay_u": 4096, "decay_v": 128, "threshold": 30, **settings}
    delay = given.pop("delay", 0)
    exponent = given.pop("exponent", 0)
    b.connect(
        b.add_input("x", 1),
        b.add_compartments("h", 1, **given),
        [[weight]],
        delay=delay,
        exponent=exponent,
    )
    return play_recording(b.build(), np.ones((steps, 1), dtype=np.uint8))


def joined():
    b = hw.ProgramBuilder(CHIP)
    soma = b.add_compartments("h", 1, threshold=10)
    child = b.add_compartments("h/dendrite", 1, threshold=0, joined_to=soma)
    b.connect(b.add_input("x", 1), child, [[20]])
    return play_recording(b.build(), [[1], [1]])


OBSTACLES = [
    ("none", one, []),
    ("lasting current", lambda: one(decay_u=0), []),
    ("exact fractions", lambda: one(decay_u=2048), []),
    ("delay of five", lambda: one(delay=5), []),
    ("joined", joined, ["joined compartments, of which its neurons have none (1)"]),
    ("refractory", lambda: one(refractory=2), ["refractory periods, in which it loses charge that arrives (1)"]),
    ("delay", lambda: one(delay=6), ["delays above 5 steps (1)"]),
    ("upper limit", lambda: one(vmax=(1 << 9) - 1), ["upper voltage limits not above the threshold; it has no upper limit (1)"]),
    ("wraps", lambda: one(exponent=7, weight=254, decay_u=0, threshold=131071, steps=6), ["wraps of registers in this recording; it has none (1)"]),
    ("fractions", lambda: one(decay_u=1025), ["currents that lose a fraction in this recording; it keeps fractions (1)"]),
]  # fmt: skip


@pytest.mark.parametrize(
    ("make", "lines"), [row[1:] for row in OBSTACLES], ids=[row[0] for row in OBSTACLES]
)
def test_why_its_neurons_do_not_compute_a_program(make, lines):
    played = make()
    assert obstacles(played, "time") == lines
    (phase,) = documents(played)["expected.yaml"]["phases"]
    assert (phase["neurons"], phase["because"]) == ("replayed" if lines else "simulated", lines)


def small():
    """Return a program of several cores and tiles that is simulated."""
    r = np.random.default_rng(0)
    b = hw.ProgramBuilder(small_chip(compartments=4, cores_per_tile=2, columns=3, rows=2))
    x = b.add_input("x", 5)
    h = b.add_compartments(
        "h.1", 9, decay_u=4096, decay_v=100, threshold=50, bias=np.repeat([0, 64, -1], 3)
    )
    o = b.add_compartments("o", 6, decay_u=4096, decay_v=100, threshold=50)
    b.connect(x, h, r.integers(0, 2, (9, 5)) * 40)
    b.connect(h, o, r.integers(0, 2, (6, 9)) * 40, delay=2)
    return play_recording(b.build(), (r.random((8, 5)) < 0.5).astype(np.uint8))


def test_every_synapse_is_an_edge_and_every_neuron_is_mapped_to_its_core():
    played = small()
    program, found = played.program, documents(played)
    network, mappings = found["time.yaml"]["network"], found["time.yaml"]["mappings"]
    sizes = {}
    for group in network["groups"]:
        (last,) = (str(key).rsplit("..", 1)[-1] for key in group["neurons"][-1])
        sizes[group["name"]] = int(last) + 1
    assert {name: size for name, size in sizes.items() if "_tile" not in name} == {"h_1": 9, "o": 6}
    assert len(network["edges"]) == sum(len(core.axons.target) for core in program.cores)

    place = {}
    for mapping in mappings:
        ((neurons, where),) = mapping.items()
        name, index = neurons.split(".", 1)
        first, _, last = index.partition("..")
        for i in range(int(first), int(last or first) + 1):
            place[name, i] = str(where["core"])
    assert len(place) == sum(sizes.values())
    rows, tile = program.chip.mesh.rows, found["arch.yaml"]["architecture"]["tile"]
    assert (
        sum(
            int(t["name"][5:-1].split("..")[1]) - int(t["name"][5:-1].split("..")[0]) + 1
            for t in tile
        )
        == 6
    )
    for core in program.cores:
        column, row = program.chip.tile_of(core.slot)
        for piece in core.slices:
            name = {"h.1": "h_1"}.get(piece.group, piece.group)
            for i in range(piece.start, piece.stop):
                assert place[name, i] == f"{column * rows + row}.{core.slot % 2}"
    # Input neurons sit on the host core of a tile, so their packets travel no hop.
    for (name, _), core in place.items():
        if "_tile" in name:
            assert core == f"{name.rsplit('_tile')[1]}.2"


def test_costs_are_those_of_the_profile():
    tile = documents(one())["arch.yaml"]["architecture"]["tile"][0]
    (hops, core, host) = (tile["attributes"], *tile["core"])
    soma = core["soma"][0]["attributes"]
    picojoules = {
        "synaptic_ops": core["synapse"][0]["attributes"]["energy_process_spike"],
        "neuron_updates": soma["energy_access_neuron"],
        "neuron_updates_active": soma["energy_update_neuron"],
        "spikes": soma["energy_spike_out"],
        "axon_packets": core["axon_out"][0]["attributes"]["energy_message_out"],
        "hops_x": hops["energy_east_hop"],
        "hops_y": hops["energy_south_hop"],
    }
    found = {name: float(value) * 1e12 for name, value in picojoules.items()}
    assert found == pytest.approx(CHIP.profile("sanafe").energy_pj)
    for section in ("synapse", "soma", "axon_out"):
        attributes = host[section][0]["attributes"]
        assert {
            float(v) for key, v in attributes.items() if key.startswith(("energy", "latency"))
        } == {0.0}


def test_a_phase_is_a_network_of_its_own():
    played = play_recording(two_phases(), np.eye(5, 4, dtype=np.uint8))
    found = documents(played)
    assert set(found) == {"arch.yaml", "time.yaml", "location.yaml", "expected.yaml"}
    assert [(p["file"], p["steps"]) for p in found["expected.yaml"]["phases"]] == [
        ("time.yaml", 5),
        ("location.yaml", 4),
    ]
    groups = {group["name"]: group for group in found["location.yaml"]["network"]["groups"]}
    spikes = [neuron[i]["spikes"] for i, neuron in enumerate(groups["xt_tile0"]["neurons"])]
    assert np.array_equal(np.array(spikes).T, played.lines["location"])


def test_steps_before_the_first_touch_are_left_out():
    recording = np.zeros((12, 4), dtype=np.uint8)
    recording[[0, 3, 3, 5], [1, 0, 2, 1]] = 1
    found = documents(play_recording(two_phases(align_events=2, bias=700), recording))
    phases = found["expected.yaml"]["phases"]
    assert [(p["file"], p["first_step"], p["steps"]) for p in phases] == [
        ("time.yaml", 3, 5),
        ("location.yaml", 0, 4),
    ]
    lines, cell = found["time.yaml"]["network"]["groups"]
    assert [line[i]["spikes"] for i, line in enumerate(lines["neurons"])] == [
        [1, 0, 0, 0, 0],
        [0, 0, 1, 0, 0],
        [1, 0, 0, 0, 0],
        [0, 0, 0, 0, 0],
    ]
    assert phases[0]["counts"]["neurons_updated"] == 5 + 3
    assert cell["name"] == "a"


def test_weights_of_spikes_played_back_are_nothing():
    program = everything()
    found = documents(play_recording(program, played_streams(program)))
    edges = [next(iter(edge.values())) for edge in found["time.yaml"]["network"]["edges"]]
    assert {tuple(edge.items()) for edge in edges} == {(("weight", 0),)}


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (
            lambda: one(replace(CHIP, profiles={"davies2018": CHIP.profile("davies2018")})),
            "chip loihi-sim: it has no energy profile 'sanafe' that prices what SANA-FE counts. "
            "Copy the profile 'sanafe' of loihi-sim into the chip file.",
        ),
        (
            lambda: one(replace(CHIP, profiles={"sanafe": CHIP.profile("davies2018")})),
            "chip loihi-sim: it has no energy profile 'sanafe' that prices what SANA-FE counts. "
            "Copy the profile 'sanafe' of loihi-sim into the chip file.",
        ),
    ],
    ids=["no profile", "other prices"],
)
def test_chips_that_cannot_be_written(make, line):
    with pytest.raises(InputError) as caught:
        sanafe_files(make())
    assert str(caught.value) == line


def test_cores_larger_than_its_units():
    large = replace(CHIP, limits=replace(CHIP.limits, compartments_per_core=2000))
    b = hw.ProgramBuilder(large)
    b.connect(
        b.add_input("x", 1), b.add_compartments("h", 1025, threshold=1), np.full((1025, 1), 2)
    )
    with pytest.raises(InputError) as caught:
        sanafe_files(play_recording(b.build(), [[1]]))
    assert str(caught.value) == (
        "--emit sanafe: a core has more compartments than SANA-FE's units hold (1025 against 1024). "
        "Leave it out for this chip."
    )


def test_hostile_names_are_code_in_the_readmes_and_plain_elsewhere():
    name = "<script>`x`\n# y"
    b = hw.ProgramBuilder(CHIP, name=name)
    b.connect(
        b.add_input("a -> b.0: {", 1),
        b.add_compartments("[0..3]: x\n", 1, decay_u=4096, threshold=1),
        [[2]],
    )
    played = play_recording(b.build(), [[1], [0]])
    for files, folder in ((sanafe_files(played), "sanafe"), (vectors_files(played), "vectors")):
        heading = files[f"{folder}/README.md"].decode().splitlines()[0]
        assert "`<script>'x' # y`" in heading
    groups = [group["name"] for group in documents(played)["time.yaml"]["network"]["groups"]]
    assert groups == ["a____b_0____tile0", "_0__3___x_"]
    assert yaml.safe_load(vectors_files(played)["vectors/manifest.yaml"])["program"] == name


def test_a_population_may_be_called_like_the_lines_of_an_input():
    b = hw.ProgramBuilder(CHIP)
    b.connect(
        b.add_input("x", 1), b.add_compartments("x_tile0", 1, decay_u=4096, threshold=1), [[2]]
    )
    network = documents(play_recording(b.build(), [[1], [0]]))["time.yaml"]["network"]
    assert [group["name"] for group in network["groups"]] == ["x_tile0", "x_tile0_2"]
    assert [list(edge) for edge in network["edges"]] == [["x_tile0.0 -> x_tile0_2.0"]]
