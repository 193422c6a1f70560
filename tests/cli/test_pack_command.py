"""``locsnn pack``, and ``locsnn-compile`` of several models: from checkpoints to one program that runs.

A packed file and the same models typed one by one must give equal programs.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hw_model as hw
import locsnn_compile as lc
from locsnn_compile.cli import compile as compile_command
from locsnn_compile.cli import main as locsnn
from locsnn_compile.models.checkpoint import Pack
from locsnn_compile.models.checkpoint_reader import read_checkpoint, read_models

HERE = Path(__file__).parents[1] / "compatibility/version_0_1_0"
TOUCHES = str(HERE / "touches.npz")
MODELS = [str(HERE / f"{name}.pt") for name in ("hybrid", "hybrid-loihi-reset", "window-snn")]
# Compiles as locsnn-compile does, in a Python in which `import torch` fails.
WITHOUT_TORCH = "import sys; sys.modules['torch'] = None\nfrom locsnn_compile.cli.compile import main\nsys.exit(main(sys.argv[1:]))"


def touch_spikes():
    """Return the recordings that are played, (samples, steps, channels)."""
    return lc.read_recordings(TOUCHES).spikes


def pack(*arguments):
    """Run ``locsnn pack``; return the exit code."""
    return locsnn.main(["pack", *map(str, arguments)])


@pytest.mark.slow
def test_a_pack_compiles_to_the_program_of_its_models(tmp_path, capsys):
    """Without torch, and to the same cores and readout; a run, a stream and a gate know the program."""
    packed = tmp_path / "all.pt"
    assert pack(*MODELS, "-o", packed, "--weights", "1,2,0.5") == 0
    stdout = capsys.readouterr().out
    assert (
        stdout
        == f"hybrid: weight 1\nhybrid-loihi-reset: weight 2\nwindow-snn: weight 0.5\nwrote {packed}\n"
    )
    options = ["--events", TOUCHES, "--strategy", "dendrite", "--quiet"]
    command = [
        sys.executable,
        "-c",
        WITHOUT_TORCH,
        str(packed),
        *options,
        "-o",
        str(tmp_path / "packed"),
    ]
    subprocess.run(command, check=True, timeout=300)
    assert (
        compile_command.main(
            [*MODELS, "--weights", "1,2,0.5", *options, "-o", str(tmp_path / "typed")]
        )
        == 0
    )
    packed_program, typed_program = (
        hw.load_program(tmp_path / name) for name in ("packed", "typed")
    )
    assert packed_program.readout == typed_program.readout
    assert packed_program.phases == typed_program.phases
    for packed_core, typed_core in zip(packed_program.cores, typed_program.cores, strict=True):
        assert np.array_equal(packed_core.effective_weights, typed_core.effective_weights)
    report = json.loads((tmp_path / "packed/report.json").read_text())
    rows = report["model"]["members"]
    assert [row["sha256"] for row in rows] == [read_checkpoint(path).sha256 for path in MODELS]
    assert (
        sum(row["cores"] for row in rows)
        == report["resources"]["cores"]
        == len(packed_program.cores)
    )
    assert report["match"]["readout"]["by"] == "spikes and potentials"
    capsys.readouterr()
    assert (
        locsnn.main(
            [
                "run",
                str(tmp_path / "packed"),
                "--events",
                TOUCHES,
                "--stream",
                "--stop",
                "proven",
                "--json",
            ]
        )
        == 0
    )
    run = json.loads(capsys.readouterr().out)
    assert [row["prediction"] for row in run["recordings"]] == hw.simulate(
        packed_program, touch_spikes()
    ).prediction.tolist()
    assert {"stop", "stream"} <= run.keys()


def test_it_says_what_weights_rest_on_if_none_are_given(tmp_path, capsys):
    assert pack(*MODELS[:2], "-o", tmp_path / "a.pt") == 0
    *weights, sentence, _ = capsys.readouterr().out.splitlines()
    assert len(weights) == 2
    assert (
        sentence
        == "Class scores of hybrid and hybrid-loihi-reset are equal on hybrid.pt: scores are added as they are (--weights)."
    )


def test_bits_of_weights_are_the_widest_of_the_members(tmp_path):
    reports = []
    for number, models in enumerate((MODELS[:2], MODELS[1::-1])):
        out = tmp_path / str(number)
        options = [
            "--weight-bits",
            "4",
            "--strategy",
            "dendrite",
            "--events",
            TOUCHES,
            "--quiet",
            "-o",
            str(out),
        ]
        assert compile_command.main([*models, *options]) == 0
        reports.append(json.loads((out / "report.json").read_text())["weight_bits"])
    assert reports == [5, 5]  # of the model that was trained on the chip


def test_a_pack_is_the_same_bytes_and_keeps_recordings_once(tmp_path):
    for name in ("a.pt", "b.pt"):
        assert pack(*MODELS[:2], "-o", tmp_path / name, "--weights", "1,1") == 0
    assert (tmp_path / "a.pt").read_bytes() == (tmp_path / "b.pt").read_bytes()
    packed = read_models(tmp_path / "a.pt")
    assert isinstance(packed, Pack)
    assert sum(member.recordings is not None for member in packed.members) <= 1
    for member, path in zip(packed.members, MODELS, strict=False):
        checkpoint = read_checkpoint(path)
        assert member.description == checkpoint.description
        assert all(
            np.array_equal(member.weights[name], array)
            for name, array in checkpoint.weights.items()
        )


def changed(tmp_path, change):
    """A pack whose values are changed before it is written."""
    torch = pytest.importorskip("torch")
    path = tmp_path / "damaged.pt"
    pack(*MODELS[:2], "-o", path, "--weights", "1,1")
    values = torch.load(path, weights_only=True)
    change(values)
    torch.save(values, path)
    return path


def drop_sha(values):
    """Put a path in the place of the checksum of a member."""
    values["members"]["1"]["sha256"] = "../../etc"


def no_members(values):
    """Remove all members."""
    values["members"] = {}


def newer(values):
    """Name a version that does not exist yet."""
    values["version"] = 2


def unknown(values):
    """Add a key that no version has."""
    values["code"] = "print()"


def a_text(values):
    """Put a text in the place of a member."""
    values["members"]["2"] = "not a checkpoint"


def another_size(values):
    """State another number of hidden neurons than the weights have."""
    values["members"]["2"]["checkpoint"]["hidden"] = 7


def not_a_number(values):
    """Make the weight of a member nan."""
    values["members"]["2"]["weight"] = float("nan")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (newer, "checkpoint 'damaged.pt': its version does not exist (2 against 1)"),
        (no_members, "checkpoint 'damaged.pt': it has no members"),
        (unknown, "checkpoint 'damaged.pt': unknown key 'code'"),
        (
            a_text,
            "checkpoint 'damaged.pt': members.2: it must be a mapping of names (got 'not a checkpoint')",
        ),
        (drop_sha, "checkpoint 'damaged.pt', member '1': its sha256 is not one"),
        (
            another_size,
            "checkpoint 'damaged.pt', member '2', population 'time_hidden': its weights have another shape",
        ),
        (
            not_a_number,
            "checkpoint 'damaged.pt', member '2': weight: it must be a number (got nan)",
        ),
    ],
    ids=["newer", "empty", "unknown", "text", "sha256", "size", "weight"],
)
def test_damaged_packs_are_refused_in_a_line(tmp_path, change, message):
    with pytest.raises(lc.InputError) as caught:
        lc.load(changed(tmp_path, change))
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_what_cannot_be_packed_or_joined(tmp_path, capsys):
    """Nothing is written, and the line says why."""
    out = tmp_path / "out.pt"
    assert pack(MODELS[0], TOUCHES, "-o", out) == 2
    assert pack(*MODELS, "-o", out, "--weights", "1,2") == 2
    assert pack(*MODELS, "-o", MODELS[0]) == 2
    assert pack(*MODELS, "-o", tmp_path / "out.txt") == 2
    assert compile_command.main([MODELS[0], "--weights", "1", "-o", str(tmp_path / "dir")]) == 2
    objects = str(Path(__file__).parents[2] / "examples/models/objects-hybrid.pt")
    assert compile_command.main([MODELS[0], objects, "-o", str(tmp_path / "dir")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 6
    assert (
        lines[1]
        == "weights: each network needs one above 0, at most 1,000,000 times any other (1, 2 for 3 networks). Give numbers such as 1,2."
    )
    assert lines[3] == "--output: it is not a .pt file. Give a name that ends in .pt."
    assert (
        lines[4] == "--weights: there is one model, with nothing to weigh it against. Leave it out."
    )
    assert "differs from" in lines[5]
    assert not any(tmp_path.iterdir())


def test_a_committee_has_its_weights_already(tmp_path, capsys):
    """The message said that there was one model, with nothing to weigh it against."""
    assert pack(*MODELS[:2], "-o", tmp_path / "both.pt", "--weights", "1,2") == 0
    capsys.readouterr()
    assert (
        compile_command.main(
            [str(tmp_path / "both.pt"), "--weights", "1,1", "-o", str(tmp_path / "dir")]
        )
        == 2
    )
    line = "--weights: the file of this committee holds its weights. Leave it out, or pack the models again: locsnn pack --weights.\n"  # fmt: skip
    assert capsys.readouterr() == ("", line)
    assert not (tmp_path / "dir").exists()


def test_a_gate_on_several_models(tmp_path, capsys):
    copy = shutil.copy(MODELS[0], tmp_path / "again.pt")
    arguments = [
        MODELS[0],
        str(copy),
        "--events",
        TOUCHES,
        "--strategy",
        "dendrite",
        "--max-cores",
        "3",
        "--quiet",
    ]
    assert compile_command.main([*arguments, "-o", str(tmp_path / "dir")]) == 3
    assert (
        capsys.readouterr().err == "gate failed: --max-cores: the program takes 4 cores, above 3.\n"
    )
