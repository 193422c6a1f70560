"""Devices with the open core as targets: which programs fit, exact cycles, memory accesses, and reports without energy.

Cycles and accesses are compared with those of the SystemVerilog, as Icarus Verilog simulates it. Sizes in messages were
taken from the compiler when the tests were written.
"""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import hw_model as hw
from hw_model.description.open_core import Sizes
from hw_model.errors import listed
from hw_model.rtl import simulators
from hw_model.rtl.cosimulation import play_on_core
from hw_model.rtl.device import activity, latencies, on_core
from hw_model.rtl.images import CoreProgram, sizes_for
from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main as locsnn
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.emitters import check_kinds
from locsnn_compile.frontends import load
from locsnn_compile.pipeline import lower
from locsnn_compile.report.format import time
from locsnn_compile.training.config import config_from_mapping, read_config
from locsnn_compile.training.export import export_checkpoint
from locsnn_compile.training.train import train
from locsnn_compile.verification.error_bounds import Losses
from tests.support import benches

HERE = Path(__file__).parent
MODELS = HERE.parents[1] / "examples/models"
CONFIGS = HERE.parents[1] / "examples/configs"
NEEDS_ICARUS = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)
SHORT_TRAINING = {"epochs": 1, "validation_fraction": 0.0, "refit": False}
DEVICES = ("ecp5-25f", "ecp5-85f", "ice40up5k", "locsnn-130nm")
WEIGHT_BITS = 8
CHANNELS = 78
STEPS = 250
"""Of the recordings that `objects-hybrid` was trained on: 39 taxels of two polarities, in 250 steps."""


def chip_with_core(sizes: Sizes) -> hw.Chip:
    """Return the chip ecp5-25f with a core of other sizes."""
    return replace(hw.chip("ecp5-25f"), open_core=sizes)


@pytest.fixture(scope="module")
def small() -> tuple[hw.ChipProgram, np.ndarray, CoreProgram]:
    """Return a program of two phases on a device of just the right sizes, a recording, and the program as a core holds it."""
    program, spikes = benches.hybrid(22)
    core = CoreProgram(program, spikes.shape[1], sizes=benches.SIZES)
    chip = chip_with_core(sizes_for(core.needs, benches.SIZES))
    return replace(program, chip=chip), spikes, core


NOT_FILLED = ("word", "step", "places", "sums", "one_port", "later", "groups")
"""Sizes that say how the core is built, not how much of it a program fills."""
FILLED = [name for name in Sizes.__dataclass_fields__ if name not in NOT_FILLED]


def holds(chip: hw.Chip, needs: Sizes) -> bool:
    """Return whether every size of a chip's core is at least what is needed."""
    return all(need <= getattr(chip.open_core, name) for name, need in asdict(needs).items())


@pytest.mark.parametrize("name", FILLED)
def test_what_does_not_fit_is_refused_by_name(small, name):
    program, spikes, core = small
    rows = spikes.shape[1]
    needs = core.needs
    assert on_core(program, rows, chip_with_core(needs)).needs == needs
    need = getattr(needs, name)
    with pytest.raises(hw.TargetError) as caught:
        on_core(program, rows, chip_with_core(replace(needs, **{name: need - 1})))
    holding = [device for device in DEVICES if holds(hw.chip(device), needs)]
    fix = f"Use the device {listed(holding, 'or')}." if holding else "Use a smaller network."
    expected = (
        f"the open core of ecp5-25f is too small in {name!r} ({need} against {need - 1}). {fix}"
    )
    assert str(caught.value) == f"program {program.name!r}: {expected}"


def test_a_phase_of_more_compartments_than_places_is_refused(small):
    program, spikes, core = small
    largest = max(core.ends[0], core.ends[1] - core.ends[0])
    shared = replace(core.needs, places=largest, step=3, synapses=4096)
    rows = spikes.shape[1]
    assert on_core(program, rows, chip_with_core(shared)).needs.places == largest < core.ends[1]
    with pytest.raises(hw.TargetError) as caught:
        on_core(program, rows, chip_with_core(replace(shared, places=largest - 1)))
    expected = (
        f"the open core of ecp5-25f is too small in 'places' ({largest} against {largest - 1}). "
    )
    assert str(caught.value).startswith(f"program {program.name!r}: {expected}")


FITS = [
    ("objects-hybrid", "dendrite", "ecp5-25f"),
    ("objects-hybrid", "delay-line", "ecp5-25f"),
    ("objects-hybrid", "reset", "ice40up5k"),
    ("objects-hybrid-loihi", "dendrite", "ecp5-25f"),
    ("objects-hybrid", "paired-dendrite", "ecp5-85f"),
    ("containers-hybrid", "paired-dendrite", "ecp5-85f"),
    ("containers-hybrid", "delay-line", "ecp5-85f"),
    ("objects-hybrid-loihi", "dendrite", "locsnn-130nm"),
    ("containers-hybrid-loihi", "dendrite", "locsnn-130nm"),
]


