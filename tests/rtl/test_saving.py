"""The core as a chip has it: clocks that stop, charges that come early, states that are read where they matter."""

from __future__ import annotations

import re
import shutil

import pytest
from test_benches import STOPPING, differ

from hw_model.rtl.simulators import sources

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"),
]
FAULTS = [
    ("a state is not read where it matters", "at_rest.sv", "unknown || known[0]", "1'b0"),
    ("the first of a sweep is taken for known", "at_rest.sv", "issue && (!issued ||", "issue && (1'b0 ||"),
    ("the second of a sweep finds the word before", "at_rest.sv", "(unknown1 && number[2:0] == 0)", "1'b0"),
    ("the next word is read a compartment late", "at_rest.sv", "issue && number[2:0] == 7)),", "issue && number[2:0] == 0)),"),
    ("the last word of a sweep is not written", "at_rest.sv", "(last || done_number", "(1'b0 || done_number"),
    ("only the last of eight is remembered", "at_rest.sv", "if (done) gathered <= complete;", "gathered <= 0;"),
    ("a current that is left counts as rest", "update.sv", "some2 <= some1 && !first1;", "some2 <= 0;"),
    ("the first step finds what an earlier recording left", "update.sv", "some2 <= some1 && !first1;", "some2 <= some1;"),
    ("blocked compartments are forgotten", "update.sv", "new_state8[53:48] != 0 || (lasting8", "1'b0 || (lasting8"),
    ("what lasts is forgotten", "update.sv", "keep_u1 != 0 || keep_v1 != 0", "keep_u1 != 0"),
    ("what was not read leaks", "update.sv", "leaks4 || LAZY == 0 ? leak_u4", "1'b1 ? leak_u4"),
    ("a clock stops too early", "update.sv", ".enable(leaks2 || leaks3)", ".enable(leaks2)"),
    ("a clock stops while a tally comes", "readout.sv", "early_read || early7 ||", "early_read ||"),
    ("a clock stops before the buffer knows its row", "transpose.sv", "mark_tick || row_began ||", "mark_tick ||"),
    ("a clock stops while a word is marked", "transpose.sv", "mark || counted || marked ||", "mark ||"),
    ("a clock stops while nobody takes the words of the buffer", "transpose.sv", "row_began || out_ready", "row_began"),
    ("a clock stops after an event", "event_input.sv", "clear || accepted || mark || mark_tick ||", "clear || accepted ||"),
    ("a clock stops in silent steps", "event_input.sv", "|| out_ready || (tail && free)", "|| out_ready"),
    ("the word of an early memory is a cycle late", "accumulator.sv", "EARLY != 0 ? stored : kept2", "kept2"),
    ("an early memory is asked too early", "accumulator.sv", "EARLY != 0 ? address1 : address", "address"),
]  # fmt: skip


@pytest.fixture(autouse=True)
def _cache_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def saving() -> dict[str, str]:
    """Return the SystemVerilog by file, as a chip has it."""
    core, found = re.subn(r"(parameter integer (?:EARLY|LAZY) = )0", r"\g<1>1", sources()["locsnn_core.sv"])
    assert found == 2
    return {**sources(), "locsnn_core.sv": core, "clock_gate.sv": STOPPING}


def test_a_core_that_saves_passes_every_bench():
    assert not differ(saving())


@pytest.mark.parametrize(("file", "old", "new"), [row[1:] for row in FAULTS], ids=[row[0] for row in FAULTS])
def test_faults_of_what_saves_are_found(file, old, new):
    texts = saving()
    assert texts[file].count(old) == 1
    assert differ({**texts, file: texts[file].replace(old, new)})
