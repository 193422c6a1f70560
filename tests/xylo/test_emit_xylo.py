"""``--emit xylo``: the arguments of rockpool's specification, a recording, and a script that compares the spikes.

rockpool is SynSense's toolchain; the script plays the specification with its simulator. Here it runs with a stand-in for
rockpool, which plays by our plain engine.
"""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import locsnn_compile as lc
from hw_model.errors import InputError
from locsnn_compile.emitters import ShownRecording
from tests.support.small_xylo_networks import (
    INPUTS,
    NETWORKS,
    STEPS,
    memoryless_network,
    small_network,
    touches,
)

CHIPS = {
    "xylo-audio2": "rockpool.devices.xylo.syns61201",
    "xylo-audio3": "rockpool.devices.xylo.syns65302",
    "xylo-imu": "rockpool.devices.xylo.syns63300",
}
"""The module of rockpool that simulates each chip."""
STAND_IN = '''
import numpy as np
from hw_model.xylo.network import XyloNetwork, XyloPopulation
from hw_model.xylo.reference import play_xylo


class XyloSim:
    """Takes the arguments that rockpool does, and plays them; {fault} is added to the first spike count."""

    @classmethod
    def from_specification(
        cls, weights_in, weights_out, weights_rec, dash_mem, dash_mem_out, dash_syn, dash_syn_out,
        threshold, threshold_out, weight_shift_in, weight_shift_rec, weight_shift_out,
        bias=None, bias_out=None,
    ):
        self = cls()
        self.network = XyloNetwork(
            XyloPopulation(dash_syn[:, None], dash_mem, threshold, bias),
            XyloPopulation(dash_syn_out[:, None], dash_mem_out, threshold_out, bias_out),
            weights_in, weights_rec, weights_out,
            weight_shift_in, weight_shift_rec, weight_shift_out,
        )
        return self

    def __call__(self, rows, record):
        result = play_xylo(self.network, rows)
        result.spikes[0, 0] += {fault}
        # rockpool has a batch of one in front.
        return result.output_spikes[None], None, {{"Spikes": result.spikes[None]}}
'''


def written(folder: Path, network: lc.Network, chip: str = "xylo-audio3") -> Path:
    """Compile a network, write the emitted files below a folder, and return the folder ``xylo``."""
    compiled = lc.compile(network, target=chip, events=touches())
    files = compiled.files(["xylo"], ShownRecording(touches()[0]))
    for name, content in files.items():
        if name.startswith("xylo/"):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
    return folder / "xylo"


def run_beside(folder: Path, chip: str, fault: int) -> subprocess.CompletedProcess[str]:
    """Run the script with a stand-in for rockpool in front of what is installed."""
    module = folder / "packages" / Path(*CHIPS[chip].split("."))
    module.mkdir(parents=True)
    (module / "__init__.py").write_text(STAND_IN.format(fault=fault))
    paths = [str(folder / "packages"), str(Path(__file__).parents[2])]
    return subprocess.run(
        [sys.executable, str(folder / "xylo/run.py")],
        env={"PYTHONPATH": ":".join(paths)},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("chip", CHIPS)
def test_the_script_plays_the_specification_and_finds_every_spike_equal(chip, tmp_path):
    written(tmp_path, small_network(), chip)
    script = run_beside(tmp_path, chip, fault=0)
    assert (script.returncode, script.stderr) == (0, "")
    assert script.stdout.splitlines()[-1] == f"{chip}: every spike is equal"


def test_the_script_counts_what_differs_and_ends_with_3(tmp_path):
    written(tmp_path, memoryless_network())
    script = run_beside(tmp_path, "xylo-audio3", fault=1)
    hidden_line, _, last_line = script.stdout.splitlines()
    assert script.returncode == 3
    hidden_neurons = 10
    assert hidden_line.endswith(f"1 of {STEPS * hidden_neurons} counts differ")
    assert last_line == "xylo-audio3: spikes differ"


@pytest.mark.parametrize("name", NETWORKS)
def test_the_specification_has_the_arguments_of_rockpool_by_name(name, tmp_path):
    network = NETWORKS[name]()
    folder = written(tmp_path, network)
    with np.load(folder / "specification.npz") as arrays:
        shapes = {key: array.shape for key, array in arrays.items()}
    hidden = sum(p.size for p in network.populations[:-1])
    outputs = network.populations[-1].size
    expected_shapes = {
        "weights_in": (INPUTS, hidden, 1),
        "weights_rec": (hidden, hidden, 1),
        "weights_out": (hidden, outputs),
        "weight_shift_in": (),
        "weight_shift_rec": (),
        "weight_shift_out": (),
    }
    for parameter in ("dash_mem", "dash_syn", "threshold", "bias"):
        expected_shapes |= {parameter: (hidden,), f"{parameter}_out": (outputs,)}
    assert shapes == expected_shapes


def test_the_rows_begin_with_silence_and_the_spikes_are_those_of_the_program(tmp_path):
    folder = written(tmp_path, small_network())
    with np.load(folder / "expected.npz") as arrays:
        rows = arrays["rows"]
        spikes = arrays["hidden_spikes"]
    assert not rows[0].any()
    assert np.array_equal(rows[1:], touches()[0][:-1])
    hidden_neurons = 12 + 8
    assert spikes.shape == (STEPS, hidden_neurons)
    assert spikes.sum() > hidden_neurons


def test_equal_input_gives_equal_bytes(tmp_path):
    first = written(tmp_path / "first", small_network())
    second = written(tmp_path / "second", small_network())
    for path in first.iterdir():
        assert (second / path.name).read_bytes() == path.read_bytes()


def test_a_recording_is_needed():
    compiled = lc.compile(small_network(), target="xylo-imu", events=touches())
    with pytest.raises(InputError) as error:
        compiled.files(["xylo"])
    assert str(error.value) == "emit: it shows a recording, and none is given. Give one."


def test_other_chips_have_no_specification_for_rockpool():
    model = Path(__file__).parents[2] / "examples/models/objects-hybrid-loihi.pt"
    compiled = lc.compile(lc.load(model), diagnosis=False)
    with pytest.raises(InputError) as error:
        compiled.files(["xylo"])
    assert str(error.value) == (
        "--emit xylo: it describes a Xylo, and loihi-sim is none. Compile for one, such as "
        "--target xylo-audio3."
    )


def test_arrays_carry_no_pickle(tmp_path):
    folder = written(tmp_path, small_network())
    for name in ("specification.npz", "expected.npz"):
        with np.load(io.BytesIO((folder / name).read_bytes()), allow_pickle=False) as arrays:
            assert all(array.dtype == np.int64 for array in arrays.values())