@pytest.mark.parametrize(("model", "strategy", "device"), FITS, ids=["-".join(row) for row in FITS])
def test_networks_that_ship_fit(model, strategy, device):
    network = load(MODELS / f"{model}.pt")
    chip = hw.chip(device)
    program = lower(network, chip, WEIGHT_BITS, strategy).program
    assert on_core(program, network.steps, chip).needs.synapses <= chip.open_core.synapses


def test_a_network_that_does_not_fit_is_told_what_holds_it():
    with pytest.raises(hw.TargetError) as caught:
        lower(
            load(MODELS / "objects-hybrid.pt"), hw.chip("ecp5-25f"), WEIGHT_BITS, "paired-dendrite"
        )
    assert str(caught.value) == (
        "program 'objects-hybrid': the open core of ecp5-25f is too small in 'synapses' (25610 against 16384). "
        "Use the device ecp5-85f."
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "axons"), [("ecp5-25f", 1024), ("locsnn-130nm", 768)])
def test_a_network_of_many_cores_is_too_large_for_the_one_that_hosts_them(name, axons):
    with pytest.raises(hw.TargetError) as caught:
        lower(load(MODELS / "containers-best.pt"), hw.chip(name), WEIGHT_BITS, "dendrite")
    assert str(caught.value) == (
        f"program 'containers-best': the open core of {name} is too small in 'axons' (33974 against {axons}). "
        "Use a smaller network."
    )


class Advice(NamedTuple):
    """A device on which `containers-hybrid` does not fit with a strategy, and the message that names one that does."""

    target: str
    strategy: str
    message: str


