"""The open core against the simulator: networks that ship, random programs and benches, played by both.

Every spike, u, v, potential, count, score and class must be the same, and the cycles of the core as many as predicted.
"""

from __future__ import annotations

import shutil
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from shipped import MODELS, example_files, model_file

import hw_model as hw
import locsnn_compile as lc
from hw_model.rtl import cosimulation
from hw_model.rtl.comparison import compare
from hw_model.rtl.simulators import command_of, run_tool, sources
from tests.support import any_program, benches, hybrids

NO_VERILATOR = pytest.mark.skipif(
    shutil.which("verilator") is None, reason="Verilator is not installed"
)
icarus = pytest.mark.skipif(
    shutil.which("iverilog") is None, reason="Icarus Verilog is not installed"
)
SETTINGS = settings(
    deadline=None,
    derandomize=True,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.large_base_example,
    ],
)
pytestmark = pytest.mark.filterwarnings("ignore:Generating overly large repr")
PLAIN = hw.chip("loihi-sim")
MANY_PROFILES = {"compartment_profiles_per_core": 1024, "threshold_profiles_per_core": 1024}
LOIHI = st.just(
    replace(PLAIN, limits=replace(PLAIN.limits, **MANY_PROFILES, synapse_formats_per_core=256))
)
"""The registers of loihi-sim, and room for compartments that all differ."""


def verilator(test):
    """Mark a test that builds the core with Verilator, which takes half a minute."""
    return pytest.mark.minutes(NO_VERILATOR(test))


def check(program: hw.ChipProgram, spikes: np.ndarray, simulator: str = "verilator") -> dict:
    """Play recordings on the core and in the simulator; return what was compared, in which nothing differs."""
    comparison = compare(program, spikes, sources(), simulator)
    assert comparison["mismatches"] == 0, comparison
    assert comparison["cycles"] == comparison["predicted_cycles"]
    return comparison


def shipped(model: str, strategy: str) -> hw.ChipProgram:
    return lc.compile(lc.load(model_file(model)), target="loihi-sim", strategy=strategy).program


def recordings(model: str, count: int | None) -> np.ndarray:
    """Return the first recordings of the example for a model, or all of them, (batch, steps, channels)."""
    return np.load(example_files(model)[0])["spikes"][:count].transpose(0, 2, 1)


@verilator
def test_a_shipped_model():
    comparison = check(shipped("objects-hybrid", "dendrite"), recordings("objects-hybrid", 1))
    assert comparison["compared_values"] > 220_000  # so all registers of all steps were compared
    assert comparison["cycles"] == [200_082]  # which must not change by accident


@verilator
def test_phases_of_every_kind_with_verilator():
    for bench in (benches.several_phases, benches.both_ways, benches.late_starts):
        check(*bench())


@verilator
@pytest.mark.parametrize(("model", "strategy"), MODELS, ids=lambda value: value)
def test_every_shipped_model(model, strategy):
    check(shipped(model, strategy), recordings(model, count=None))


def check_random(drawn: any_program.Drawn, features: Counter[str]) -> None:
    """Check a random program, and count what it had and did in ``features``."""
    features.update(drawn.drawn)
    features["values"] += check(drawn.program, drawn.spikes)["compared_values"]
    counts = hw.simulate(drawn.program, drawn.spikes, probe=()).counts
    for name in ("charge_wraps", "current_wraps", "voltage_clips", "spikes"):
        features[name] += counts[name]


@verilator
@pytest.mark.parametrize(
    ("strategy", "many"),
    [
        pytest.param(any_program.programs(given=LOIHI), 150, id="one phase"),
        pytest.param(any_program.hybrid_programs(given=LOIHI), 150, id="hybrid"),
    ],
)
def test_random_programs(strategy, many):
    features: Counter[str] = Counter()

    @settings(SETTINGS, max_examples=many)
    @given(drawn=strategy)
    def play(drawn):
        check_random(drawn, features)

    play()
    assert features["programs"] >= many // 2
    # Wraps are rare in random programs; the benches have them.
    names = ["spikes", "voltage_clips", "joined compartments", "recurrent links"]
    assert all(features[name] for name in names), features


@verilator
@pytest.mark.parametrize("seed", range(8))
def test_random_hybrids(seed):
    """Several channels in a step, silent steps, weighted readouts, cores of seven compartments."""
    program, spikes = hybrids.random_hybrid(seed, channels_per_step=1 + seed % 3, silence=seed % 2)
    check(program, spikes[None])


@icarus
@pytest.mark.minutes
def test_icarus_does_the_same():
    program, spikes = hybrids.random_hybrid(5)
    check(program, spikes[None], "icarus")


@icarus
def test_a_run_ends_with_its_last_answer(tmp_path, monkeypatch):
    """It does not wait for the long silence after which a core is given up: a million cycles take a minute."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    printed = []

    def run_and_keep_output(binary, folder, patience):
        command = [*command_of(binary), "+patience=5000"]
        printed.append(run_tool(command, folder, "the open core"))

    monkeypatch.setattr(cosimulation, "run", run_and_keep_output)
    # The bench prints the cycle in which it ends.
    bench = sources()["bench.sv"].replace("$finish;", '$display("%0d", cycle); $finish;')
    program, spikes = benches.blocked()
    compare(program, spikes, sources() | {"bench.sv": bench}, "icarus", benches.SIZES)
    cycles_of_recording = 443
    (cycles,) = map(int, printed)
    # Before it the program is loaded; the silence would take 5,000 more.
    assert cycles_of_recording < cycles < 1000


@pytest.mark.minutes
@icarus
def test_cosimulate_returns_what_simulate_does():
    program, spikes = hybrids.random_hybrid(3)
    probe = ("spikes", "u", "v", "potential", "activity")
    simulated = hw.simulate(program, spikes, probe=probe)
    core = hw.cosimulate(program, spikes, simulator="icarus", probe=probe)
    for kind in ("spikes", "u", "v", "potential"):
        of_simulator = getattr(simulated, kind)
        of_core = getattr(core, kind)
        assert of_simulator.keys() == of_core.keys()
        for name, array in of_simulator.items():
            assert np.array_equal(array, of_core[name])
    assert np.array_equal(simulated.scores, core.scores)
    assert simulated.events == core.events
    different = {name for name in simulated.counts if simulated.counts[name] != core.counts[name]}
    assert different <= {"skipped_steps", "cycles"}
    assert simulated.counts["cycles"] == 0
    assert core.counts["cycles"] > 0
    for phase in ("time", "location"):
        steps = zip(simulated.activity[phase], core.activity[phase], strict=True)
        for step_of_simulator, step_of_core in steps:
            for name, by_core in step_of_simulator.by_core.items():
                assert np.array_equal(by_core, step_of_core.by_core[name])
