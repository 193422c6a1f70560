"""``locsnn diff`` notices every difference between two programs, even if all other figures are equal.

The second program is a copy of the first with one edit in one kind of entry or array. The edits mostly exchange two
values, so that sums and extremes stay as they are, and only the checksum of this part can show a difference.
"""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """The folder of a build of a shipped network."""
    folder = tmp_path_factory.mktemp("builds") / "out"
    recordings = ROOT / "examples/recordings/touches.npz"
    arguments = [
        ROOT / "examples/models/objects-hybrid.pt",
        "--events",
        recordings,
        "-o",
        folder,
        "--strategy",
        "delay-line",
        "--quiet",
    ]
    assert compile_main([str(a) for a in arguments]) == 0
    return folder


def swapped(values):
    """Return values with the first one exchanged for the first that differs from it."""
    values = np.array(values)
    first_other = np.flatnonzero(values != values[0])[0]
    values[[0, first_other]] = values[[first_other, 0]]
    return values


def of_core(program, **changes):
    """Return a program with other values in its first core."""
    return replace(program, cores=(replace(program.cores[0], **changes), *program.cores[1:]))


def of_axons(program, *names, **changes):
    """Return a program with other axons in its first core: two values of the arrays ``names`` are exchanged."""
    axons = program.cores[0].axons
    return of_core(
        program,
        axons=replace(axons, **{name: swapped(getattr(axons, name)) for name in names}, **changes),
    )


def of_input(program, **changes):
    """Return a program with changes in its second input, that of the location branch."""
    return replace(program, inputs=(program.inputs[0], replace(program.inputs[1], **changes)))


def of_phase(program, **changes):
    """Return a program with changes in its first phase."""
    return replace(program, phases=(replace(program.phases[0], **changes), program.phases[1]))


def of_route(program, name):
    """Return a program in which two values of an array of its first input's route are exchanged."""
    first, *others = program.input_routes
    return replace(
        program, input_routes=(replace(first, **{name: swapped(getattr(first, name))}), *others)
    )


def of_readout(program, **changes):
    """Return a program with changes in its readout."""
    return replace(program, readout=replace(program.readout, **changes))


def of_profiles(program, **changes):
    """Return a program with changes in the first compartment profile of its first core."""
    first, *others = program.cores[0].profiles
    return of_core(program, profiles=(replace(first, **changes), *others))


def of_format(program, **changes):
    """Return a program with changes in the first synapse format of its first core."""
    first, *others = program.cores[0].axons.formats
    return of_axons(program, formats=(replace(first, **changes), *others))


def of_chip(program, before, after):
    """Return a program whose chip file has ``after`` in place of ``before``."""
    text = program.chip.document.replace(before, after)
    assert text != program.chip.document
    return replace(program, chip=replace(program.chip, document=text))


def regrouped(program):
    """Return a program in which the first two groups of a core exchanged their names; both have 32 compartments."""
    first, second, *others = program.cores[0].slices
    return of_core(
        program,
        slices=(replace(first, group=second.group), replace(second, group=first.group), *others),
    )


