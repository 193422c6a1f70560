"""``locsnn diff --events`` with builds of one model for loihi-sim and SpiNNaker, which compute in different ways.

The numbers of spikes are those of ``test_compiled_for_spinnaker.py``, where the compiler itself compares both.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from locsnn_compile.cli.compile import main as compile_main
from locsnn_compile.cli.main import main

TOUCHES = "examples/recordings/touches.npz"


def built(folder: Path, model: str, target: str) -> str:
    """Compile a shipped model with strategy reset, and return the folder of the build."""
    name = f"examples/models/{model}.pt"
    arguments = [name, "--target", target, "--events", TOUCHES, "--quiet", "-o", str(folder)]
    assert compile_main([*arguments, "--strategy", "reset"]) == 0
    return str(folder)


@pytest.fixture(scope="module")
def builds(tmp_path_factory):
    """The folders of two builds: for loihi-sim, then for SpiNNaker."""
    folder = tmp_path_factory.mktemp("builds")
    targets = ("loihi-sim", "spinnaker1")
    return [built(folder / target, "objects-hybrid", target) for target in targets]


@pytest.mark.slow
def test_the_hybrid_predicts_every_class_alike_with_99_9_percent_of_its_spikes(builds, capsys):
    assert main(["diff", *builds, "--events", TOUCHES, "--json"]) == 0
    played = json.loads(capsys.readouterr().out)["played"]
    assert (played["recordings"], played["same_classes"]) == (8, 8)
    assert played["by_population"] == {
        "time_hidden": {"before": 6910, "after": 6910, "equal": 6909},
        "time_output": {"before": 212, "after": 212, "equal": 212},
        "location_hidden": {"before": 7500, "after": 7500, "equal": 7500},
        "location_output": {"before": 937, "after": 937, "equal": 937},
    }


def test_the_summary_and_the_page_compare_spikes_by_population(builds, capsys, tmp_path):
    page = tmp_path / "diff.html"
    assert main(["diff", *builds, "--events", TOUCHES, "--html", str(page)]) == 0
    stdout = " ".join(capsys.readouterr().out.split())
    assert "class of both programs the same in 8 of 8 recordings" in stdout
    assert "both, time_hidden 99.986 % of spikes equal" in stdout
    assert "Spikes of both programs" in page.read_text()


def test_builds_of_the_same_program_differ_in_nothing(builds, capsys):
    assert main(["diff", builds[1], builds[1]]) == 0
    assert capsys.readouterr().out == "The builds are equal.\n"


def test_a_report_of_another_program_is_refused(builds, capsys, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    for name in ("program.yaml", "program.npz"):
        (other / name).write_bytes((Path(builds[1]) / name).read_bytes())
    report = json.loads((Path(builds[1]) / "report.json").read_text())
    report["resources"]["synapses"] += 1
    (other / "report.json").write_text(json.dumps(report))
    assert main(["diff", builds[0], str(other)]) == 2
    assert capsys.readouterr().err.strip() == (
        f"build {str(other)!r}: report.json counts other synapses than the program has (12697 against "
        "12696). Compile again."
    )
