"""The core as the smallest device has it: no joins, few phases, and events in a memory of one port."""

from __future__ import annotations

import shutil
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from hw_model.description.board import board
from hw_model.mapping.graph import Readout
from hw_model.rtl.bitstream import fit
from hw_model.rtl.board import Board
from hw_model.rtl.comparison import compare
from hw_model.rtl.cosimulation import ANSWER
from hw_model.rtl.device import on_core
from hw_model.rtl.images import sizes_for
from hw_model.rtl.ports import SimulatedBoard
from hw_model.rtl.simulators import sources
from hw_model.rtl.streaming import stream
from locsnn_compile.data.read import read_recordings
from locsnn_compile.frontends import load
from locsnn_compile.pipeline import lower
from tests.support import benches, hybrids
from tests.support.benches import differ

EXAMPLES = Path(__file__).parents[2] / "examples"
SMALL = replace(benches.SIZES, join=0, one_port=1, phase_words=8)
DEVICE = hw.chip("ice40up5k")
PLAYED = {"objects-hybrid": "touches.npz", "containers-hybrid": "touches-long.npz"}
"""Networks that ship and fit, and a file of recordings for each."""
pytestmark = pytest.mark.usefixtures("cores_of_this_run")
NEEDS_ICARUS = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)
NEEDS_VERILATOR = pytest.mark.skipif(
    shutil.which("verilator") is None, reason="Verilator is not installed"
)
FAULTS = [
    ("a mark is written a cycle late", "transpose.sv", "ONE_PORT != 0 ? marked || sweep : write_back", "write_back"),
    ("marks are not written", "transpose.sv", "ONE_PORT != 0 ? marked || sweep :", "ONE_PORT != 0 ? sweep :"),
    ("the buffer is not swept", "transpose.sv", "ONE_PORT != 0 ? marked || sweep :", "ONE_PORT != 0 ? marked :"),
    ("the word of the mark before", "transpose.sv", "ONE_PORT != 0 ? written : write_word", "write_word"),
    ("a mark takes two cycles", "transpose.sv", "!(ONE_PORT != 0 && write) && (marking", "!write_back && (marking"),
    ("entries are where families would be", "update.sv", "JOIN_FIELDS = JOIN != 0 ? 2 + PARENT : 0;", "JOIN_FIELDS = 2 + PARENT;"),
    ("all phases are the first", "locsnn_core.sv", "PHASE_WORD'({phase, field[2:0]})", "PHASE_WORD'(field[2:0])"),
    ("phases have half their words", "locsnn_core.sv", "$clog2(PHASE_WORDS);", "$clog2(PHASE_WORDS) - 1;"),
]  # fmt: skip


def test_every_fault_fits():
    for name, file, old, new in FAULTS:
        assert (sources()[file].count(old), old != new) == (1, True), name


@pytest.mark.minutes
@NEEDS_ICARUS
def test_a_small_core_passes_every_bench():
    assert not differ(sources(), SMALL)


@NEEDS_ICARUS
def test_a_core_that_shares_places_sweeps_as_many_as_the_device_has():
    """A program of few compartments was simulated on a core of few places, whose cycles are fewer."""
    chip = hw.chip("locsnn-130nm")

    def branch(name: str, lines: int) -> hw.ProgramBuilder:
        b = hw.ProgramBuilder(chip)
        x = b.add_input(f"{name}/x", lines)
        y = b.add_compartments(f"{name}/y", 3, decay_v=400, threshold=20)
        b.connect(x, y, np.full((3, lines), 20))
        return b.graph()

    time = hybrids.graph_in_phase(branch("time", 4), "time", 10)
    location = hybrids.graph_in_phase(branch("location", 10), "location", 4, np.arange(4))
    readout = Readout(("time/y", "location/y"), (1.0, 1.0))
    spikes = (np.random.default_rng(0).random((2, 10, 4)) < 0.3).astype(np.uint8)
    comparison = compare(
        hybrids.program_of_graphs(chip, readout, time, location), spikes, sources(), "icarus"
    )
    assert (comparison["mismatches"], comparison["cycle_mismatches"]) == (0, 0)
    assert min(comparison["cycles"]) > chip.open_core.places * 2


