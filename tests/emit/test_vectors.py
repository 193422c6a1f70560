"""Vectors, read back by a bench that knows the manifest and the files alone, and equal to the simulator."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.backends.played import play_recording
from locsnn_compile.backends.vectors.synapse_image import synapse_image
from locsnn_compile.backends.vectors.vectors import vectors_files
from locsnn_compile.errors import InputError
from tests.support import emitted_bench as bench
from tests.support.emitted_programs import CHIP, everything, played_streams, two_phases

EXAMPLES = Path(__file__).parents[2] / "examples" / "models"


def written(played, folder):
    for name, content in vectors_files(played).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    return bench.Vectors(folder / "vectors")


def dense():
    """Return a program whose lists are dense, of more than a run, and with delays."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 3)
    h = b.add_compartments("h", 150, decay_u=1024, decay_v=128, threshold=300)
    r = np.random.default_rng(0)
    weights = r.integers(-128, 128, (150, 3)) * 2
    weights[weights == 0] = 2
    b.connect(x, h, weights, delay=r.integers(0, 63, (150, 3)))
    return b.build()


def shared_formats():
    """Return a program of 21 formats, three exponents by seven delay fields, that come to share the 16 of a core."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 3)
    h = b.add_compartments("h", 20, decay_u=1024, decay_v=128, threshold=300)
    r = np.random.default_rng(0)
    for exponent in (-1, 0, 2):
        for delay in (0, 1, 3, 7, 15, 31, 62):
            b.connect(x, h, 2 * r.integers(-128, 128, (20, 3)), exponent=exponent, delay=delay)
    program = b.build()
    assert [len(core.axons.formats) for core in program.cores] == [16]
    return program


def taps():
    """Return a program of neurons with several synapses of one format to themselves, of as many delays."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 3)
    h = b.add_compartments("h", 20, decay_u=1024, decay_v=128, threshold=300)
    b.connect(x, h, np.full((20, 3), 254), exponent=2)
    for delay in (16, 17, 19, 23, 31, 16):
        b.connect(h, h, -10 * np.eye(20, dtype=np.int64), delay=delay)
    return b.build()


