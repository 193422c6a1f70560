"""The energy of the core in 130 nm cells, as docs/research/energy-130nm computes it.

Figures of macros are compared with the liberty files of the process, the profile with energies at
gate level, and accesses estimated from counts with accesses that were counted. Tests that need
files outside of the repository are skipped without them.
"""

from __future__ import annotations

import csv
import re
import zipfile
from collections import defaultdict
from pathlib import Path

import liberty
import make_profile
import numpy as np
import packing
import page_text
import pytest
import runs
import sums

import hw_model as hw
from hw_model.errors import InputError, TargetError
from hw_model.rtl.device import on_core
from hw_model.rtl.images import CoreProgram
from hw_model.rtl.memory_needs import arrays_of
from locsnn_compile.report.figures.energy import rows_left_out

NEEDS_LIBRARY = pytest.mark.skipif(
    not (runs.LIBRARY / runs.CELLS).is_file(),
    reason="the liberty files are not next to the repository",
)
NEEDS_RECORDINGS = pytest.mark.skipif(
    not runs.RECORDINGS.is_dir(), reason="the real recordings are not next to the repository"
)


@NEEDS_LIBRARY
def test_macros_cost_what_their_files_say():
    macros = {
        (macro.ports, macro.words, macro.bits): macro
        for macro in liberty.macros(runs.LIBRARY / "sram")
    }
    # Rows of a table: ports, words, bits; square micrometres, picojoules to read and to write.
    table = re.findall(
        r"\| (\d)P (\d+) x (\d+) \| ([\d,]+) \| ([\d.]+) \| ([\d.]+) \|",
        (runs.LIBRARY / "README.md").read_text(),
    )
    assert len(table) == 16
    for ports, words, bits, *figures in table:
        macro = macros[int(ports), int(words), int(bits)]
        in_table = [float(figure.replace(",", "")) for figure in figures]
        # The table has one decimal, so it is off by 0.05 at most; the rest is for rounding of floats.
        figures_of_macro = [round(macro.area), macro.read_pj, macro.write_pj]
        assert figures_of_macro == pytest.approx(in_table, abs=0.051)


@NEEDS_LIBRARY
def test_the_chip_file_names_the_lines_of_its_figures():
    # Of each macro: its file, and the picojoules of a read and of a write with the lines of that file which have them.
    lines = re.findall(
        r"^#   (\S+\.lib): read (\S+) \(line (\d+)\), write (\S+) \(line (\d+)\)$",
        make_profile.CHIP.read_text(),
        re.M,
    )
    assert len(lines) > 5  # the pattern fits the comments of the chip file
    for name, *figures in lines:
        text = (runs.LIBRARY / "sram" / name).read_text().splitlines()
        for pj, line in zip(figures[::2], figures[1::2], strict=True):
            # A line where a group of internal power begins; its values are in one of the five lines after it.
            group = " ".join(text[int(line) - 1 : int(line) + 5])
            assert group.strip().startswith("internal_power")
            assert float(re.findall(r"values \(([\d.]+)\)", group)[0]) == float(pj)


def touch_recordings(count: int) -> np.ndarray:
    """Return the first touches of the examples, (count, steps, channels); files hold channels first."""
    spikes = np.load(runs.ROOT / "examples/recordings/touches.npz")["spikes"]
    return spikes[:count].transpose(0, 2, 1)


def rows_of_the_check() -> list[dict[str, str]]:
    """Return the rows of the study's comparison of the profile with gate level, a recording each."""
    with make_profile.CHECK.open() as file:
        return list(csv.DictReader(file))


def test_the_profile_is_within_5_percent_of_gate_level_on_recordings_it_was_not_fitted_to():
    rows = rows_of_the_check()
    for name in make_profile.SETS:
        relative_errors = [
            abs(float(row["profile, pJ"]) / float(row["gate level, pJ"]) - 1)
            for row in rows
            if row["set"] == name
        ]
        assert len(relative_errors) == make_profile.CHECKED_ON
        assert max(relative_errors) < 0.05


@NEEDS_RECORDINGS
@pytest.mark.parametrize("name", make_profile.SETS)
def test_the_energy_of_memories_computed_from_counts_is_that_of_gate_level(name):
    count = 3
    program = runs.compiled(make_profile.SETS[name])
    recordings = runs.real(name, "test", count)
    rows = [row for row in rows_of_the_check() if row["set"] == name]
    gate_level_pj = [float(row["memories at gate level, pJ"]) for row in rows[:count]]
    assert sums.memory_pj(program, recordings) == pytest.approx(gate_level_pj, rel=0.02)


WORDS_SWEPT = {"bitmap": 1024, "tallies": 72}
"""Words that are written when memories are set to 0 before a recording, which is not in the counts.
"""
RATIOS = {"synapses": (0.92, 1.0), "charges": (1.0, 1.1), "states": (1.7, 1.9)}
"""The least and the largest ratio of accesses estimated from counts to accesses that were counted,
as measured for this network. The estimates of all other memories are exact."""


def test_accesses_estimated_from_counts_are_near_those_counted():
    program = runs.compiled("objects-hybrid-loihi")
    touches = touch_recordings(2).astype(np.uint8)
    recordings = runs.stacked(program, touches)
    sizes = hw.chip("locsnn-130nm").open_core
    simulated = hw.simulate(program, recordings, probe=("spikes", "u", "v"))
    core = CoreProgram(program, recordings.shape[1], sizes=sizes)
    # Energies do not matter here: a macro of one bank that costs nothing, for every memory.
    any_macro = defaultdict(lambda: (1, 0.0, 0.0))
    compared = set()
    for i, counts in enumerate(simulated.per_recording):
        accesses = sums.accesses(core, recordings[i], simulated, i, any_macro)
        for array in arrays_of(core, sizes, counts):
            if array.name not in accesses:
                continue
            reads, writes = accesses[array.name]
            writes -= WORDS_SWEPT.get(array.name, 0)
            low, high = RATIOS.get(array.name, (1.0, 1.0))
            assert low * reads <= array.rows[1] <= high * reads, array.name
            assert low * writes <= array.writes <= high * writes, array.name
            compared.add(array.name)
    assert compared >= {
        "axons",
        "synapses",
        "charges",
        "states",
        "sums",
        "places",
        "tallies",
        "bitmap",
        "fires_own",
    }


