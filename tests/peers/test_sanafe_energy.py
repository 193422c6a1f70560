"""SANA-FE runs the files of ``--emit sanafe``: its spikes, counts and energies are those of our simulator.

Networks lie on several cores and tiles, as placement puts them. If SANA-FE's neurons cannot compute a program, they play
its spikes back; then all that follows from spikes and mapping is compared: traffic, synaptic events, hops.
"""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from make_environments import python_of, why_missing

import hw_model as hw
from locsnn_compile.backends.played import Played, play_recording
from locsnn_compile.backends.sanafe.files import PARTS, sanafe_files

pytestmark = pytest.mark.peers

CHIP = hw.chip("loihi-sim")
EXAMPLES = Path(__file__).parents[2] / "examples"
SIX_DIGITS = 5e-7
"""Relative difference of energies that both round to six digits."""


def small_chip(chips: int = 1) -> hw.Chip:
    """Return the chip with 16 compartments a core, two cores a tile, and 3 x 4 tiles."""
    limits = replace(CHIP.limits, compartments_per_core=16, cores_per_chip=24)
    return replace(
        CHIP,
        chips=chips,
        limits=limits,
        mesh=replace(CHIP.mesh, columns=3, rows=4, cores_per_tile=2),
    )


def odd(r: np.random.Generator, shape: tuple[int, int], share: float = 1.0) -> np.ndarray:
    """Return excitatory and a few inhibitory weights for a share of all pairs; the other pairs are 0, no synapse.

    The weights are even, as the mixed 8-bit format asks.
    """
    weights = r.choice([-102, -34, 22, 46, 86, 154, 254], shape)
    weights[r.random(shape) >= share] = 0
    return weights


def bernoulli(r: np.random.Generator, steps: int, lines: int, rate: float) -> np.ndarray:
    """Return random spikes (steps, lines)."""
    return (r.random((steps, lines)) < rate).astype(np.uint8)


def feed_forward() -> Played:
    """Three layers whose currents last one step, with different v decays and some biases."""
    r = np.random.default_rng(1)
    b = hw.ProgramBuilder(small_chip())
    x = b.add_input("x", 40)
    h = b.add_compartments("h", 60, decay_u=4096, decay_v=r.integers(0, 4097, 60), threshold=300)
    o = b.add_compartments(
        "o", 30, decay_u=4096, decay_v=r.integers(0, 4097, 30), threshold=r.integers(1, 17, 30) * 40,
        bias=r.choice([0, 640, -1280], 30),
    )  # fmt: skip
    y = b.add_compartments("y", 20, decay_u=4096, decay_v=128, threshold=500)
    b.connect(x, h, odd(r, (60, 40)))
    b.connect(h, o, odd(r, (30, 60)))
    b.connect(o, y, odd(r, (20, 30)))
    return play_recording(b.build(), bernoulli(r, steps=120, lines=40, rate=0.05))


def delays() -> Played:
    """Every synapse with a delay of its own, up to the five that SANA-FE has."""
    r = np.random.default_rng(2)
    b = hw.ProgramBuilder(small_chip())
    x = b.add_input("x", 30)
    h = b.add_compartments("h", 40, decay_u=4096, decay_v=400, threshold=350)
    o = b.add_compartments("o", 20, decay_u=4096, decay_v=1500, threshold=350)
    b.connect(x, h, odd(r, (40, 30)), delay=r.integers(0, 6, (40, 30)))
    b.connect(h, o, odd(r, (20, 40)), delay=r.integers(0, 6, (20, 40)))
    return play_recording(b.build(), bernoulli(r, steps=150, lines=30, rate=0.05))


def recurrent() -> Played:
    """Populations that excite and inhibit each other and themselves, and voltages held at a lower limit."""
    r = np.random.default_rng(3)
    b = hw.ProgramBuilder(small_chip())
    x = b.add_input("x", 20)
    limit = -((1 << 13) - 1)
    h = b.add_compartments("h", 50, decay_u=4096, decay_v=200, threshold=400, vmin=limit)
    i = b.add_compartments("i", 20, decay_u=4096, decay_v=900, threshold=300, vmin=limit)
    b.connect(x, h, odd(r, (50, 20)))
    b.connect(h, h, odd(r, (50, 50), share=0.2))
    b.connect(h, i, odd(r, (20, 50), share=0.5))
    b.connect(i, h, -np.abs(odd(r, (50, 20))), sign_mode="mixed")
    return play_recording(b.build(), bernoulli(r, steps=200, lines=20, rate=0.1))


def fading_currents() -> Played:
    """Currents that halve each step: large weights and few steps, so that no fraction is ever cut off."""
    r = np.random.default_rng(4)
    b = hw.ProgramBuilder(small_chip())
    x = b.add_input("x", 30)
    h = b.add_compartments("h", 50, decay_u=2048, decay_v=r.integers(0, 4097, 50), threshold=9_000)
    o = b.add_compartments("o", 20, decay_u=2048, decay_v=1024, threshold=9_000)
    b.connect(x, h, odd(r, (50, 30), share=0.5), exponent=5)
    b.connect(h, o, odd(r, (20, 50), share=0.2), exponent=4)
    return play_recording(b.build(), bernoulli(r, steps=11, lines=30, rate=0.1))