def lists_of_several_projections():
    """Return a program whose axons have one sparse format in several projections, onto one population and onto two."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 3)
    h = b.add_compartments("h", 30, decay_u=1024, decay_v=128, threshold=300)
    o = b.add_compartments("o", 9, threshold=300)
    below = np.arange(30)[:, None] < [15, 10, 29]
    b.connect(x, h, np.where(below, 20, 0), exponent=2)
    b.connect(x, o, np.arange(27).reshape(9, 3) * 2, exponent=2)
    b.connect(x, h, np.where(below, 0, 42), exponent=2)
    b.connect(x, h, np.full((30, 3), 2))
    b.connect(x, o, np.full((9, 3), 2))
    b.connect(x, h, np.full((30, 3), 4))
    return b.build()


PROGRAMS = {
    "everything, several cores": everything,
    "everything, one core": lambda: everything(seed=1, chip=CHIP),
    "dense": dense,
    "shared formats": shared_formats,
    "taps": taps,
    "lists of several projections": lists_of_several_projections,
}


@pytest.fixture(params=PROGRAMS.values(), ids=PROGRAMS.keys(), scope="module")
def case(request, tmp_path_factory):
    program = request.param()
    played = play_recording(program, played_streams(program))
    return played, written(played, tmp_path_factory.mktemp("vectors"))


def test_expected_values_are_the_simulators(case):
    played, vectors = case
    for core, entry in zip(played.program.cores, vectors.manifest["cores"], strict=True):
        columns = [
            (kind, np.array([row[i] for row in bench.expected(vectors, entry)]))
            for i, kind in ((1, "u"), (2, "v"))
        ]
        for kind, found in columns:
            of_group = getattr(played.result, kind)
            for piece in core.slices:
                mine = found[:, piece.offset : piece.offset + piece.size]
                assert np.array_equal(mine, of_group[piece.group][:, piece.start : piece.stop]), (
                    kind
                )


def test_each_core_alone_gives_what_is_expected(case):
    played, vectors = case
    for entry in vectors.manifest["cores"]:
        assert bench.run_core(vectors, entry) == bench.expected(vectors, entry)
    assert played.result.counts.spikes > 20


def test_all_cores_together_give_what_is_expected(case):
    _, vectors = case
    for phase in vectors.manifest["phases"]:
        entries = [entry for entry in vectors.manifest["cores"] if entry["phase"] == phase["name"]]
        found = bench.run_cores(vectors, entries)
        assert found == {entry["number"]: bench.expected(vectors, entry) for entry in entries}


@pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed")
def test_each_core_gives_what_is_expected_in_verilog(case, tmp_path):
    _, vectors = case
    for entry in vectors.manifest["cores"]:
        sizes = {name.upper(): file["rows"] for name, file in entry["files"].items()}
        parameters = {
            name: sizes[name]
            for name in ("LISTS", "FORMATS", "PROFILES", "THRESHOLDS", "COMPARTMENTS")
        }
        parameters |= {
            "WORDS": sizes["SYNAPSES"],
            "AXONS": entry["input_axons"],
            "STEPS": entry["steps"],
        }
        parameters |= {"VMIN": entry["vmin"], "VMAX": entry["vmax"]}
        given = [f"-Pcore_bench.{name}={value}" for name, value in parameters.items()]
        built = tmp_path / f"core{entry['number']}"
        source = Path(__file__).with_name("core_bench.v")
        subprocess.run(
            ["iverilog", "-g2012", "-Wall", *given, "-o", built, source], check=True, timeout=60
        )
        call = ["vvp", "-n", built, f"+folder={vectors.folder}/core{entry['number']}"]
        done = subprocess.run(call, capture_output=True, text=True, check=True, timeout=60)
        values = 3 * entry["steps"] * entry["compartments"]
        assert (done.stdout, done.stderr) == (f"0 of {values} values differ\n", "")


def test_memory_takes_the_words_that_placement_counted(case):
    played, vectors = case
    for core, entry in zip(played.program.cores, vectors.manifest["cores"], strict=True):
        assert len(vectors.words(entry["files"]["synapses"])) == core.axons.synapse_words


@pytest.mark.parametrize(
    ("strategy", "words"), [("dendrite", [1313, 3114]), ("delay-line", [1783, 3540])]
)
def test_a_networks_report_and_image_agree(strategy, words):
    """Own spikes come back by many synapses onto one compartment: a list of them is one list, in placement too."""
    compiled = lc.compile(
        lc.load(EXAMPLES / "objects-hybrid.pt"), strategy=strategy, diagnosis=False
    )
    cores, chip = compiled.program.cores, compiled.program.chip
    assert [len(synapse_image(core, chip).words) for core in cores] == words
    assert compiled.report["resources"]["synapse_bits"] == 64 * sum(words)


@pytest.mark.parametrize("seed", range(12))
def test_a_full_core_holds_its_image(seed):
    """Formats drawn again and again from the same sources, dense and sparse, onto populations that share cores."""
    r = np.random.default_rng(seed)
    limit = int(r.integers(120, 250))
    memory = replace(CHIP.synapse_memory, run_length=int(r.integers(1, 65)))
    chip = replace(
        CHIP, limits=replace(CHIP.limits, synapse_words_per_core=limit), synapse_memory=memory
    )
    b = hw.ProgramBuilder(chip)
    x = b.add_input("x", 3)
    groups = [b.add_compartments(name, 40, threshold=20) for name in ("h", "o")]
    for source, target in [(x, groups[0]), (x, groups[1]), (groups[0], groups[0])]:
        for _ in range(3):
            kept = r.random((target.size, source.size)) < r.choice(
                [0.05, 0.3, 1.0 if source is x else 0.05]
            )
            b.connect(
                source,
                target,
                2 * kept,
                delay=kept * r.integers(0, 2, kept.shape) * r.integers(0, 63),
            )
    cores = b.build().cores
    used = [len(synapse_image(core, chip).words) for core in cores]
    assert used == [core.axons.synapse_words for core in cores]
    assert max(used) <= limit


def test_a_program_that_counted_other_words():
    (core,) = taps().cores
    with pytest.raises(InputError) as caught:
        synapse_image(replace(core, axons=replace(core.axons, synapse_words=1)), CHIP)
    assert str(caught.value) == (
        "core 0: its synapse lists take a different number of words than the program says (69 against 1). Compile the program again."
    )


def test_wraps_and_clips_are_in_what_was_compared():
    counts = hw.simulate(everything(), played_streams(everything())).counts
    assert (
        min(
            counts.charge_wraps,
            counts.current_wraps,
            counts.voltage_clips,
            counts.hops_x,
            counts.hops_y,
        )
        > 0
    )


def test_files_of_a_tiny_program():
    """One line, one compartment: written out by hand."""
    b = hw.ProgramBuilder(CHIP, name="tiny")
    x = b.add_input("x", 1)
    h = b.add_compartments("h", 1, decay_u=4096, decay_v=0, threshold=15, refractory=2)
    b.connect(x, h, [[20]])
    files = vectors_files(play_recording(b.build(), [[1], [1], [0]], "recording 7"))
    texts = {
        name.removeprefix("vectors/core0/"): content.decode() for name, content in files.items()
    }
    assert {name: text for name, text in texts.items() if "/" not in name} == {
        "axons.hex": "00008000\n",  # first list 0, one list
        "lists.hex": "0000008000\n",  # word 0, one word, base 0
        "synapses.hex": "0000000000002800\n",  # format 0, one synapse, weight 20 / 2 from bit 10 on
        "formats.hex": "00008\n",  # 8 bits, mixed
        "profiles.hex": "008001000\n",  # decay_u 4096, refractory 2
        "thresholds.hex": "0000f\n",
        "compartments.hex": "000000000\n",
        "output_axons.hex": "",
        "input_spikes.hex": "1\n1\n0\n",
        "axon_spikes.hex": "1\n1\n0\n",
        "spikes.hex": "0\n1\n0\n",
        "u.hex": "000000\n000500\n000500\n",
        "v.hex": "000000\n000000\n000000\n",
    }
    manifest = yaml.safe_load(files["vectors/manifest.yaml"])
    assert (manifest["program"], manifest["recording"], manifest["version"]) == (
        "tiny",
        "recording 7",
        1,
    )
    assert set(files) == {
        f"vectors/{entry['file']}" for core in manifest["cores"] for entry in core["files"].values()
    } | {"vectors/manifest.yaml", "vectors/README.md"}


LOCATION = ("location", 0, 4)


@pytest.mark.parametrize(
    ("events", "phases"),
    [
        pytest.param(
            [(0, 1), (3, 0), (3, 2), (5, 1), (9, 3)],
            [("time", 3, 5), LOCATION],
            id="ends after its steps",
        ),
        pytest.param(
            [(9, 0), (9, 3), (10, 1)], [("time", 9, 3), LOCATION], id="ends with the recording"
        ),
        pytest.param([(9, 0)], [("time", 12, 0), LOCATION], id="never starts"),
    ],
)
def test_only_steps_that_run_are_written(events, phases, tmp_path):
    """With a bias, any bench would find other registers in steps before the first touch, in which the chip is at rest."""
    recording = np.zeros((12, 4), dtype=np.uint8)
    recording[tuple(zip(*events, strict=True))] = 1
    vectors = written(play_recording(two_phases(align_events=2, bias=700), recording), tmp_path)
    assert [(p["name"], p["first_step"], p["steps"]) for p in vectors.manifest["phases"]] == phases
    for entry, (_, _, steps) in zip(vectors.manifest["cores"], phases, strict=True):
        assert bench.run_core(vectors, entry) == bench.expected(vectors, entry)
        assert [
            len(vectors.rows(entry["files"][name])) for name in ("axon_spikes", "spikes", "u")
        ] == [steps] * 3


def test_a_recording_that_would_fill_a_disk(monkeypatch):
    monkeypatch.setattr("locsnn_compile.backends.vectors.vectors.MAX_BYTES", 1000)
    program = everything()
    with pytest.raises(InputError) as caught:
        vectors_files(play_recording(program, played_streams(program)))
    assert str(caught.value) == (
        "--emit vectors: u and v of every compartment and step would be too much (9520 bytes against 1000). "
        "Emit a shorter recording."
    )


def test_a_chip_whose_runs_have_no_room_for_a_header():
    chip = replace(CHIP, synapse_memory=replace(CHIP.synapse_memory, run_header_bits=8))
    program = everything(chip=chip)
    with pytest.raises(InputError) as caught:
        vectors_files(play_recording(program, played_streams(program)))
    assert str(caught.value) == (
        "chip loihi-sim: the header of a run has no room for a format and a length (run_header_bits 8 against 10). "
        "Leave out --emit vectors."
    )


def test_a_core_that_nothing_reaches_has_a_row_of_spikes_for_each_step():
    b = hw.ProgramBuilder(CHIP)
    b.connect(b.add_input("x", 1), b.add_compartments("h", 2, threshold=1), [[0], [0]])
    files = vectors_files(play_recording(b.build(), [[1], [0], [1]]))
    assert files["vectors/core0/axon_spikes.hex"] == b"0\n0\n0\n"