# The program reads out two populations, with a weight each. The phases share the words of states, and each has 206 compartments.
@pytest.mark.parametrize(
    ("memory", "limit", "need"),
    [("weights", 1, 2), ("states", 200, 206)],
    ids=["weights", "states"],
)
def test_a_program_that_a_small_memory_does_not_hold_is_refused(tmp_path, memory, limit, need):
    program = runs.compiled("objects-hybrid-loihi")
    text = make_profile.CHIP.read_text()
    steps = 250  # of the network's recordings
    on_core(program, steps, hw.chip("locsnn-130nm"))
    small = tmp_path / "small.yaml"
    small.write_text(re.sub(rf"^  {memory}: \d+", f"  {memory}: {limit}", text, flags=re.M))
    with pytest.raises(TargetError) as caught:
        on_core(program, steps, hw.chip(small))
    assert str(caught.value).startswith(
        f"program {program.name!r}: the open core of locsnn-130nm is too small in {memory!r} ({need} against {limit})."
    )


def test_text_of_the_page_is_wrapped_and_tables_are_not():
    words = " ".join(["word"] * 60)
    row = "| " + "long " * 40 + "|"
    page = f"# {words}\n\n{words}\n{words}\n\n| a |\n{row}\n\n- {words}\n- {words}\n\n    {words}\n"
    head, paragraph, *others = page_text.wrapped(page).split("\n\n")
    unchanged = [f"# {words}", f"| a |\n{row}", f"- {words}\n- {words}", f"    {words}\n"]
    assert [head, *others] == unchanged
    assert max(map(len, paragraph.split("\n"))) <= page_text.WIDTH < len(words)
    assert paragraph.split() == f"{words} {words}".split()


def test_every_price_is_within_its_range():
    profile = hw.chip("locsnn-130nm").profile("ihp-sg13g2")
    assert set(profile.energy_pj) == set(profile.energy_pj_range) == set(profile.sources)
    for name, pj in profile.energy_pj.items():
        low, high = profile.energy_pj_range[name]
        assert 0 < low <= high == pj


def test_a_report_bounds_what_cleaning_takes_and_nothing_else_that_is_left_out():
    profile = hw.chip("locsnn-130nm").profile("ihp-sg13g2")
    rows = rows_left_out(hw.Counts(), profile, samples=3, static=None)
    cleaning = profile.not_included[0].bound_recording_pj
    assert 10_000 < cleaning < 1e6  # the order of magnitude, in picojoules
    assert [(row.what, row.at_most_pj, row.bound_source) for row in rows] == [
        ("cleaning of the memories", cleaning, "writes of macros at gate level"),
        ("transitions of gates before they settle (glitches)", None, None),
        ("pads, input and output, supply and clock generation", None, None),
    ]


def test_a_profile_of_a_core_in_cells_may_be_chosen_and_one_of_a_device_not():
    assert hw.priced_by(hw.chip("locsnn-130nm"), "ihp-sg13g2").default_profile == "ihp-sg13g2"
    with pytest.raises(InputError) as caught:
        hw.priced_by(hw.chip("ecp5-25f"), "ihp-sg13g2")
    assert (
        str(caught.value)
        == "profile 'ihp-sg13g2': ecp5-25f has cycles and no profiles. Leave the profile out."
    )


def test_real_recordings_are_read_class_by_class_in_turn(tmp_path, monkeypatch):
    with zipfile.ZipFile(tmp_path / "Ev-Some.zip", "w") as archive:
        for sample, label in ((0, 1), (1, 0), (2, 0), (3, 1)):
            with archive.open(f"Ev-Some/test/sample_{sample}_label_{label}.npy", "w") as file:
                np.save(file, np.full((2, 2, 3), sample, dtype=np.float32))
    monkeypatch.setattr(runs, "RECORDINGS", Path(tmp_path))
    recordings = runs.real("Some", "test", 3)
    assert recordings.shape == (3, 3, 4)
    # Each recording is filled with the number of its sample. Classes 0 and 1 take turns.
    assert recordings[:, 0, 0].tolist() == [1, 0, 2]


@NEEDS_LIBRARY
def test_dense_rows_hold_every_synapse_and_are_never_fewer_than_full_ones():
    program = runs.compiled("objects-hybrid-loihi")
    recordings = touch_recordings(2)
    core = CoreProgram(program, recordings.shape[1], sizes=runs.OURS.sizes)
    synapses_of_source = packing.dense(core, 1)
    assert synapses_of_source.tolist() == packing.full(core, 1).tolist()
    simulated = hw.simulate(program, recordings, probe=("spikes",))
    operations = []
    for i, recording in enumerate(recordings):
        spikes_of_source = sums.sent_by(core, recording, simulated, i)
        operations.append(spikes_of_source @ synapses_of_source)
    assert operations == [counts.synaptic_ops for counts in simulated.per_recording]
    for row in packing.ROWS:
        dense_rows = packing.dense(core, row)
        full_rows = packing.full(core, row)
        assert (full_rows <= dense_rows).all()
        assert (dense_rows <= synapses_of_source).all()
        assert (full_rows * row >= synapses_of_source).all()