def lasting_currents() -> Played:
    """Currents that never fade, and voltages that do."""
    r = np.random.default_rng(5)
    b = hw.ProgramBuilder(small_chip())
    x = b.add_input("x", 24)
    h = b.add_compartments("h", 48, decay_u=0, decay_v=2048, threshold=1000)
    o = b.add_compartments("o", 24, decay_u=0, decay_v=1024, threshold=9_000)
    b.connect(x, h, odd(r, (48, 24)))
    b.connect(h, o, odd(r, (24, 48), share=0.3))
    return play_recording(b.build(), bernoulli(r, steps=60, lines=24, rate=0.02))


def two_chips() -> Played:
    """A board of two chips side by side."""
    r = np.random.default_rng(6)
    b = hw.ProgramBuilder(small_chip(chips=2))
    x = b.add_input("x", 50)
    h = b.add_compartments("h", 400, decay_u=4096, decay_v=1024, threshold=300)
    o = b.add_compartments("o", 60, decay_u=4096, decay_v=128, threshold=900)
    b.connect(x, h, odd(r, (400, 50), share=0.3))
    b.connect(h, o, odd(r, (60, 400), share=0.2))
    return play_recording(b.build(), bernoulli(r, steps=60, lines=50, rate=0.05))


def full_cores() -> Played:
    """A network on the whole chip whose synapses fill the memory of several cores."""
    r = np.random.default_rng(7)
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 512)
    h = b.add_compartments("h", 1000, decay_u=4096, decay_v=1024, threshold=4500)
    o = b.add_compartments("o", 10, decay_u=4096, decay_v=128, threshold=3000)
    b.connect(x, h, np.abs(odd(r, (1000, 512))))
    b.connect(h, o, odd(r, (10, 1000), share=0.2))
    return play_recording(b.build(), bernoulli(r, steps=50, lines=512, rate=0.02))


def hybrid(name: str) -> Callable[[], Played]:
    """Return what makes an example hybrid, whose compartments are joined, on its first example recording."""

    def made() -> Played:
        import locsnn_compile as lc

        compiled = lc.compile(
            lc.load(EXAMPLES / f"models/{name}-hybrid.pt"),
            events=EXAMPLES / "recordings/touches.npz",
        )
        recording = lc.read_recordings(EXAMPLES / "recordings/touches.npz").spikes[0]
        return play_recording(compiled.program, recording)

    return made


SIMULATED = {
    "feed-forward": feed_forward,
    "delays": delays,
    "recurrent": recurrent,
    "fading currents": fading_currents,
    "lasting currents": lasting_currents,
    "two chips": two_chips,
    "full cores": full_cores,
}
REPLAYED = {"objects": hybrid("objects"), "containers": hybrid("containers")}


@dataclass(frozen=True)
class Case:
    """A recording, the counts and energies that the emitted files predict for each phase, and those that SANA-FE gives."""

    played: Played
    expected: list[dict[str, Any]]
    found: list[dict[str, Any]]


def run(played: Played, folder: Path) -> Case:
    """Write the files and have SANA-FE run them."""
    reason = why_missing("sanafe")
    if reason:
        pytest.skip(f"sanafe: {reason}")
    for name, content in sanafe_files(played).items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    phases = yaml.safe_load((folder / "sanafe/expected.yaml").read_text())["phases"]
    jobs = [
        {"folder": str(folder / "sanafe"), "file": p["file"], "steps": p["steps"]} for p in phases
    ]
    job, result = folder / "job.json", folder / "result.json"
    job.write_text(json.dumps(jobs))
    call = [
        str(python_of("sanafe")),
        str(Path(__file__).with_name("run_sanafe_files.py")),
        str(job),
        str(result),
    ]
    process = subprocess.run(call, capture_output=True, text=True, timeout=600)
    assert process.returncode == 0, process.stderr
    return Case(played, phases, json.loads(result.read_text()))


@pytest.fixture(scope="module", params=SIMULATED.values(), ids=SIMULATED.keys())
def simulated(request, tmp_path_factory):
    return run(request.param(), tmp_path_factory.mktemp("sanafe"))


@pytest.fixture(scope="module", params=REPLAYED.values(), ids=REPLAYED.keys())
def replayed(request, tmp_path_factory):
    return run(request.param(), tmp_path_factory.mktemp("sanafe"))


def energies_pj(found: dict[str, Any]) -> dict[str, float]:
    return {part: found["energy_joules"][part] * 1e12 for part in PARTS}


def our_energies_pj(counts: hw.Counts, chip: hw.Chip) -> dict[str, float]:
    by_count = hw.energy_pj(counts, chip.profile("sanafe"))
    assert {name for names in PARTS.values() for name in names} == set(by_count)
    return {part: sum(by_count[name] for name in names) for part, names in PARTS.items()}


