"""Energy profiles: those that ship, a user's own, and every mistake with its whole message."""

from __future__ import annotations

import pytest
import yaml

import hw_model as hw
from hw_model.description.profile import NotIncluded, StaticPower

CHIP = hw.chip("loihi-sim")
MINE = {
    "source": "our board, run 7",
    "basis": "measured on one board",
    "voltage_v": 0.8,
    "energy_pj": {"synaptic_ops": 30.0, "neuron_updates": 70, "transpose_events": 5.0},
    "energy_pj_range": {"synaptic_ops": [25.0, 35.0]},
    "time_ns": {"synaptic_ops": 4.0, "packets_received": 2.0},
    "barrier_ns": {"one_tile": 100.0, "all_tiles": 400.0},
    "static_power": {"chip_mw": 90.0, "source": "the same board"},
    "sources": {"transpose_events": "a guess"},
    "not_included": [
        "host",
        {"what": "loading", "bound_pj": {"spikes": 1.5}, "bound_source": "a data sheet"},
    ],
}


def written(tmp_path, name="mine.yaml", **changes):
    """Write :data:`MINE` with some keys changed, or removed with ``KeyError``, and return its path."""
    document = {key: value for key, value in {**MINE, **changes}.items() if value is not KeyError}
    path = tmp_path / name
    path.write_text(yaml.safe_dump(document))
    return path


def test_every_constant_that_ships_has_source_basis_and_voltage():
    assert {name: profile.voltage_v for name, profile in CHIP.profiles.items()} == {
        "davies2018": 0.75,
        "sanafe": None,
    }
    for profile in CHIP.profiles.values():
        assert profile.basis
        assert all(profile.source_of(count) for count in (*profile.energy_pj, *profile.time_ns))
        assert profile.static_power == StaticPower(
            104.4, "derived from a board measurement: Frady 2020, 3.34 W for 32 chips"
        )


def test_the_published_ranges_of_the_profiles_that_ship():
    davies, sanafe = (CHIP.profile(name) for name in ("davies2018", "sanafe"))
    assert davies.energy_pj_range == {"synaptic_ops": (23.6, None)}
    assert davies.time_ns_range == {"synaptic_ops": (None, 3.5)}
    assert davies.with_times("least") is None
    assert davies.with_times("most").time_ns == davies.time_ns
    assert sanafe.with_times("least").time_ns == {**sanafe.time_ns, "synaptic_ops": 3.8}


def test_static_power_is_drawn_by_every_chip_for_the_whole_time():
    assert StaticPower(2.0, "a data sheet").pj(3, 50.0) == 300.0


def test_a_users_profile_becomes_the_default(tmp_path):
    chip = hw.priced_by(CHIP, written(tmp_path))
    assert list(chip.profiles) == ["mine", "davies2018", "sanafe"]
    assert chip.default_profile == "mine"
    mine = chip.profile("mine")
    assert (mine.source_of("synaptic_ops"), mine.source_of("transpose_events")) == (
        "our board, run 7",
        "a guess",
    )
    assert mine.energy_pj_range == {"synaptic_ops": (25.0, 35.0)}
    assert mine.not_included == (
        NotIncluded("host"),
        NotIncluded("loading", {"spikes": 1.5}, "a data sheet"),
    )
    assert hw.energy_pj(hw.Counts(synaptic_ops=2, neuron_updates=3, transpose_events=4), mine) == {
        "synaptic_ops": 60.0,
        "neuron_updates": 210.0,
        "transpose_events": 20.0,
    }


def test_a_profile_of_the_chip_comes_first_by_name():
    assert list(hw.priced_by(CHIP, "sanafe").profiles) == ["sanafe", "davies2018"]


