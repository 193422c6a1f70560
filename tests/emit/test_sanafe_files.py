"""``--emit sanafe``: the files are read as YAML and compared with the program, its profile and the simulator.

They show which phases SANA-FE's neurons would compute and which are replayed, where neurons and synapses are mapped,
and what operations cost. SANA-FE itself runs such files in tests/peers.
"""

from __future__ import annotations

import re
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
    """Return the YAML files for SANA-FE as plain values, by name without the folder."""
    files = sanafe_files(played)
    return {
        name.removeprefix("sanafe/"): yaml.safe_load(text)
        for name, text in files.items()
        if name.endswith("yaml")
    }


def one_compartment(chip=CHIP, weight=20, steps=3, delay=0, exponent=0, **settings):
    """Play an event per step to a program of one compartment, driven by one line."""
    settings = {"decay_u": 4096, "decay_v": 128, "threshold": 30, **settings}
    b = hw.ProgramBuilder(chip)
    line = b.add_input("x", 1)
    cell = b.add_compartments("h", 1, **settings)
    b.connect(line, cell, [[weight]], delay=delay, exponent=exponent)
    return play_recording(b.build(), np.ones((steps, 1), dtype=np.uint8))


def joined_compartments():
    """Play two events to a program of a soma with a dendrite."""
    b = hw.ProgramBuilder(CHIP)
    soma = b.add_compartments("h", 1, threshold=10)
    child = b.add_compartments("h/dendrite", 1, threshold=0, joined_to=soma)
    b.connect(b.add_input("x", 1), child, [[20]])
    return play_recording(b.build(), [[1], [1]])


# A program with a recording, and the reasons why SANA-FE's neurons would not compute it.
OBSTACLES = [
    pytest.param(one_compartment, [], id="none"),
    pytest.param(lambda: one_compartment(decay_u=0), [], id="lasting current"),
    pytest.param(lambda: one_compartment(decay_u=2048), [], id="exact fractions"),
    pytest.param(lambda: one_compartment(delay=5), [], id="delay of five"),
    pytest.param(joined_compartments, ["joined compartments, of which its neurons have none (1)"], id="joined"),
    pytest.param(lambda: one_compartment(refractory=2), ["refractory periods, in which it loses charge that arrives (1)"], id="refractory"),
    pytest.param(lambda: one_compartment(delay=6), ["delays above 5 steps (1)"], id="delay"),
    pytest.param(lambda: one_compartment(vmax=(1 << 9) - 1), ["upper voltage limits not above the threshold; it has no upper limit (1)"], id="upper limit"),
    pytest.param(lambda: one_compartment(exponent=7, weight=254, decay_u=0, threshold=131071, steps=6), ["wraps of registers in this recording; it has none (1)"], id="wraps"),
    pytest.param(lambda: one_compartment(decay_u=1025), ["currents that lose a fraction in this recording; it keeps fractions (1)"], id="fractions"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "reasons"), OBSTACLES)
def test_a_program_that_its_neurons_do_not_compute_is_replayed_with_the_reasons(make, reasons):
    played = make()
    assert obstacles(played, "time") == reasons
    (phase,) = documents(played)["expected.yaml"]["phases"]
    assert phase["neurons"] == ("replayed" if reasons else "simulated")
    assert phase["because"] == reasons


CORES_PER_TILE = 2
TILES = 3 * 2


def several_tiles():
    """Play a recording to a program on several cores and tiles that SANA-FE's neurons compute."""
    r = np.random.default_rng(0)
    chip = small_chip(compartments=4, cores_per_tile=CORES_PER_TILE, columns=3, rows=2)
    b = hw.ProgramBuilder(chip)
    x = b.add_input("x", 5)
    h = b.add_compartments(
        "h.1", 9, decay_u=4096, decay_v=100, threshold=50, bias=np.repeat([0, 64, -1], 3)
    )
    o = b.add_compartments("o", 6, decay_u=4096, decay_v=100, threshold=50)
    b.connect(x, h, r.integers(0, 2, (9, 5)) * 40)
    b.connect(h, o, r.integers(0, 2, (6, 9)) * 40, delay=2)
    return play_recording(b.build(), (r.random((8, 5)) < 0.5).astype(np.uint8))


