"""Targets with the open core: what fits, exact cycles, activity, and no energy anywhere."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

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

MODELS = Path(__file__).parents[2] / "examples/models"
NEEDS_ICARUS = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)
CONFIGS = Path(__file__).parents[2] / "examples/configs"
SHORT = {"epochs": 1, "validation_fraction": 0.0, "refit": False}
DEVICES = ("ecp5-25f", "ecp5-85f", "ice40up5k", "locsnn-130nm")


def device(sizes: Sizes, name: str = "ecp5-25f") -> hw.Chip:
    return replace(hw.chip(name), open_core=sizes)


@pytest.fixture(scope="module")
def small() -> tuple[hw.ChipProgram, np.ndarray, CoreProgram]:
    """A program of two phases on a device of just the right sizes, and a recording."""
    program, spikes = benches.hybrid(22)
    core = CoreProgram(program, spikes.shape[1], sizes=benches.SIZES)
    return replace(program, chip=device(sizes_for(core.needs, benches.SIZES))), spikes, core


NAMES = [
    name
    for name in Sizes.__dataclass_fields__
    if name not in ("word", "step", "places", "sums", "one_port", "later", "groups")
]


@pytest.mark.parametrize("name", NAMES)
def test_what_does_not_fit_is_refused_by_name(small, name):
    program, spikes, core = small
    rows = spikes.shape[1]
    needs = core.needs
    assert on_core(program, rows, device(needs)).needs == needs
    need = getattr(needs, name)
    with pytest.raises(hw.TargetError) as caught:
        on_core(program, rows, device(replace(needs, **{name: need - 1})))
    holding = [
        one
        for one in DEVICES
        if all(n <= getattr(hw.chip(one).open_core, k) for k, n in asdict(needs).items())
    ]
    fix = f"Use the device {listed(holding, 'or')}." if holding else "Use a smaller network."
    expected = (
        f"the open core of ecp5-25f is too small in {name!r} ({need} against {need - 1}). {fix}"
    )
    assert str(caught.value) == f"program {program.name!r}: {expected}"


def test_a_phase_of_more_compartments_than_places_is_refused(small):
    program, spikes, core = small
    largest = max(core.ends[0], core.ends[1] - core.ends[0])
    shared = replace(core.needs, places=largest, step=3, synapses=4096)
    assert on_core(program, spikes.shape[1], device(shared)).needs.places == largest < core.ends[1]
    with pytest.raises(hw.TargetError) as caught:
        on_core(program, spikes.shape[1], device(replace(shared, places=largest - 1)))
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


@pytest.mark.parametrize(("model", "strategy", "name"), FITS, ids=["-".join(row) for row in FITS])
def test_networks_that_ship_fit(model, strategy, name):
    network = load(MODELS / f"{model}.pt")
    program = lower(network, hw.chip(name), 8, strategy).program
    assert (
        on_core(program, network.steps, hw.chip(name)).needs.synapses
        <= hw.chip(name).open_core.synapses
    )


def test_a_network_that_does_not_fit_is_told_what_holds_it():
    with pytest.raises(hw.TargetError) as caught:
        lower(load(MODELS / "objects-hybrid.pt"), hw.chip("ecp5-25f"), 8, "paired-dendrite")
    assert str(caught.value) == (
        "program 'objects-hybrid': the open core of ecp5-25f is too small in 'synapses' (25610 against 16384). "
        "Use the device ecp5-85f."
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "axons"), [("ecp5-25f", 1024), ("locsnn-130nm", 768)])
def test_a_network_of_many_cores_is_too_large_for_the_one_that_hosts_them(name, axons):
    with pytest.raises(hw.TargetError) as caught:
        lower(load(MODELS / "containers-best.pt"), hw.chip(name), 8, "dendrite")
    assert str(caught.value) == (
        f"program 'containers-best': the open core of {name} is too small in 'axons' (33974 against {axons}). "
        "Use a smaller network."
    )


ADVICE = [
    ("locsnn-130nm", "paired-dendrite", "program 'containers-hybrid': the open core of locsnn-130nm is too small in 'axons' (923 against 768). Use strategy dendrite."),
    ("locsnn-130nm", "delay-line", "population 'time_hidden': 1 delayed synapse cannot hold a kernel of tau_ref 1 (an error of 13 against 0.1; locsnn-130nm has delay_max 0). Use strategy dendrite."),
    ("ice40up5k", "dendrite", "program 'containers-hybrid': the open core of ice40up5k is too small in 'axons' (715 against 512). Use strategy reset."),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("target", "strategy", "message"), ADVICE, ids=[f"{row[0]}-{row[1]}" for row in ADVICE]
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


COUNTING = """
    integer reads[0:5], writes[0:3], file, i;
    initial begin
        for (i = 0; i < 6; i = i + 1) reads[i] = 0;
        for (i = 0; i < 4; i = i + 1) writes[i] = 0;
    end
    wire settled = !core.clear && !load_valid;
    always @(posedge clk) begin
        if (settled) begin
            reads[0] <= reads[0] + core.banks[0].in_turn.charges.charges.read + core.banks[1].in_turn.charges.charges.read;
            reads[1] <= reads[1] + (core.compartments.valid2);
            reads[2] <= reads[2] + (core.buffer.marking || core.buffer.next_word);
            reads[3] <= reads[3] + (core.deliver.valid2 && core.deliver.banks[0].used)
                + (core.deliver.valid2 && core.deliver.banks[1].used);
            reads[4] <= reads[4] + core.deliver.axons.read;
            writes[0] <= writes[0] + core.banks[0].in_turn.charges.charges.write + core.banks[1].in_turn.charges.charges.write;
            writes[1] <= writes[1] + core.compartments.states.write;
            writes[2] <= writes[2] + core.buffer.bitmap.write;
            writes[3] <= writes[3] + core.spikes.places.write;
        end
        if (answer_valid) begin
            file = $fopen("COUNTED", "w");
            for (i = 0; i < 5; i = i + 1) $fwrite(file, "%0d ", reads[i]);
            for (i = 0; i < 4; i = i + 1) $fwrite(file, "%0d ", writes[i]);
            $fclose(file);
        end
    end
