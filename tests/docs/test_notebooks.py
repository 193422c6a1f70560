"""The example notebooks run from top to bottom, and are kept in the repository without their output."""

from __future__ import annotations

import ast
import json
import shutil

import pytest

from tests.support.fences import ROOT, name

NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=name)
def test_a_notebook_is_kept_without_its_output(path):
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            assert cell["outputs"] == []
            assert cell["execution_count"] is None
            ast.parse("".join(cell["source"]))


def test_both_notebooks_are_tested():
    assert [path.name for path in NOTEBOOKS] == [
        "recordings_to_report.ipynb",
        "snntorch_to_report.ipynb",
    ]


def run(path, folder):
    """Run a notebook in a copy of the examples; return the outputs of its cells."""
    # Only the slow tests need these packages.
    import nbformat
    from nbclient import NotebookClient

    shutil.copytree(ROOT / "examples", folder / "examples", dirs_exist_ok=True)
    notebook = nbformat.read(path, as_version=4)
    NotebookClient(
        notebook, timeout=600, resources={"metadata": {"path": str(folder / "examples")}}
    ).execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


@pytest.mark.minutes
@pytest.mark.parametrize("path", NOTEBOOKS, ids=name)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_runs_and_shows_the_summary(path, tmp_path):
    pages = [output.get("data", {}).get("text/html", "") for output in run(path, tmp_path)]
    assert any("Does it match?" in page for page in pages)


@pytest.mark.minutes
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_notebook_that_fails_is_found(tmp_path):
    from nbclient.exceptions import CellExecutionError

    broken = NOTEBOOKS[0].read_text("utf-8").replace("motions.npz", "absent.npz")
    (tmp_path / "broken.ipynb").write_text(broken)
    with pytest.raises(CellExecutionError, match="it does not exist"):
        run(tmp_path / "broken.ipynb", tmp_path)