@pytest.mark.slow
@NEEDS_ICARUS
@pytest.mark.parametrize("somas", [1, 3, 20])
def test_a_core_of_few_sums_has_as_many_as_the_device(somas):
    """Parents were numbered for the device's sums, and the simulated core had fewer: a false refusal."""
    b = hw.ProgramBuilder(hw.chip("locsnn-130nm"))
    x = b.add_input("x", 4)
    y = b.add_compartments("y", somas, decay_v=400, threshold=20)
    dendrites = b.add_compartments("y/d", somas, threshold=0, decay_u=400, decay_v=400, joined_to=y)
    b.connect(x, dendrites, np.full((somas, 4), 20))
    b.read_out(y)
    spikes = (np.random.default_rng(0).random((2, 10, 4)) < 0.3).astype(np.uint8)
    comparison = compare(b.build(), spikes, sources(), "icarus")
    assert (comparison["mismatches"], comparison["cycle_mismatches"]) == (0, 0)


def test_numbers_of_more_bits_than_the_core_has_do_not_fit():
    """The report said that it fits, with exact cycles; the words of the core were made later, and refused."""
    b = hw.ProgramBuilder(hw.chip("ecp5-25f"), name="slow")
    x = b.add_input("x", 2)
    y = b.add_compartments("y", 2, threshold=1, decay_v=400)
    b.connect(x, y, [[20, 4], [6, 2]])
    b.read_out(y)
    program = b.build()
    assert on_core(program, 10, program.chip)
    heavy = replace(program, readout=replace(program.readout, weights=(float(1 << 33),)))
    with pytest.raises(
        hw.TargetError, match="the open core has no weight of a readout of more than 32 bits"
    ):
        on_core(heavy, 10, program.chip)


def test_what_does_not_fit_the_device_is_not_simulated():
    chip = hw.chip("ecp5-25f")
    b = hw.ProgramBuilder(chip)
    x = b.add_input("location/x", 900)
    y = b.add_compartments("location/y", 3, decay_v=400, threshold=20)
    b.connect(x, y, np.full((3, 900), 20) * (np.arange(900) % 3 == 0))
    program = hybrids.program_of_graphs(
        chip,
        Readout(("location/y",), (1.0,)),
        hybrids.graph_in_phase(b.graph(), "location", 40, np.arange(40)),
    )
    spikes = np.ones((1, 900, 40), np.uint8)
    for play in (
        lambda: hw.cosimulate(program, spikes),
        lambda: stream(program, spikes, "sim:icarus", 115200, False),
    ):
        with pytest.raises(
            hw.TargetError, match=r"the open core of ecp5-25f is too small in 'bitmap'"
        ):
            play()


@pytest.mark.minutes
@NEEDS_ICARUS
@pytest.mark.parametrize(
    ("file", "old", "new"), [row[1:] for row in FAULTS], ids=[row[0] for row in FAULTS]
)
def test_faults_of_a_small_core_are_found(file, old, new):
    assert differ({**sources(), file: sources()[file].replace(old, new)}, SMALL)


def program_of(model: str, strategy: str = "reset", chip: hw.Chip = DEVICE) -> hw.ChipProgram:
    return lower(load(EXAMPLES / f"models/{model}.pt"), chip, 8, strategy).program