# For each edit: the part of the program whose checksum must differ, and the function that edits a program. The core has
# 136 compartments, the input 78 lines, and the recording 250 steps.
EDITS = {
    "location walk": ("inputs.positions", lambda p: of_input(p, positions=swapped(p.inputs[1].positions))),
    "first lines": ("inputs.first_lines", lambda p: of_input(p, first_lines=np.eye(1, 78, dtype=int)[0])),
    "stream": ("inputs", lambda p: of_input(p, stream="other")),
    "lines": ("inputs.line", lambda p: of_route(p, "line")),
    "axons of lines": ("inputs.axon", lambda p: of_route(p, "axon")),
    "readout's weight": ("readout", lambda p: of_readout(p, weights=(1.0, 2.0))),
    "readout's population": ("readout", lambda p: of_readout(p, populations=("time_output/dendrite", "location_output"))),
    "readout's order": ("readout", lambda p: of_readout(p, populations=p.readout.populations[::-1])),
    "readout by potential": ("readout_potentials_from", lambda p: of_readout(p, potentials_from=3)),
    "readout from a later step": ("readout_potentials_from", lambda p: of_readout(p, potentials_from=(3, None))),
    "no readout": ("readout", lambda p: replace(p, readout=None)),
    "steps": ("phases", lambda p: of_phase(p, steps=249)),
    "any steps": ("phases", lambda p: of_phase(p, steps=None)),
    "first touch": ("phases", lambda p: of_phase(p, align_events=2)),
    "seconds": ("step_seconds", lambda p: replace(p, step_seconds=0.01)),
    "events of a bin": ("event_threshold", lambda p: replace(p, event_threshold=1)),
    "psi": ("psi", lambda p: replace(p, psi=3.0)),
    "polarities": ("polarities", lambda p: replace(p, polarities=2)),
    "names of classes": ("class_names", lambda p: replace(p, class_names=("press", "slide"))),
    "columns": ("columns", lambda p: replace(p, columns=3)),
    "register": ("chip", lambda p: of_chip(p, "current_bits: 23", "current_bits: 22")),
    "energy": ("chip", lambda p: of_chip(p, "clock_ghz: 1.0", "clock_ghz: 1.5")),
    "slot": ("cores.slot", lambda p: of_core(p, slot=5)),
    "vmin": ("cores.vmin", lambda p: of_core(p, vmin=p.cores[0].vmin + 1)),
    "vmax": ("cores.vmax", lambda p: of_core(p, vmax=p.cores[0].vmax - 1)),
    "groups": ("cores.slices", regrouped),
    "decays of profiles": ("cores.compartment_profiles", lambda p: of_profiles(p, decay_v=391)),
    "refractory period": ("cores.compartment_profiles", lambda p: of_profiles(p, refractory=2)),
    "joined": ("cores.compartment_profiles", lambda p: of_profiles(p, joined=0)),
    "profiles": ("cores.profile", lambda p: of_core(p, profile=swapped(p.cores[0].profile))),
    "threshold": ("cores.threshold_mantissas", lambda p: of_core(p, thresholds=p.cores[0].thresholds[::-1])),
    "thresholds": ("cores.threshold", lambda p: of_core(p, threshold=swapped(p.cores[0].threshold))),
    "bias": ("cores.bias_mantissa", lambda p: of_core(p, bias_mantissa=np.eye(1, 136, dtype=int)[0])),
    "exponent of a bias": ("cores.bias_exponent", lambda p: of_core(p, bias_exponent=np.eye(1, 136, dtype=int)[0])),
    "parents": ("cores.parent", lambda p: of_core(p, parent=swapped(p.cores[0].parent))),
    "weights": ("cores.mantissa", lambda p: of_axons(p, "mantissa")),
    "targets": ("cores.target", lambda p: of_axons(p, "target")),
    "delays": ("cores.delay", lambda p: of_axons(p, "delay")),
    "formats of synapses": ("cores.format_index", lambda p: of_axons(p, "format_index")),
    "exponent of a format": ("cores.synapse_formats", lambda p: of_format(p, exponent=1)),
    "words": ("cores.synapse_words", lambda p: of_axons(p, synapse_words=p.cores[0].axons.synapse_words - 1)),
    "lists": ("cores.list_start", lambda p: of_axons(p, list_start=np.sort([*p.cores[0].axons.list_start[:-2], *[p.cores[0].axons.list_start[-1]] * 2]))),
    "senders": ("cores.out_compartment", lambda p: of_axons(p, "out_compartment")),
    "destinations": ("cores.out_axon", lambda p: of_axons(p, "out_axon")),
}  # fmt: skip


def differences(build, tmp_path, edit, capsys):
    """Return the output of diff, as text and as JSON, for a build and a copy with an edited program."""
    shutil.copytree(build, tmp_path / "out")
    edit(hw.load_program(build)).save(tmp_path / "out")
    assert main(["diff", str(build), str(tmp_path / "out")]) == 0
    text = capsys.readouterr().out
    assert main(["diff", str(build), str(tmp_path / "out"), "--json"]) == 0
    return text, json.loads(capsys.readouterr().out)


@pytest.mark.slow
@pytest.mark.parametrize("name", EDITS)
def test_every_edit_of_a_program_is_noticed(name, build, tmp_path, capsys):
    part, edit = EDITS[name]
    text, changed = differences(build, tmp_path, edit, capsys)
    assert f"program.contents.{part}" in changed
    assert "The builds are equal" not in text
    if all(key.startswith("program.contents.") for key in changed):
        *parts, last_part = [key.removeprefix("program.contents.") for key in changed]
        listed = f"{', '.join(parts)} and {last_part}" if parts else last_part
        assert text == f"All figures are equal, but not the programs: they differ in {listed}.\n"


@pytest.mark.slow
def test_where_figures_of_reports_differ_as_well_the_summary_says_so(build, tmp_path, capsys):
    shutil.copytree(build, tmp_path / "out")
    _, exchange_weights = EDITS["weights"]
    exchange_weights(hw.load_program(build)).save(tmp_path / "out")
    report = json.loads((build / "report.json").read_text())
    report["energy"]["per_sample_pj"] += 1.0
    (tmp_path / "out/report.json").write_text(json.dumps(report))
    assert main(["diff", str(build), str(tmp_path / "out")]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert (
        "The programs differ, but not in their sums and extremes. They differ in cores.mantissa."
        in text
    )


@pytest.mark.parametrize(
    "edit",
    [
        lambda p: p,
        lambda p: replace(p, name="another", provenance={"tool": "another", "date": "today"}),
        lambda p: of_chip(p, "registers:", "# a remark\nregisters:"),
    ],
    ids=["written again", "provenance", "remarks in the chip file"],
)
def test_the_origin_of_a_program_is_no_difference(edit, build, tmp_path, capsys):
    assert differences(build, tmp_path, edit, capsys) == ("The builds are equal.\n", {})
