"""Everything but training works where torch is not installed; what needs it says in one line how to get it.

Scripts run in processes in which importing torch fails.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.data import synthetic_touches, write_recordings
from tests.support.marks import first_quick
from tests.support.slayer_files import LOIHI, SRM, write

ROOT = Path(__file__).parents[2]

SHIPPED = sorted((ROOT / "examples/models").glob("*.pt"))
FIXTURES = sorted((ROOT / "tests/compatibility").glob("version_*/*.pt"))
ARTIFICIAL = ("gru-mlp", "cnn-3d")
WITHOUT = """\
import sys
class Missing:
    def find_spec(self, name, *_):
        if name.split(".")[0] == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name="torch")
sys.meta_path.insert(0, Missing())
"""
COMMAND = "from locsnn_compile.cli.{} import main\nsys.exit(main(sys.argv[1:]))\n"
EACH = """\
import contextlib, io, json, pathlib
from locsnn_compile.cli.compile import main
found = {}
for path in sys.argv[1:]:
    name = pathlib.Path(path).stem
    with contextlib.redirect_stderr(io.StringIO()) as said:
        code = main([path, "--quiet", "-o", name])
    found[name] = code, said.getvalue()
print(json.dumps(found))
"""
"""Compiles each of the models given, and prints the exit code and what was said on standard error, by name."""
INSTALL = "Install it with: pip install torch."


def run(script, *arguments, folder, code=0):
    """Run a script where torch cannot be imported; return what it printed."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    }
    command = [sys.executable, "-c", WITHOUT + script, *map(str, arguments)]
    process = subprocess.run(
        command, capture_output=True, text=True, cwd=folder, env=environment, check=False
    )
    assert process.returncode == code, process.stdout + process.stderr
    return process.stdout if code == 0 else process.stderr


def test_torch_is_missing(tmp_path):
    assert "No module named 'torch'" in run("import torch", folder=tmp_path, code=1)


@pytest.mark.slow
@pytest.mark.parametrize("paths", first_quick([FIXTURES, SHIPPED]), ids=["of all kinds", "shipped"])
def test_the_command_compiles_every_network(paths, tmp_path):
    """One after the other in one process, which spares seventeen starts."""
    outcome_of_model = json.loads(run(EACH, *paths, folder=tmp_path))
    for name in ARTIFICIAL:
        if name in outcome_of_model:
            code, line = outcome_of_model.pop(name)
            assert (code, line.partition(",")[0]) == (
                1,
                f"model '{name}': a '{name}' has no spiking neurons",
            )
    assert outcome_of_model == {path.stem: [0, ""] for path in paths if path.stem not in ARTIFICIAL}
    assert all((tmp_path / name / "report.json").is_file() for name in outcome_of_model)


@pytest.mark.slow
@pytest.mark.parametrize("neuron", first_quick([SRM, LOIHI]), ids=["srm", "loihi"])
def test_a_slayer_checkpoint_and_recordings_in_torchs_format(neuron, tmp_path):
    rng = np.random.default_rng(5)
    write(
        tmp_path,
        {"fc1": rng.normal(size=(4, 78)) * 9, "fc2": rng.normal(size=(3, 4)) * 9},
        neuron,
        steps=250,
    )
    write_recordings(tmp_path / "touches.pt", synthetic_touches(3, steps=250))
    files = ("model.pt", "--config", "net.yaml", "--events", "touches.pt")
    run(COMMAND.format("compile"), *files, "--quiet", "-o", "out", folder=tmp_path)
    run(COMMAND.format("main"), "run", "out", "--events", "touches.pt", folder=tmp_path)
    run(COMMAND.format("main"), "events", "touches.pt", folder=tmp_path)
    run(COMMAND.format("main"), "diff", "out", "out", folder=tmp_path)


@pytest.mark.slow
def test_the_api_and_the_other_commands(tmp_path):
    script = """\
import locsnn_compile as lc, sys
network = lc.load(sys.argv[1])
compiled = lc.compile(network, diagnosis=False)
lc.verify(compiled, network.recordings.spikes)
"""
    path = next(path for path in FIXTURES if path.stem == "hybrid")
    run(script, path, folder=tmp_path)
    run(
        COMMAND.format("main"),
        "explore",
        path,
        "--weight-bits",
        "8",
        "--strategy",
        "dendrite",
        "-o",
        "front",
        folder=tmp_path,
    )


@pytest.mark.slow
def test_a_state_dict_names_the_option_that_it_needs(tmp_path):
    write(tmp_path, {"fc1": np.ones((4, 156))})
    (tmp_path / "model.pth").write_bytes((tmp_path / "model.pt").read_bytes())
    for name in ("model.pt", "model.pth"):
        assert run(COMMAND.format("compile"), name, folder=tmp_path, code=2) == (
            f"checkpoint '{name}': it contains tensors, but does not name their network. "
            "If it is slayerPytorch's, give its YAML (--config FILE.yaml); else export the network as NIR (.nir).\n"
        )


def test_training_says_how_to_get_torch(tmp_path):
    write_recordings(tmp_path / "touches.npz", synthetic_touches(8, steps=20))
    line = run(COMMAND.format("main"), "train", "--data", "touches.npz", folder=tmp_path, code=2)
    assert line == f"locsnn train: it needs torch, which is not installed. {INSTALL}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["touches.npz"]


def test_writing_torchs_format_says_how_to_get_torch(tmp_path):
    write_recordings(tmp_path / "touches.npz", synthetic_touches(2, steps=20))
    line = run(
        COMMAND.format("main"), "events", "touches.npz", "--to", "a.pt", folder=tmp_path, code=2
    )
    assert line == f"file 'a.pt': it needs torch, which is not installed. {INSTALL}\n"
    assert [path.name for path in tmp_path.iterdir()] == ["touches.npz"]


@pytest.mark.slow
def test_training_from_python_says_it_as_well(tmp_path):
    script = "import numpy as np, locsnn_compile as lc\nlc.TrainingConfig, lc.EpochRecord, lc.Checkpoint\n{}"
    run(script.format(""), folder=tmp_path)
    failed = run(
        script.format("lc.train(np.ones((2, 9, 78)), labels=[0, 1])\n"), folder=tmp_path, code=1
    )
    assert failed.endswith(
        f"InputError: lc.train: it needs torch, which is not installed. {INSTALL}\n"
    )