HELD = "Use the device ecp5-25f, ecp5-85f or locsnn-130nm."
SMALL_IN = "the open core of ice40up5k is too small in"
REFUSED = [
    (
        "objects-hybrid",
        "dendrite",
        f"program 'objects-hybrid': {SMALL_IN} 'axons' (736 against 512). {HELD}",
    ),
    (
        "objects-hybrid-loihi",
        "native",
        f"program 'objects-hybrid-loihi': {SMALL_IN} 'axons' (736 against 512). {HELD}",
    ),
    (
        "containers-hybrid",
        "dendrite",
        f"program 'containers-hybrid': {SMALL_IN} 'axons' (715 against 512). {HELD}",
    ),
    (
        "two-fingertips",
        "reset",
        "synapses 'touch_transposed' -> 'location_hidden': a delay is out of range (4 against 0..0 steps; 1136 of 1136 delays outside). "
        "Relay the spike through 4 compartments, or shorten the delay.",
    ),
    (
        "objects-hybrid",
        "delay-line",
        "population 'time_hidden': 1 delayed synapse cannot hold a kernel of tau_ref 1 "
        "(an error of 13 against 0.1; ice40up5k has delay_max 0). Use strategy reset.",
    ),
    (
        "containers-best",
        "reset",
        "population 'location_output_1': 615 input axons of neuron 0 do not fit one core (ice40up5k holds 512). "
        "Prune 103 of its sources, or gather them in a population in between; a location branch has one per step.",
    ),
]


@pytest.mark.parametrize(
    ("model", "strategy", "message"), REFUSED, ids=[f"{row[0]}-{row[1]}" for row in REFUSED]
)
def test_what_the_smallest_device_does_not_hold_is_refused_by_name(model, strategy, message):
    with pytest.raises(hw.TargetError) as caught:
        program_of(model, strategy)
    assert str(caught.value) == message


def joined() -> hw.ChipProgram:
    """A parent with a child."""
    b = hw.ProgramBuilder(hw.chip("loihi-sim"), name="joined")
    x = b.add_input("x", 2)
    parent = b.add_compartments("parent", 1, threshold=100)
    b.connect(x, b.add_compartments("child", 1, threshold=100, joined_to=parent), [[2, 2]])
    b.read_out(parent)
    return b.build()


def test_joins_are_refused_before_anything_is_synthesised(monkeypatch):
    program = joined()
    monkeypatch.setattr(
        "hw_model.rtl.bitstream.run_tool", lambda *_: pytest.fail("a tool was called")
    )
    with pytest.raises(hw.TargetError) as caught:
        fit(program, board("icebreaker"), 1)
    assert str(caught.value) == f"program 'joined': {SMALL_IN} 'join' (25 against 0). {HELD}"


@pytest.mark.parametrize("model", PLAYED)
def test_networks_that_ship_fit_the_smallest_device(model):
    program = program_of(model)
    needs = on_core(program, max(phase.steps or 1 for phase in program.phases), DEVICE).needs
    assert sizes_for(needs, DEVICE.open_core) == DEVICE.open_core


@pytest.mark.minutes
@NEEDS_VERILATOR
@pytest.mark.parametrize("model", PLAYED)
def test_its_exact_configuration_plays_what_ships(model):
    recordings = read_recordings(str(EXAMPLES / "recordings" / PLAYED[model])).spikes
    program = program_of(model)
    comparison = compare(program, recordings, sources(), sizes=DEVICE.open_core)
    assert (comparison["recordings"], comparison["mismatches"], comparison["cycle_mismatches"]) == (
        len(recordings),
        0,
        0,
    )
    assert comparison["compared_values"] > 50_000 * len(recordings)
    _, file, old, new = FAULTS[0]
    faulty = {**sources(), file: sources()[file].replace(old, new)}
    assert compare(program, recordings[:1], faulty, sizes=DEVICE.open_core)["mismatches"] > 0


@pytest.mark.minutes
@NEEDS_VERILATOR
def test_its_board_says_its_sizes_and_plays_a_recording():
    program = program_of("objects-hybrid")
    recordings = read_recordings(str(EXAMPLES / "recordings/touches.npz")).spikes
    core = on_core(program, recordings.shape[1], DEVICE)
    expected = hw.simulate(program, recordings[:1], probe=())
    with closing(SimulatedBoard("verilator", DEVICE.open_core)) as port:
        board = Board(port)
        assert asdict(board.sizes) == asdict(DEVICE.open_core) | {"one_port": 0}
        board.load(core)
        answer = board.play(core, recordings[0])
    wanted = tuple(expected.per_recording[0][name] for name in ANSWER[3:])
    assert (answer.error, answer.winner, answer.counts) == (
        0,
        int(np.ravel(expected.prediction)[0]),
        wanted,
    )