def test_every_synapse_is_an_edge_and_every_neuron_is_mapped_to_its_core():
    played = several_tiles()
    program = played.program
    files = documents(played)
    network = files["time.yaml"]["network"]
    sizes = {}
    for group in network["groups"]:
        # The last row of a group is "first..last: attributes" or "last: attributes".
        (last_numbers,) = group["neurons"][-1]
        sizes[group["name"]] = int(str(last_numbers).rsplit("..", 1)[-1]) + 1
    assert {name: size for name, size in sizes.items() if "_tile" not in name} == {"h_1": 9, "o": 6}
    assert len(network["edges"]) == sum(len(core.axons.target) for core in program.cores)

    core_of_neuron = {}
    for mapping in files["time.yaml"]["mappings"]:
        ((neurons, units),) = mapping.items()
        name, numbers = neurons.split(".", 1)
        first, _, last = numbers.partition("..")
        for i in range(int(first), int(last or first) + 1):
            core_of_neuron[name, i] = str(units["core"])
    assert len(core_of_neuron) == sum(sizes.values())
    tiles = 0
    for tile in files["arch.yaml"]["architecture"]["tile"]:
        first, last = re.fullmatch(r"tile\[(\d+)\.\.(\d+)\]", tile["name"]).groups()
        tiles += int(last) - int(first) + 1
    assert tiles == TILES
    for core in program.cores:
        column, row = program.chip.tile_of(core.slot)
        tile_number = column * program.chip.mesh.rows + row
        for core_slice in core.slices:
            name = core_slice.group.replace(".", "_")
            for i in range(core_slice.start, core_slice.stop):
                core_name = f"{tile_number}.{core.slot % CORES_PER_TILE}"
                assert core_of_neuron[name, i] == core_name
    # Input neurons sit on the host core of a tile, so their packets travel no hop.
    for (name, _), core_name in core_of_neuron.items():
        if "_tile" in name:
            tile_number = name.rsplit("_tile")[1]
            assert core_name == f"{tile_number}.{CORES_PER_TILE}"


def test_costs_are_those_of_the_profile():
    tile = documents(one_compartment())["arch.yaml"]["architecture"]["tile"][0]
    hops = tile["attributes"]
    core, host = tile["core"]
    soma = core["soma"][0]["attributes"]
    energy_joules = {
        "synaptic_ops": core["synapse"][0]["attributes"]["energy_process_spike"],
        "neuron_updates": soma["energy_access_neuron"],
        "neuron_updates_active": soma["energy_update_neuron"],
        "spikes": soma["energy_spike_out"],
        "axon_packets": core["axon_out"][0]["attributes"]["energy_message_out"],
        "hops_x": hops["energy_east_hop"],
        "hops_y": hops["energy_south_hop"],
    }
    energy_pj = {name: float(joules) * 1e12 for name, joules in energy_joules.items()}
    assert energy_pj == pytest.approx(CHIP.profile("sanafe").energy_pj)
    # The host's core costs nothing.
    for unit in ("synapse", "soma", "axon_out"):
        attributes = host[unit][0]["attributes"]
        costs = [
            float(cost)
            for name, cost in attributes.items()
            if name.startswith(("energy", "latency"))
        ]
        assert set(costs) == {0.0}


def test_a_phase_is_a_network_of_its_own():
    played = play_recording(two_phases(), np.eye(5, 4, dtype=np.uint8))
    files = documents(played)
    assert set(files) == {"arch.yaml", "time.yaml", "location.yaml", "expected.yaml"}
    phases = files["expected.yaml"]["phases"]
    assert [(phase["file"], phase["steps"]) for phase in phases] == [
        ("time.yaml", 5),
        ("location.yaml", 4),
    ]
    groups = {group["name"]: group for group in files["location.yaml"]["network"]["groups"]}
    spikes = [neuron[i]["spikes"] for i, neuron in enumerate(groups["xt_tile0"]["neurons"])]
    assert np.array_equal(np.array(spikes).T, played.lines["location"])


def test_steps_before_the_first_touch_are_left_out():
    """The time phase begins in step 3, the first with two events, and runs five steps."""
    recording = np.zeros((12, 4), dtype=np.uint8)
    recording[[0, 3, 3, 5], [1, 0, 2, 1]] = 1
    files = documents(play_recording(two_phases(align_events=2, bias=700), recording))
    phases = files["expected.yaml"]["phases"]
    assert [(phase["file"], phase["first_step"], phase["steps"]) for phase in phases] == [
        ("time.yaml", 3, 5),
        ("location.yaml", 0, 4),
    ]
    lines, cell = files["time.yaml"]["network"]["groups"]
    assert [line[i]["spikes"] for i, line in enumerate(lines["neurons"])] == [
        [1, 0, 0, 0, 0],
        [0, 0, 1, 0, 0],
        [1, 0, 0, 0, 0],
        [0, 0, 0, 0, 0],
    ]
    # The cell has a bias, so it is updated in all five steps; the lines spike three times.
    assert phases[0]["counts"]["neurons_updated"] == 5 + 3
    assert cell["name"] == "a"


def test_synapses_of_replayed_spikes_have_weights_of_0():
    program = everything()
    network = documents(play_recording(program, played_streams(program)))["time.yaml"]["network"]
    attributes = [next(iter(edge.values())) for edge in network["edges"]]
    assert attributes
    assert all(edge_attributes == {"weight": 0} for edge_attributes in attributes)


@pytest.mark.parametrize("name", ["davies2018", "sanafe"], ids=["no profile", "other prices"])
def test_a_chip_without_the_costs_that_sana_fe_has_is_refused(name):
    """The chip has the profile davies2018 alone, under its own name or under that of the missing profile."""
    chip = replace(CHIP, profiles={name: CHIP.profile("davies2018")})
    with pytest.raises(InputError) as caught:
        sanafe_files(one_compartment(chip))
    assert str(caught.value) == (
        "chip loihi-sim: it has no energy profile 'sanafe' that prices what SANA-FE counts. "
        "Copy the profile 'sanafe' of loihi-sim into the chip file."
    )


def test_a_core_larger_than_a_unit_of_sana_fe_is_refused():
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
    # The names of the input and of the population.
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