endmodule
"""


@NEEDS_ICARUS
def test_activity_is_what_the_core_does(small, tmp_path, cores_of_this_run):
    program, spikes, core = small
    texts = dict(simulators.sources())
    counting = COUNTING.replace("COUNTED", str(tmp_path / "counted"))
    texts["bench.sv"] = texts["bench.sv"].replace("endmodule", "") + counting
    result, _ = play_on_core(program, spikes, None, ("spikes",), "icarus", texts, benches.SIZES)
    counted = [int(word) for word in (tmp_path / "counted").read_text().split()]
    expected = activity(core, result.counts, len(spikes))
    names = ("charges", "states", "transpose_buffer", "synapses", "axons")
    assert [expected["memory_reads"][name] for name in names] == counted[:5]
    writes = [
        expected["memory_writes"][name]
        for name in ("charges", "states", "transpose_buffer", "queue")
    ]
    assert writes[2:] == counted[7:]
    # What stays as it was is not written.
    assert result.counts.synaptic_ops / len(spikes) < counted[5] <= writes[0]
    assert 0 < counted[6] <= writes[1]
    assert expected["multiplications"] == {"of_24_and_13_bits": 2 * result.counts.neuron_updates}


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    folder = tmp_path_factory.mktemp("core")
    spikes = (np.random.default_rng(0).random((2, 78, 250)) < 0.02).astype(np.uint8)
    np.save(folder / "few.npy", spikes)
    model = [str(MODELS / "objects-hybrid.pt"), "--events", str(folder / "few.npy")]
    arguments = [
        *model,
        "--target",
        "ecp5-25f",
        "--strategy",
        "reset",
        "--quiet",
        "-o",
        str(folder / "out"),
    ]
    assert compile_main(arguments) == 0
    return folder, arguments


def test_a_report_has_cycles_and_no_energy(build):
    folder, _ = build
    report = json.loads((folder / "out/report.json").read_text())
    assert set(report["energy"].values()) == {None}
    latency = report["latency"]
    program = hw.load_program(folder / "out")
    spikes = np.load(folder / "few.npy").transpose(0, 2, 1)
    cycles = [
        one.total_ns / 10 for one in latencies(program, spikes, hw.simulate(program, spikes).spikes)
    ]
    assert latency["basis"] == "cycle-exact model of the RTL core at the placed clock"
    assert (latency["profile"], latency["clock_ghz"]) == (None, 0.1)
    assert latency["per_sample_cycles"] == round(sum(cycles) / 2)
    limits = report["resources"]["limits"]
    assert limits["synapses"] == {"used": 12786, "limit": 16384}
    assert "word" not in limits  # the chip chooses it, so no program fills it
    assert report["activity"]["multiplications"]["of_24_and_13_bits"] == 2 * 68 * (250 + 78)
    for name in ("report.md", "report.html"):
        said = (folder / "out" / name).read_text().replace("&nbsp;", " ")
        assert "Cycles exact, energy not known" in said
        assert (
            f"{latency['per_sample_cycles']:,} cycles on the open core, {time(latency['per_sample_ns'])} at 100 MHz."
            in said
        )
        assert "times fewer than CNN-3D" in said
        assert "`locsnn" not in said
        assert not [word for word in (" pJ", " nJ", " µJ", "profile None") if word in said]


def test_a_core_in_cells_has_an_energy(build, tmp_path):
    folder, _ = build
    model = [
        str(MODELS / "objects-hybrid-loihi.pt"),
        "--events",
        str(folder / "few.npy"),
        "--quiet",
    ]
    assert (
        compile_main(
            [*model, "--target", "locsnn-130nm", "--max-energy-nj", "1e6", "-o", str(tmp_path)]
        )
        == 0
    )
    report = json.loads((tmp_path / "report.json").read_text())
    prices = hw.chip("locsnn-130nm").profile("ihp-sg13g2").energy_pj
    counts = hw.simulate(
        hw.load_program(tmp_path), np.load(folder / "few.npy").transpose(0, 2, 1), probe=()
    ).counts
    expected = sum(pj * counts[name] for name, pj in prices.items()) / 2
    assert report["energy"]["profile"] == "ihp-sg13g2"
    assert report["energy"]["per_sample_pj"] == pytest.approx(expected, rel=1e-12)
    assert report["latency"]["basis"] == "cycle-exact model of the RTL core at the analysed clock"
    said = (tmp_path / "report.md").read_text()
    assert [
        said.count(f"## {title}\n")
        for title in ("Energy", "Activity", "Latency", "Use of the cores")
    ] == [
        1,
        1,
        1,
        0,
    ]
    assert "There are no joules" not in said


def test_an_energy_gate_fails_as_not_known(build, capsys, tmp_path):
    _, arguments = build
    gates = ["--max-energy-nj", "1e12", "--max-latency-us", "1e9", "-o", str(tmp_path / "gated")]
    assert compile_main([*arguments, *gates]) == 3
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
    _, arguments = build
    monkeypatch.setattr(hw, "simulate", None)
    assert compile_main([*arguments, *options, "-o", str(tmp_path / "refused")]) == 2
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
    folder, _ = build
    played = ["run", str(folder / "out"), "--events", str(folder / "few.npy")]
    assert locsnn([*played, "--stop", "proven"]) == 0
    said = capsys.readouterr().out
    assert "mean per recording: " in said
    assert "J" not in said
    assert locsnn([*played, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["energy_pj"] == {}


def test_two_builds_are_compared_by_time(build, capsys):
    folder, _ = build
    assert locsnn(["diff", str(folder / "out"), str(folder / "out"), "--json"]) == 0
    capsys.readouterr()
    assert locsnn(["diff", str(folder / "out"), str(folder / "out")]) == 0
    assert "dynamic energy" not in capsys.readouterr().out


def test_settings_are_ranked_by_cycles():
    slow, fast = (Losses(1.0, 1.0, 0.0, None, ns) for ns in (20.0, 10.0))
    priced = Losses(1.0, 1.0, 0.0, 5.0, 30.0)
    assert min((slow, fast), key=lambda one: one.cost) is fast
    assert [one.cost for one in (slow, fast, priced)] == [20.0, 10.0, 5.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("dataset", "steps", "classes", "needs"),
    [("containers", 325, 20, 3316), ("objects", 250, 36, 2568)],
)
def test_windows_of_16_steps_fit_the_largest_device(dataset, steps, classes, needs, tmp_path):
    recordings = synthetic_touches(2 * classes, steps=steps, classes=classes, seed=3)
    checkpoint = tmp_path / "own.pt"
    config = config_from_mapping(
        read_config(CONFIGS / f"{dataset}-window-snn-16-steps.yaml") | SHORT
    )
    export_checkpoint(checkpoint, train(recordings, config), config, recordings, None, carried=0)
    program = lower(load(checkpoint), hw.chip("ecp5-85f"), 8, "auto").program
    assert on_core(program, steps, program.chip).needs.axons == needs
    without = replace(program.chip, open_core=replace(program.chip.open_core, groups=0))
    with pytest.raises(
        hw.TargetError,
        match=rf"too small in 'axons' \({needs + 78 * (steps - -(-steps // 16))} against 4096\)",
    ):
        on_core(program, steps, without)
