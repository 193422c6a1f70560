"""The core as the smallest device has it: no joined compartments, few phases, events in a memory of one port.

It plays every bench as the simulator does, and planted faults are found. Simulated cores must have the sizes of the device
where cycles or numbers depend on them, and programs that a device cannot hold are refused by name.
"""

from __future__ import annotations

import shutil
from contextlib import closing
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import hw_model as hw
from hw_model.description.board import board
from hw_model.mapping.graph import Readout
from hw_model.rtl.bitstream import fit
from hw_model.rtl.board import Board
from hw_model.rtl.comparison import compare
from hw_model.rtl.cosimulation import ANSWER_COUNTS
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
from tests.support.planted_faults import Fault

EXAMPLES = Path(__file__).parents[2] / "examples"
SMALL = replace(benches.SIZES, join=0, one_port=1, phase_words=8)
"""A core with the peculiarities of the smallest device. Other sizes grow where a bench needs more."""
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
    Fault("a mark is written a cycle late", "transpose.sv", "ONE_PORT != 0 ? marked || sweep : write_back", "write_back"),
    Fault("marks are not written", "transpose.sv", "ONE_PORT != 0 ? marked || sweep :", "ONE_PORT != 0 ? sweep :"),
    Fault("the buffer is not swept", "transpose.sv", "ONE_PORT != 0 ? marked || sweep :", "ONE_PORT != 0 ? marked :"),
    Fault("the word of the mark before", "transpose.sv", "ONE_PORT != 0 ? written : write_word", "write_word"),
    Fault("a mark takes two cycles", "transpose.sv", "!(ONE_PORT != 0 && write) && (marking", "!write_back && (marking"),
    Fault("entries are where families would be", "update.sv", "JOIN_FIELDS = JOIN != 0 ? 2 + PARENT : 0;", "JOIN_FIELDS = 2 + PARENT;"),
    Fault("all phases are the first", "locsnn_core.sv", "PHASE_WORD'({phase, field[2:0]})", "PHASE_WORD'(field[2:0])"),
    Fault("phases have half their words", "locsnn_core.sv", "$clog2(PHASE_WORDS);", "$clog2(PHASE_WORDS) - 1;"),
]  # fmt: skip


def test_every_fault_fits():
    for fault in FAULTS:
        assert fault.fits(sources()), fault.name


@pytest.mark.minutes
@NEEDS_ICARUS
def test_a_small_core_passes_every_bench():
    assert not differ(sources(), SMALL)


@NEEDS_ICARUS
def test_a_core_that_shares_places_sweeps_as_many_as_the_device_has():
    """A core of few places sweeps them in fewer cycles, so a small program must not be simulated on one."""
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
    """Parents are numbered for the device's sums, so a simulated core with fewer would be refused."""
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
    """A report must not say that a program fits whose words turn out to be too wide when they are made."""
    b = hw.ProgramBuilder(hw.chip("ecp5-25f"), name="slow")
    x = b.add_input("x", 2)
    y = b.add_compartments("y", 2, threshold=1, decay_v=400)
    b.connect(x, y, [[20, 4], [6, 2]])
    b.read_out(y)
    program = b.build()
    assert on_core(program, 10, program.chip)
    # A weight of the readout has 32 bits.
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
    # 900 rows of 40 channels take more words than the buffer of the device has.
    b.connect(x, y, np.full((3, 900), 20) * (np.arange(900) % 3 == 0))
    program = hybrids.program_of_graphs(
        chip,
        Readout(("location/y",), (1.0,)),
        hybrids.graph_in_phase(b.graph(), "location", 40, np.arange(40)),
    )
    spikes = np.ones((1, 900, 40), np.uint8)
    for play in (
        lambda: hw.cosimulate(program, spikes),
        lambda: stream(program, spikes, "sim:icarus", baud=115200, report=False),
    ):
        with pytest.raises(
            hw.TargetError, match=r"the open core of ecp5-25f is too small in 'bitmap'"
        ):
            play()


@pytest.mark.minutes
@NEEDS_ICARUS
@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_faults_of_a_small_core_are_found(fault):
    assert differ(fault.planted_in(sources()), SMALL)


def program_of(model: str, strategy: str = "reset", chip: hw.Chip = DEVICE) -> hw.ChipProgram:
    """Return the program of a network that ships, with weights of 8 bits."""
    return lower(load(EXAMPLES / f"models/{model}.pt"), chip, 8, strategy).program


LARGER_DEVICES = "Use the device ecp5-25f, ecp5-85f or locsnn-130nm."
TOO_SMALL = "the open core of ice40up5k is too small in"


class Refused(NamedTuple):
    """A network that does not fit the smallest device with a strategy, and the whole message."""

    model: str
    strategy: str
    message: str


REFUSED = [
    Refused(
        "objects-hybrid",
        "dendrite",
        f"program 'objects-hybrid': {TOO_SMALL} 'axons' (736 against 512). {LARGER_DEVICES}",
    ),
    Refused(
        "objects-hybrid-loihi",
        "native",
        f"program 'objects-hybrid-loihi': {TOO_SMALL} 'axons' (736 against 512). {LARGER_DEVICES}",
    ),
    Refused(
        "containers-hybrid",
        "dendrite",
        f"program 'containers-hybrid': {TOO_SMALL} 'axons' (715 against 512). {LARGER_DEVICES}",
    ),
    Refused(
        "two-fingertips",
        "reset",
        "synapses 'touch_transposed' -> 'location_hidden': a delay is out of range (4 against 0..0 steps; 1136 of 1136 delays outside). "
        "Relay the spike through 4 compartments, or shorten the delay.",
    ),
    Refused(
        "objects-hybrid",
        "delay-line",
        "population 'time_hidden': 1 delayed synapse cannot hold a kernel of tau_ref 1 "
        "(an error of 13 against 0.1; ice40up5k has delay_max 0). Use strategy reset.",
    ),
    Refused(
        "containers-best",
        "reset",
        "population 'location_output_1': 615 input axons of neuron 0 do not fit one core (ice40up5k holds 512). "
        "Prune 103 of its sources, or gather them in a population in between; a location branch has one per step.",
    ),
]


@pytest.mark.parametrize(
    ("model", "strategy", "message"),
    REFUSED,
    ids=[f"{row.model}-{row.strategy}" for row in REFUSED],
)
def test_what_the_smallest_device_does_not_hold_is_refused_by_name(model, strategy, message):
    with pytest.raises(hw.TargetError) as caught:
        program_of(model, strategy)
    assert str(caught.value) == message


def joined() -> hw.ChipProgram:
    """Return a program of a compartment that another one is joined to."""
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
    assert (
        str(caught.value)
        == f"program 'joined': {TOO_SMALL} 'join' (25 against 0). {LARGER_DEVICES}"
    )


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
    # Enough to know that all registers of all steps were compared.
    assert comparison["compared_values"] > 50_000 * len(recordings)
    faulty = FAULTS[0].planted_in(sources())
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
        # A board does not say how its memories are built.
        assert asdict(board.sizes) == asdict(DEVICE.open_core) | {"one_port": 0}
        board.load(core)
        answer = board.play(core, recordings[0])
    assert answer.error == 0
    assert answer.winner == int(np.ravel(expected.prediction)[0])
    assert answer.counts == tuple(expected.per_recording[0][name] for name in ANSWER_COUNTS)
