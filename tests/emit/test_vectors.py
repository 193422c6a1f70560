"""``--emit vectors``: a bench that knows only the manifest and the files computes what the simulator computes.

There are two such benches: one in Python (``tests/support/emitted_bench.py``) and one in Verilog (``core_bench.v``). Both
unpack the memory images, play the stimuli, and compare spikes, u and v of every step. The programs here use every kind of
synapse list, neuron and register event.
"""

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
    """Write the vectors of a played recording into a folder, and return them as the bench reads them."""
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
    # A weight of 0 would be no synapse, and the list not dense.
    weights[weights == 0] = 2
    b.connect(x, h, weights, delay=r.integers(0, 63, (150, 3)))
    return b.build()


def shared_formats():
    """Return a program with 21 kinds of synapses, which have to share the 16 formats of a core.

    They are three exponents by seven widths of delays.
    """
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
    """Return a program whose neurons have several synapses of one format onto themselves, with different delays."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 3)
    h = b.add_compartments("h", 20, decay_u=1024, decay_v=128, threshold=300)
    b.connect(x, h, np.full((20, 3), 254), exponent=2)
    for delay in (16, 17, 19, 23, 31, 16):
        b.connect(h, h, -10 * np.eye(20, dtype=np.int64), delay=delay)
    return b.build()


def lists_of_several_projections():
    """Return a program in which several projections of an axon share a sparse format, onto one population and onto two."""
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
    """A recording that was played to one of the programs, and its vectors."""
    program = request.param()
    played = play_recording(program, played_streams(program))
    return played, written(played, tmp_path_factory.mktemp("vectors"))


def test_expected_values_are_those_of_the_simulator(case):
    played, vectors = case
    for core, entry in zip(played.program.cores, vectors.manifest["cores"], strict=True):
        # A row is (spikes, u, v) of a step.
        rows = bench.expected(vectors, entry)
        registers = {
            "u": np.array([u for _, u, _ in rows]),
            "v": np.array([v for _, _, v in rows]),
        }
        for kind, values in registers.items():
            by_group = getattr(played.result, kind)
            for core_slice in core.slices:
                in_file = values[:, core_slice.offset : core_slice.offset + core_slice.size]
                simulated = by_group[core_slice.group][:, core_slice.start : core_slice.stop]
                assert np.array_equal(in_file, simulated), kind


def test_each_core_alone_computes_what_is_expected(case):
    played, vectors = case
    for entry in vectors.manifest["cores"]:
        assert bench.run_core(vectors, entry) == bench.expected(vectors, entry)
    # A silent program would prove little.
    assert played.result.counts.spikes > 20


def test_all_cores_together_compute_what_is_expected(case):
    _, vectors = case
    for phase in vectors.manifest["phases"]:
        entries = [entry for entry in vectors.manifest["cores"] if entry["phase"] == phase["name"]]
        computed = bench.run_cores(vectors, entries)
        assert computed == {entry["number"]: bench.expected(vectors, entry) for entry in entries}


@pytest.mark.skipif(shutil.which("iverilog") is None, reason="Icarus Verilog is not installed")
def test_each_core_computes_what_is_expected_in_verilog(case, tmp_path):
    _, vectors = case
    for entry in vectors.manifest["cores"]:
        rows = {name: file["rows"] for name, file in entry["files"].items()}
        parameters = {
            "AXONS": entry["input_axons"],
            "LISTS": rows["lists"],
            "WORDS": rows["synapses"],
            "FORMATS": rows["formats"],
            "PROFILES": rows["profiles"],
            "THRESHOLDS": rows["thresholds"],
            "COMPARTMENTS": rows["compartments"],
            "STEPS": entry["steps"],
            "VMIN": entry["vmin"],
            "VMAX": entry["vmax"],
        }
        options = [f"-Pcore_bench.{name}={value}" for name, value in parameters.items()]
        simulator = tmp_path / f"core{entry['number']}"
        source = Path(__file__).with_name("core_bench.v")
        subprocess.run(
            ["iverilog", "-g2012", "-Wall", *options, "-o", simulator, source],
            check=True,
            timeout=60,
        )
        completed = subprocess.run(
            ["vvp", "-n", simulator, f"+folder={vectors.folder}/core{entry['number']}"],
            capture_output=True,
            text=True,
            check=True,
            timeout=60,
        )
        # Spike, u and v of every compartment in every step.
        values = 3 * entry["steps"] * entry["compartments"]
        assert (completed.stdout, completed.stderr) == (f"0 of {values} values differ\n", "")


def test_memory_takes_the_words_that_placement_counted(case):
    played, vectors = case
    for core, entry in zip(played.program.cores, vectors.manifest["cores"], strict=True):
        assert len(vectors.words(entry["files"]["synapses"])) == core.axons.synapse_words


@pytest.mark.parametrize(
    ("strategy", "words"), [("dendrite", [1313, 3114]), ("delay-line", [1783, 3540])]
)
def test_the_report_and_the_memory_image_of_a_network_agree(strategy, words):
    """With these strategies, many synapses lead from a neuron to one compartment of itself.

    Placement and the image must count their list in the same way. ``words`` are those of each core, kept to notice
    a change.
    """
    compiled = lc.compile(
        lc.load(EXAMPLES / "objects-hybrid.pt"), strategy=strategy, diagnosis=False
    )
    cores = compiled.program.cores
    chip = compiled.program.chip
    assert [len(synapse_image(core, chip).words) for core in cores] == words
    word_bits = 64
    assert compiled.report["resources"]["synapse_bits"] == word_bits * sum(words)


@pytest.mark.parametrize("seed", range(12))
def test_a_full_core_holds_its_image(seed):
    """Random projections between the same populations, dense and sparse, on cores with little memory and odd runs."""
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
            # Projections among neurons are sparse, so that the program fits at all.
            densest = 1.0 if source is x else 0.05
            density = r.choice([0.05, 0.3, densest])
            is_connected = r.random((target.size, source.size)) < density
            # About half of the synapses have a delay, the same for all.
            delay = is_connected * r.integers(0, 2, is_connected.shape) * r.integers(0, 63)
            b.connect(source, target, 2 * is_connected, delay=delay)
    cores = b.build().cores
    words = [len(synapse_image(core, chip).words) for core in cores]
    assert words == [core.axons.synapse_words for core in cores]
    assert max(words) <= limit


def test_a_program_that_states_another_number_of_words_is_refused():
    (core,) = taps().cores
    with pytest.raises(InputError) as caught:
        synapse_image(replace(core, axons=replace(core.axons, synapse_words=1)), CHIP)
    assert str(caught.value) == (
        "core 0: its synapse lists take a different number of words than the program says (69 against 1). Compile the program again."
    )


def test_the_programs_have_wraps_clips_and_hops():
    """So that the comparisons above cover them."""
    counts = hw.simulate(everything(), played_streams(everything())).counts
    assert counts.charge_wraps > 0
    assert counts.current_wraps > 0
    assert counts.voltage_clips > 0
    assert counts.hops_x > 0
    assert counts.hops_y > 0


def test_files_of_a_tiny_program_are_those_written_by_hand():
    """One line leads to one compartment."""
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
"""Name, first step and number of steps of the second phase, which always runs over all four channels."""


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
    """The time phase begins in the first step with two events, and runs at most five steps.

    Before, the chip is at rest. A bench that played these steps would compute other registers, because of the bias.
    """
    recording = np.zeros((12, 4), dtype=np.uint8)
    for step, channel in events:
        recording[step, channel] = 1
    vectors = written(play_recording(two_phases(align_events=2, bias=700), recording), tmp_path)
    assert [
        (phase["name"], phase["first_step"], phase["steps"]) for phase in vectors.manifest["phases"]
    ] == phases
    for entry, (_, _, steps) in zip(vectors.manifest["cores"], phases, strict=True):
        assert bench.run_core(vectors, entry) == bench.expected(vectors, entry)
        for name in ("axon_spikes", "spikes", "u"):
            assert len(vectors.rows(entry["files"][name])) == steps


def test_a_recording_that_would_fill_a_disk_is_refused(monkeypatch):
    monkeypatch.setattr("locsnn_compile.backends.vectors.vectors.MAX_BYTES", 1000)
    program = everything()
    with pytest.raises(InputError) as caught:
        vectors_files(play_recording(program, played_streams(program)))
    assert str(caught.value) == (
        "--emit vectors: u and v of every compartment and step would be too much (9520 bytes against 1000). "
        "Emit a shorter recording."
    )


def test_a_chip_whose_runs_have_no_room_for_a_header_is_refused():
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