ADVICE = [
    Advice("locsnn-130nm", "paired-dendrite", "program 'containers-hybrid': the open core of locsnn-130nm is too small in 'axons' (923 against 768). Use strategy dendrite."),
    Advice("locsnn-130nm", "delay-line", "population 'time_hidden': 1 delayed synapse cannot hold a kernel of tau_ref 1 (an error of 13 against 0.1; locsnn-130nm has delay_max 0). Use strategy dendrite."),
    Advice("ice40up5k", "dendrite", "program 'containers-hybrid': the open core of ice40up5k is too small in 'axons' (715 against 512). Use strategy reset."),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "strategy", "message"),
    ADVICE,
    ids=[f"{row.target}-{row.strategy}" for row in ADVICE],
)
def test_the_strategy_that_fits_is_named(tmp_path, capsys, target, strategy, message):
    arguments = [
        str(MODELS / "containers-hybrid.pt"),
        "--target",
        target,
        "--strategy",
        strategy,
        "--quiet",
    ]
    assert compile_main([*arguments, "-o", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err == f"{message}\n"


def test_where_no_strategy_fits_the_device_that_holds_it_is_named(tmp_path, capsys):
    arguments = [str(MODELS / "containers-hybrid-loihi.pt"), "--target", "ice40up5k", "--quiet"]
    assert compile_main([*arguments, "-o", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err == (
        "program 'containers-hybrid-loihi': the open core of ice40up5k is too small in 'axons' (715 against 512). "
        "Use the device ecp5-25f, ecp5-85f or locsnn-130nm.\n"
    )


@NEEDS_ICARUS
def test_cycles_of_a_target_are_those_of_the_core(small, cores_of_this_run):
    program, spikes, _ = small
    expected = hw.cosimulate(program, spikes, simulator="icarus")
    of_recordings = latencies(program, spikes, hw.simulate(program, spikes).spikes)
    clock = program.chip.clock_ghz
    assert [latency.total_ns for latency in of_recordings] == [
        counts["cycles"] / clock for counts in expected.per_recording
    ]
    assert len(of_recordings) == len(spikes)


READ = ("charges", "states", "transpose_buffer", "synapses", "axons")
WRITTEN = ("charges", "states", "transpose_buffer", "queue")
"""The memories whose accesses count_accesses.sv counts, in its order."""


@NEEDS_ICARUS
def test_activity_is_what_the_core_does(small, tmp_path, cores_of_this_run):
    program, spikes, core = small
    texts = dict(simulators.sources())
    counts_file = tmp_path / "counts"
    counting = (HERE / "count_accesses.sv").read_text().replace("COUNTS_FILE", str(counts_file))
    texts["bench.sv"] = texts["bench.sv"].replace("endmodule", "") + counting
    result, _ = play_on_core(
        program,
        spikes,
        steps=None,
        probe=("spikes",),
        simulator="icarus",
        texts=texts,
        sizes=benches.SIZES,
    )
    reads, writes = (
        [int(count) for count in line.split()] for line in counts_file.read_text().splitlines()
    )
    read = dict(zip(READ, reads, strict=True))
    written = dict(zip(WRITTEN, writes, strict=True))
    expected = activity(core, result.counts, len(spikes))
    assert read == {name: expected["memory_reads"][name] for name in READ}
    for name in ("transpose_buffer", "queue"):
        assert written[name] == expected["memory_writes"][name]
    # A charge or a state that stays as it was is not written, so these are upper bounds.
    synaptic_ops = result.counts.synaptic_ops / len(spikes)
    assert synaptic_ops < written["charges"] <= expected["memory_writes"]["charges"]
    assert 0 < written["states"] <= expected["memory_writes"]["states"]
    assert expected["multiplications"] == {"of_24_and_13_bits": 2 * result.counts.neuron_updates}


class Build(NamedTuple):
    """A build of `objects-hybrid` for the ecp5-25f, its recordings, and the arguments that made it."""

    output: Path
    events: Path
    arguments: list[str]

    @property
    def recordings(self) -> np.ndarray:
        """The recordings, (batch, steps, channels)."""
        return np.load(self.events).transpose(0, 2, 1)


@pytest.fixture(scope="module")
def build(tmp_path_factory) -> Build:
    folder = tmp_path_factory.mktemp("core")
    output = folder / "out"
    events = folder / "few.npy"
    spikes = (np.random.default_rng(0).random((2, CHANNELS, STEPS)) < 0.02).astype(np.uint8)
    np.save(events, spikes)
    model = [str(MODELS / "objects-hybrid.pt"), "--events", str(events)]
    options = ["--target", "ecp5-25f", "--strategy", "reset", "--quiet", "-o", str(output)]
    assert compile_main([*model, *options]) == 0
    return Build(output, events, [*model, *options])


def read_report(folder: Path) -> dict:
    return json.loads((folder / "report.json").read_text())


def test_a_report_has_cycles_and_no_energy(build):
    report = read_report(build.output)
    assert set(report["energy"].values()) == {None}
    latency = report["latency"]
    program = hw.load_program(build.output)
    spikes = build.recordings
    ns_per_cycle = 10  # at 100 MHz
    of_recordings = latencies(program, spikes, hw.simulate(program, spikes).spikes)
    cycles = [of_recording.total_ns / ns_per_cycle for of_recording in of_recordings]
    assert latency["basis"] == "cycle-exact model of the RTL core at the placed clock"
    assert (latency["profile"], latency["clock_ghz"]) == (None, 0.1)
    assert latency["per_sample_cycles"] == round(sum(cycles) / len(cycles))
    limits = report["resources"]["limits"]
    assert limits["synapses"] == {"used": 12786, "limit": 16384}
    assert "word" not in limits  # the chip chooses it, so no program fills it
    # Each branch has 32 hidden and 36 output compartments. One steps over time, the other over
    # channels, and an update multiplies u and v.
    multiplications = report["activity"]["multiplications"]["of_24_and_13_bits"]
    assert multiplications == 2 * (32 + 36) * (STEPS + CHANNELS)
    for name in ("report.md", "report.html"):
        page = (build.output / name).read_text().replace("&nbsp;", " ")
        assert "Cycles exact, energy not known" in page
        assert (
            f"{latency['per_sample_cycles']:,} cycles on the open core, "
            f"{time(latency['per_sample_ns'])} at 100 MHz."
        ) in page
        assert "times fewer than CNN-3D" in page
        assert "`locsnn" not in page
        assert not [word for word in (" pJ", " nJ", " µJ", "profile None") if word in page]


def test_a_core_in_cells_has_an_energy(build, tmp_path):
    model = [str(MODELS / "objects-hybrid-loihi.pt"), "--events", str(build.events), "--quiet"]
    options = ["--target", "locsnn-130nm", "--max-energy-nj", "1e6", "-o", str(tmp_path)]
    assert compile_main([*model, *options]) == 0
    report = read_report(tmp_path)
    prices = hw.chip("locsnn-130nm").profile("ihp-sg13g2").energy_pj
    recordings = build.recordings
    counts = hw.simulate(hw.load_program(tmp_path), recordings, probe=()).counts
    expected = sum(pj * counts[name] for name, pj in prices.items()) / len(recordings)
    assert report["energy"]["profile"] == "ihp-sg13g2"
    assert report["energy"]["per_sample_pj"] == pytest.approx(expected, rel=1e-12)
    assert report["latency"]["basis"] == "cycle-exact model of the RTL core at the analysed clock"
    page = (tmp_path / "report.md").read_text()
    sections = {
        title: page.count(f"## {title}\n")
        for title in ("Energy", "Activity", "Latency", "Use of the cores")
    }
    assert sections == {"Energy": 1, "Activity": 1, "Latency": 1, "Use of the cores": 0}
    assert "There are no joules" not in page


def test_an_energy_gate_fails_as_not_known(build, capsys, tmp_path):
    gates = ["--max-energy-nj", "1e12", "--max-latency-us", "1e9", "-o", str(tmp_path / "gated")]
    assert compile_main([*build.arguments, *gates]) == 3
    assert (
        capsys.readouterr().err
        == "gate failed: --max-energy-nj: the energy of this target is not known.\n"
    )


REFUSED = [
    (["--profile", "davies2018"], "profile 'davies2018': ecp5-25f has cycles and no profiles. Leave the profile out."),
    *((["--emit", kind], f"--emit {kind}: it describes a mesh of cores, and ecp5-25f is an open core. Use --emit rtl.")
      for kind in ("vectors", "trace", "sanafe")),
]  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"), REFUSED, ids=["profile", "vectors", "trace", "sanafe"]
)
def test_what_an_open_core_does_not_have_is_refused_before_it_is_played(
    build, capsys, tmp_path, monkeypatch, options, message
):
    monkeypatch.setattr(hw, "simulate", None)
    assert compile_main([*build.arguments, *options, "-o", str(tmp_path / "refused")]) == 2
    assert capsys.readouterr().err == f"{message}\n"
    assert not (tmp_path / "refused").exists()


@pytest.mark.parametrize("kind", ["vectors", "trace", "sanafe"])
@pytest.mark.parametrize("name", DEVICES)
def test_files_of_a_mesh_are_refused_before_anything_is_played(kind, name):
    with pytest.raises(hw.InputError) as caught:
        check_kinds(hw.chip(name), ["rtl", kind])
    assert str(caught.value) == (
        f"--emit {kind}: it describes a mesh of cores, and {name} is an open core. Use --emit rtl."
    )


def test_run_shows_no_energy(build, capsys):
    run = ["run", str(build.output), "--events", str(build.events)]
    assert locsnn([*run, "--stop", "proven"]) == 0
    stdout = capsys.readouterr().out
    assert "mean per recording: " in stdout
    assert "J" not in stdout
    assert locsnn([*run, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["energy_pj"] == {}


def test_two_builds_are_compared_by_time(build, capsys):
    two_builds = [str(build.output), str(build.output)]
    assert locsnn(["diff", *two_builds, "--json"]) == 0
    capsys.readouterr()
    assert locsnn(["diff", *two_builds]) == 0
    assert "dynamic energy" not in capsys.readouterr().out


def test_settings_are_ranked_by_cycles():
    """Where the energy is unknown; otherwise by energy."""
    slow = Losses(
        prediction_agreement=1.0,
        spike_agreement=1.0,
        score_error=0.0,
        energy_pj=None,
        chip_time_ns=20.0,
    )
    fast = Losses(
        prediction_agreement=1.0,
        spike_agreement=1.0,
        score_error=0.0,
        energy_pj=None,
        chip_time_ns=10.0,
    )
    priced = Losses(
        prediction_agreement=1.0,
        spike_agreement=1.0,
        score_error=0.0,
        energy_pj=5.0,
        chip_time_ns=30.0,
    )
    assert min((slow, fast), key=lambda losses: losses.cost) is fast
    assert [losses.cost for losses in (slow, fast, priced)] == [20.0, 10.0, 5.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dataset", "steps", "classes", "axons"),
    [("containers", 325, 20, 3316), ("objects", 250, 36, 2568)],
)
def test_windows_of_16_steps_fit_the_largest_device(dataset, steps, classes, axons, tmp_path):
    """As the steps of a window share a source of spikes; without that, every step of a channel is one."""
    recordings = synthetic_touches(2 * classes, steps=steps, classes=classes, seed=3)
    checkpoint = tmp_path / "own.pt"
    config = config_from_mapping(
        read_config(CONFIGS / f"{dataset}-window-snn-16-steps.yaml") | SHORT_TRAINING
    )
    export_checkpoint(
        checkpoint, train(recordings, config), config, recordings, test=None, carried=0
    )
    program = lower(load(checkpoint), hw.chip("ecp5-85f"), WEIGHT_BITS, "auto").program
    assert on_core(program, steps, program.chip).needs.axons == axons
    without_groups = replace(program.chip, open_core=replace(program.chip.open_core, groups=0))
    windows = -(-steps // 16)
    axons_without = axons + CHANNELS * (steps - windows)
    with pytest.raises(
        hw.TargetError,
        match=rf"too small in 'axons' \({axons_without} against 4096\)",
    ):
        on_core(program, steps, without_groups)
