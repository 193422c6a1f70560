"""The core as a chip has it, with all that saves energy or memory there, plays every bench as the simulator does.

Clocks stop (clock_gate.sv), charges are added in one cycle (AT_ONCE), states are only accessed where they matter (LAZY), targets
are stored as steps (STEP), phases share places (PLACES), and parents share words of sums (SUMS). Planted faults must be found.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import replace

import pytest

from hw_model.rtl.simulators import sources
from tests.support import benches
from tests.support.benches import STOPPING_CLOCK_GATE, differ
from tests.support.marks import sampled
from tests.support.planted_faults import Fault

pytestmark = [
    pytest.mark.minutes,
    pytest.mark.usefixtures("cores_of_this_run"),
    pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"),
]
FAULTS = [
    Fault("a state is not read where it matters", "at_rest.sv", "unknown || bits[0]", "1'b0"),
    Fault("the first of a sweep is taken for known", "at_rest.sv", "first_of_sweep = issue && !issued1", "first_of_sweep = 1'b0"),
    Fault("the second of a sweep finds the word before", "at_rest.sv", "issue && unknown1 && place == 0", "1'b0"),
    Fault("the next word is read a compartment late", "at_rest.sv", "issue && place == LAST_IN_GROUP)),", "issue && place == 0)),"),
    Fault("the last word of a sweep is not written", "at_rest.sv", "(last || done_place", "(1'b0 || done_place"),
    Fault("only the last of eight is remembered", "at_rest.sv", "if (done) collected <= with_done;", "collected <= 0;"),
    Fault("a current that is left counts as rest", "update.sv", "nonzero2 <= nonzero1 && !first1;", "nonzero2 <= 0;"),
    Fault("the first step finds what an earlier recording left", "update.sv", "nonzero2 <= nonzero1 && !first1;", "nonzero2 <= nonzero1;"),
    Fault("blocked compartments are forgotten", "update.sv", "stays_blocked8 || (lasting8", "1'b0 || (lasting8"),
    Fault("what lasts is forgotten", "update.sv", "keep_u1 != 0 || keep_v1 != 0", "keep_u1 != 0"),
    Fault("what was not read leaks", "update.sv", "leaks4 || LAZY == 0 ? leak_u4", "1'b1 ? leak_u4"),
    Fault("how long it is blocked is read as a voltage", "update.sv", "needed1 && !nonzero1;", "1'b0;"),
    Fault("how long it is blocked is written nowhere", "update.sv", "LAZY != 0 && stays_blocked8 ?", "1'b0 ?"),
    Fault("blocked compartments are said to have something left", "update.sv", "valid8 && !stays_blocked8 && new_state8", "valid8 && new_state8"),
    Fault("a current of a blocked compartment counts as rest", "update.sv", "nonzero2 || (was_blocked2 && u2 != 0)", "nonzero2"),
    Fault("blocked compartments count as active", "update.sv", "(was_blocked2 && u2 != 0)", "was_blocked2"),
    Fault("the first step finds how long an earlier recording blocked", "update.sv", "was_blocked2 <= was_blocked1 && !first1;", "was_blocked2 <= was_blocked1;"),
    Fault("sums of families lie in one word", "update.sv", ".parent(parent8)", ".parent(PARENT'(0))"),
    Fault("sums are read by the high bits", "update.sv", "place3[PARENT-1:0]", "place3[PLACE-1-:PARENT]"),
    Fault("the sum of a family is not written", "join_sums.sv", "child && last", "child && 1'b0"),
    Fault("the child of another is taken for a sibling", "update.sv", "fire7[FIRE_FIELDS+:2] == 2'b01", "fire7[FIRE_FIELDS]"),
    Fault("numbers begin where the last sweep did", "update.sv", "if (issue && !issued[0]) begins", "if (clear) begins"),
    Fault("constants are read by the number of a gap", "update.sv", "issued[2] ? number3 + 1'b1 : begins", "issued[3] ? number3 + 1'b1 : begins"),
    Fault("a clock stops too early", "update.sv", ".enable(leaks2 || leaks3)", ".enable(leaks2)"),
    Fault("a clock stops while a tally comes", "readout.sv", "early_read || early7 ||", "early_read ||"),
    Fault("a clock stops while a word is marked", "transpose.sv", "mark || counted || marked ||", "mark ||"),
    Fault("a clock stops while nobody takes the words of the buffer", "transpose.sv", "row_began || out_ready", "row_began"),
    Fault("a clock stops after an event", "event_input.sv", "clear || accepted || mark || mark_tick ||", "clear || accepted ||"),
    Fault("a clock stops in silent steps", "event_input.sv", "|| out_ready || (tail && free)", "|| out_ready"),
    Fault("a clock stops while a charge comes", "update.sv", ".enable(live2 || live3 || clear)", ".enable(live3 || clear)"),
    Fault("a clock stops while a current goes", "update.sv", ".enable(live4 || live5 || clear)", ".enable(live4 || clear)"),
    Fault("a clock stops while children join", "update.sv", ".enable(has_children4 || joins5 || clear)", ".enable(joins5 || clear)"),
    Fault("a clock stops while joined voltages come", "update.sv", "live5 || joins5 || live6 || clear", "live5 || live6 || clear"),
    Fault("joined voltages are taken for 0", "update.sv", "<= {live5 || joins5, live6, live7}", "<= {live5, live6, live7}"),
    Fault("a bias is taken for 0", "update.sv", "leaks2 || charge != 0 || bias2 != 0", "leaks2 || charge != 0"),
    Fault("what is left is taken for 0", "update.sv", "leaks2 || charge != 0 || bias2 != 0", "charge != 0 || bias2 != 0"),
    Fault("a charge that is taken stays", "accumulator_at_once.sv", "(!take || stored != 0)", "!take"),
    Fault("what is added stays what it is", "accumulator_at_once.sv", "stored + addend", "addend"),
    Fault("charges are not swept", "accumulator_at_once.sv", "sweep || (valid &&", "(valid &&"),
    Fault("a charge is told a cycle early", "accumulator_at_once.sv", "taken <= taken1;", "taken <= stored;"),
    Fault("charges of the phase before stay", "locsnn_core.sv", "swept = (clear || sweeping) &&", "swept = clear &&"),
    Fault("every phase has places of its own", "locsnn_core.sv", "origin = PLACES != 0 ? number_begin[NUMBER-1:0] :", "origin = 1'b0 ? 0 :"),
    Fault("joined voltages are read by number", "update.sv", "place3 = PLACE'(number3 - origin)", "place3 = PLACE'(number3)"),
    Fault("states are written by number", "update.sv", "place8 = PLACE'(number8 - origin)", "place8 = PLACE'(number8)"),
    Fault("no synapse is one", "stepped.sv", "none ? {9'd0, 3'd7, delay, target} :", "1'b0 ? 0 :"),
    Fault("jumps go forward only", "stepped.sv", "$signed(value[8:3])", "{1'b0, value[7:3]}"),
    Fault("steps are one too long", "stepped.sv", "(ahead) - 1'b1", "(ahead)"),
    Fault("exponents stay", "stepped.sv", "none ? value[2:0] : known", "1'b0 ? value[2:0] : known"),
    Fault("lists begin where the last one ended", "stepped.sv", "first ? head : last", "last"),
    Fault("every word begins a list", "stepped.sv", "first ? head : last", "head"),
    Fault("heads come a word late", "delivery.sv", "if (first1) head2 <= head1;", "if (first2) head2 <= head1;"),
]  # fmt: skip
SIZES = replace(benches.SIZES, step=3, places=64, sums=8)
"""As locsnn-130nm has them, but for the places, of which the benches need fewer."""


def saving() -> dict[str, str]:
    """Return the SystemVerilog by file, with all that saves energy turned on."""
    core, replaced = re.subn(
        r"(parameter integer (?:AT_ONCE|LAZY) = )0", r"\g<1>1", sources()["locsnn_core.sv"]
    )
    assert replaced == 2  # both parameters
    return {**sources(), "locsnn_core.sv": core, "clock_gate.sv": STOPPING_CLOCK_GATE}


def test_a_core_that_saves_passes_every_bench():
    assert not differ(saving(), SIZES)


@pytest.mark.parametrize("sizes", [{"step": 2}, {"step": 8}, {"places": 64}, {"sums": 8}], ids=str)
def test_narrow_steps_and_places_change_nothing_alone(sizes):
    assert not differ(sources(), replace(benches.SIZES, **sizes))


@pytest.mark.parametrize("fault", sampled({fault.name: (fault,) for fault in FAULTS}))
def test_faults_of_what_saves_are_found(fault):
    faulty = fault.planted_in(saving())
    # In a core whose phases have places of their own, the first compartment of a phase may be in the middle of a group of
    # eight, which at_rest.sv treats in another way: some faults show only there.
    assert differ(faulty, SIZES) or differ(faulty)