def test_optional_keys_of_a_profile_may_be_left_out(tmp_path):
    optional = ("voltage_v", "energy_pj_range", "static_power", "sources")
    chip = hw.priced_by(CHIP, written(tmp_path, **dict.fromkeys(optional, KeyError)))
    assert (chip.profile("mine").voltage_v, chip.profile("mine").static_power) == (None, None)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"basis": KeyError}, "mine.yaml: the key 'basis' is missing. Add it."),
        ({"voltage": 1}, "mine.yaml: unknown key 'voltage'. Did you mean 'voltage_v'?"),
        ({"voltage_v": "low"}, "mine.yaml: voltage_v: it must be a number from 0 to 1099511627776 (got 'low'). Correct it."),
        ({"energy_pj": {}}, "mine.yaml: energy_pj: it prices nothing, so everything would take 0 pJ. Price a count."),
        ({"energy_pj": {"spike": 1}}, "mine.yaml: energy_pj: 'spike' is not counted. Did you mean 'spikes'?"),
        ({"energy_pj": {"skipped_steps": 1}}, "mine.yaml: energy_pj: 'skipped_steps' depends on the engine, not on the chip. Leave it out."),
        ({"energy_pj": {"cycles": 7}}, "mine.yaml: energy_pj: 'cycles' is 0 in simulations, which do not run the core. Give power that does not depend on work as static_power."),
        ({"energy_pj": {"spikes": -1}}, "mine.yaml: energy_pj.spikes: it must be a number from 0 to 1099511627776 (got -1). Correct it."),
        ({"energy_pj": {"spikes": float("nan")}}, "mine.yaml: energy_pj.spikes: it must be a number from 0 to 1099511627776 (got nan). Correct it."),
        ({"time_ns": {"hop_x": 1}}, "mine.yaml: time_ns: 'hop_x' is not counted. Did you mean 'hops_x'?"),
        (
            {"energy_pj_range": {"synaptic_ops": [31, None]}},
            "mine.yaml: energy_pj_range.synaptic_ops: the constant 30 is not within 31 to. Correct it.",
        ),
        (
            {"time_ns_range": {"synaptic_ops": [5, 6]}},
            "mine.yaml: time_ns_range.synaptic_ops: the constant 4 is not within 5 to 6. Correct it.",
        ),
        (
            {"energy_pj_range": {"synaptic_ops": 25}},
            "mine.yaml: energy_pj_range.synaptic_ops: it must be a list (got 25). Correct it.",
        ),
        (
            {"energy_pj_range": {"spikes": [1, 2]}},
            "mine.yaml: energy_pj_range: 'spikes' has no constant. "
            "Choose one of: neuron_updates, synaptic_ops, transpose_events.",
        ),
        ({"sources": {"synaptic_op": "x"}}, "mine.yaml: sources: 'synaptic_op' has no constant. Did you mean 'synaptic_ops'?"),
        ({"static_power": {"chip_mw": 1}}, "mine.yaml: static_power: the key 'source' is missing. Add it."),
        ({"static_power": 90}, "mine.yaml: static_power: it must be a mapping of names (got 90). Correct it."),
        ({"not_included": "host"}, "mine.yaml: not_included: it must be a list (got 'host'). Correct it."),
        ({"not_included": [3]}, "mine.yaml: not_included: it must be a mapping of names (got 3). Correct it."),
        (
            {"not_included": [{"what": "x", "bound_pj": {"spike": 1}}]},
            "mine.yaml: not_included: 'spike' is not counted. Did you mean 'spikes'?",
        ),
        (
            {"not_included": [{"what": "x", "bound_pj": {"skipped_steps": 1}}]},
            "mine.yaml: not_included: 'skipped_steps' depends on the engine, not on the chip. Leave it out.",
        ),
        ({"barrier_ns": {"one_tile": 1}}, "mine.yaml: barrier_ns: the key 'all_tiles' is missing. Add it."),
        (
            {"barrier_ns": {"one_tile": 2.5, "all_tiles": 1}},
            "mine.yaml: barrier_ns: one tile takes longer than all tiles (2.5 ns against 1.0). Correct it.",
        ),
        (
            {"energy_pj": {"synaptic_ops": 30, "neuron_updates": 70, "transpose_events": 5, "hops": 1, "hops_x": 2}},
            "mine.yaml: energy_pj: 'hops' are hops_x and hops_y together, which would be priced twice. Price either.",
        ),
        (
            {"energy_pj": {"synaptic_ops": 30, "neuron_updates": 70, "transpose_events": 5, "hops": 1, "hops_y": 0}},
            "mine.yaml: energy_pj: 'hops' are hops_x and hops_y together, which would be priced twice. Price either.",
        ),
    ],
    ids=[
        "missing", "unknown", "voltage", "no price", "not counted", "of an engine", "of the core", "negative", "not a number", "not timed", "range above",
        "range beside", "no range", "range of nothing", "source of nothing", "static without source", "static number",
        "no list", "no text", "bound not counted", "bound of an engine", "half a barrier",
        "barrier of one tile", "hops twice", "hops twice for nothing",
    ],
)  # fmt: skip
def test_mistakes_in_profiles_are_refused_with_their_way_out(tmp_path, changes, message):
    with pytest.raises(hw.InputError) as caught:
        hw.priced_by(CHIP, written(tmp_path, **changes))
    assert str(caught.value) == message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("source: }", "mine.yaml: it is not YAML at line 1. Compare it with a chip that ships."),
        ("3", "mine.yaml: it must be a mapping of names (got 3). Correct it."),
        (b"\xff", "mine.yaml: it is not UTF-8 text. Give the path of a profile YAML file."),
        (
            "#" * (1 << 20) + "\n",
            "mine.yaml: it is too large (1048577 bytes against 1048576). "
            "Give a profile file like those in a chip file.",
        ),
        ("!!python/object/apply:os.system [id]", "mine.yaml: it is not YAML at line 1. Compare it with a chip that ships."),
    ],
    ids=["broken", "number", "bytes", "large", "code"],
)  # fmt: skip
def test_profile_files_that_are_refused(tmp_path, text, message):
    (tmp_path / "mine.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(hw.InputError) as caught:
        hw.priced_by(CHIP, tmp_path / "mine.yaml")
    assert str(caught.value) == message


def test_profile_names_that_are_refused(tmp_path):
    for given, message in (
        ("gone.yaml", "gone.yaml: it cannot be read (No such file or directory). Give the path of a profile YAML file."),
        (
            "davies",
            "chip loihi-sim: there is no energy profile 'davies'. Did you mean 'davies2018'? "
            "A profile of your own is a file that ends in .yaml.",
        ),
        (written(tmp_path, "sanafe.yaml"), "sanafe.yaml: loihi-sim has a profile 'sanafe' of its own. Give the file another name."),
    ):  # fmt: skip
        with pytest.raises(hw.InputError) as caught:
            hw.priced_by(CHIP, given)
        assert str(caught.value) == message
