"""Who may import whom: data flows one way, and help must not wait for heavy packages."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
COMPILE_PATH = ("frontends", "passes", "report", "cli")


def modules(package):
    return sorted((ROOT / package).rglob("*.py"))


def imported(path, *, lazy=True):
    """Return the names of all modules that a file imports; without ``lazy`` only those at its top level."""
    tree = ast.parse(path.read_text())
    nodes = ast.walk(tree) if lazy else [n for n in tree.body if isinstance(n, ast.Import | ast.ImportFrom)]
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


def roots(names):
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize("path", modules("hw_model"), ids=lambda p: str(p.relative_to(ROOT)))
def test_the_chip_model_knows_neither_torch_nor_the_compiler(path):
    assert not roots(imported(path)) & {"torch", "locsnn_compile"}


@pytest.mark.parametrize("path", modules("locsnn_compile"), ids=lambda p: str(p.relative_to(ROOT)))
def test_torch_is_imported_by_models_and_training_and_to_read_files(path):
    folder = path.relative_to(ROOT / "locsnn_compile").parts[0]
    if folder not in ("models", "training"):
        assert "torch" not in roots(imported(path, lazy=False))
    if folder in COMPILE_PATH:
        assert "torch" not in roots(imported(path))


@pytest.mark.parametrize(
    "path", [*modules("hw_model"), *modules("locsnn_compile")], ids=lambda p: str(p.relative_to(ROOT))
)
def test_only_the_command_line_prints_or_exits(path):
    if "cli" in path.parts:
        return
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("print", "exit"), f"line {node.lineno}"
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call) and isinstance(node.exc.func, ast.Name):
            assert node.exc.func.id != "SystemExit", f"line {node.lineno}"


@pytest.mark.parametrize("path", modules("locsnn_compile/passes"), ids=lambda p: p.name)
def test_passes_know_nothing_of_what_comes_after_them(path):
    after = ("matching", "report", "api", "cli", "pipeline", "simulation")
    assert not [name for name in imported(path) if name.rsplit(".", 1)[-1] in after or ".report" in name]


@pytest.mark.parametrize("command", ["compile", "main"])
def test_help_imports_nothing_heavy(command):
    script = (
        "import sys\n"
        f"from locsnn_compile.cli.{command} import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'torch', 'numba', 'numpy', 'scipy', 'rich', 'yaml'} & set(sys.modules)\n"
        "sys.exit(' '.join(sorted(heavy)) or 0)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_compiling_without_a_pt_file_needs_no_torch():
    script = (
        "import sys, numpy as np, hw_model as hw\n"
        "from locsnn_compile import api, pipeline\n"
        "assert 'torch' not in sys.modules\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("package", ["hw_model", "locsnn_compile"])
def test_names_that_are_not_imported_yet_are_completed(package):
    script = f"import sys, {package} as p\nassert {{*p.__all__}} <= {{*dir(p)}}\nassert 'numpy' not in sys.modules\n"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