def test_neurons_are_simulated_on_several_cores_and_tiles(simulated):
    assert [phase["neurons"] for phase in simulated.expected] == ["simulated"]
    program = simulated.played.program
    assert len(program.cores) > 2
    assert simulated.played.result.counts.spikes > 100
    assert len({program.chip.tile_of(core.slot) for core in program.cores}) > 1


def test_every_spike_and_voltage_is_equal(simulated):
    played, (found,) = simulated.played, simulated.found
    names = played.program.populations
    spikes = {
        name: np.zeros((played.steps("time"), n), dtype=np.uint8) for name, n in names.items()
    }
    for step, group, neuron in found["spikes"]:
        if group in spikes:
            spikes[group][step, neuron] = 1
    voltage = np.array(found["potential"]) * 64
    first = 0
    for name in sorted(names):
        assert np.array_equal(spikes[name], played.result.spikes[name])
        mine = voltage[:, first : first + names[name]]
        # After a spike SANA-FE's holds the half that the export puts there.
        silent = spikes[name] == 0
        assert np.array_equal(mine[silent], played.result.v[name][silent])
        first += names[name]


def test_counts_are_ours(simulated):
    counts, (found,), (expected,) = (
        simulated.played.result.counts,
        simulated.found,
        simulated.expected,
    )
    played_lines = expected["counts"]["neurons_fired"] - counts.spikes
    assert found["counts"] == {
        "neurons_fired": counts.spikes + played_lines,
        "neurons_updated": counts.neuron_updates_active + played_lines,
        "packets_sent": counts.axon_packets + counts.input_packets,
        "spikes": counts.synaptic_ops,
        "hops": counts.hops,
    }


def test_energies_agree_to_six_digits(simulated):
    ours = our_energies_pj(simulated.played.result.counts, simulated.played.program.chip)
    (found,) = simulated.found
    assert energies_pj(found) == pytest.approx(ours, rel=SIX_DIGITS)
    assert found["energy_joules"]["total"] * 1e12 == pytest.approx(
        sum(ours.values()), rel=SIX_DIGITS
    )
    assert found["energy_joules"]["dendrite"] == 0


def test_traffic_of_joined_compartments_is_ours(replayed):
    for expected, found in zip(replayed.expected, replayed.found, strict=True):
        counts = replayed.played.result.counts_by_phase[expected["phase"]]
        assert expected["neurons"] == "replayed"
        assert found["counts"]["packets_sent"] == counts.axon_packets + counts.input_packets
        assert found["counts"]["spikes"] == counts.synaptic_ops
        assert found["counts"]["hops"] == counts.hops
        ours = our_energies_pj(counts, replayed.played.program.chip)
        theirs = energies_pj(found)
        assert theirs["synapse"] == pytest.approx(ours["synapse"], rel=SIX_DIGITS)
        assert theirs["network"] == pytest.approx(ours["network"], rel=SIX_DIGITS)


def test_simulated_networks_have_the_counts_and_energies_that_the_files_predict(simulated):
    assert_as_predicted(simulated)


def test_networks_played_back_have_the_counts_and_energies_that_the_files_predict(replayed):
    assert_as_predicted(replayed)


def assert_as_predicted(case: Case) -> None:
    """Assert that SANA-FE's counts and energies are those in ``expected.yaml``."""
    for expected, found in zip(case.expected, case.found, strict=True):
        assert found["counts"] == expected["counts"]
        assert energies_pj(found) == pytest.approx(expected["energy_pj"], rel=SIX_DIGITS)


def test_the_lines_of_the_readme_run(tmp_path):
    case = run(delays(), tmp_path)
    (code,) = re.findall(
        r"```python\n(.*?)```", (tmp_path / "sanafe/README.md").read_text(), flags=re.DOTALL
    )
    call = [str(python_of("sanafe")), "-c", code]
    done = subprocess.run(
        call, cwd=tmp_path / "sanafe", capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stderr
    assert f"'neurons_fired': {case.expected[0]['counts']['neurons_fired']}" in done.stdout


def test_its_rule_for_updates_differs_where_charges_cancel(tmp_path):
    """Two opposite charges reach a compartment at rest: no active update in our count, one in SANA-FE's; the files predict it."""
    b = hw.ProgramBuilder(CHIP)
    x = b.add_input("x", 2)
    h = b.add_compartments("h", 1, decay_u=4096, decay_v=4096, threshold=10)
    b.connect(x, h, [[20, -20]])
    case = run(play_recording(b.build(), [[1, 1], [0, 0], [0, 0]]), tmp_path)
    assert case.played.result.counts.neuron_updates_active == 0
    assert (
        case.expected[0]["counts"]["neurons_updated"]
        == case.found[0]["counts"]["neurons_updated"]
        == 3
    )
    assert case.expected[0]["report"]["neuron_updates_active"] == 0
