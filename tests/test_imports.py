"""Which modules may import which: data flows one way, and ``--help`` must not wait for heavy packages.

Rules follow imports from module to module, also those inside functions. Imports under ``TYPE_CHECKING`` do not count.
"""

import ast
import subprocess
import sys
from pathlib import Path

import networkx as nx
import pytest

import locsnn_compile as lc

sys.path.insert(0, str(Path(__file__).parent / "house"))
from rooms import between, circles, imports_of, inner_circles, modules_of, room

ROOT = Path(__file__).parents[1]
MODULES = modules_of(ROOT)
FILES = imports_of(MODULES)
TRAINS = (
    "locsnn_compile/models/",
    "locsnn_compile/training/",
    "locsnn_compile/cli/train",
    "locsnn_compile/cli/main",
    "locsnn_compile/__main__",
)
"""Modules that may reach torch, directly or through others, except the two light modules of ``models`` named below."""

RULES = {
    "the chip knows nothing of networks": (
        ("hw_model/",),
        ("locsnn_compile/",),
        "programs are played, priced and built by hand without a compiler",
    ),
    "arithmetic is at the bottom": (
        ("hw_model/arithmetic/", "hw_model/io/"),
        ("hw_model/description/", "hw_model/mapping/", "hw_model/program/", "hw_model/engine/"),
        "a formula that needed a chip or a program would be two ideas",
    ),
    "engines count, accounting multiplies": (
        ("hw_model/engine/",),
        ("hw_model/accounting/", "hw_model/streaming/", "hw_model/simulation"),
        "no cost may change a spike",
    ),
    "passes know nothing of what comes after them": (
        ("locsnn_compile/passes/",),
        (
            "hw_model/simulation",
            "hw_model/engine/fast",
            "hw_model/engine/reference",
            "locsnn_compile/verification/",
            "locsnn_compile/report/",
            "locsnn_compile/pipeline",
            "locsnn_compile/api",
        ),
        "a lowering that saw its own verdict could be tuned to it",
    ),
    "the reference knows no chip program": (
        ("locsnn_compile/reference/",),
        (
            "hw_model/simulation",
            "hw_model/program/",
            "hw_model/engine/fast",
            "locsnn_compile/passes/",
        ),
        "what the chip is compared with must not come from the chip",
    ),
    "networks are plain": (
        ("locsnn_compile/network/",),
        (
            "locsnn_compile/passes/",
            "locsnn_compile/pipeline",
            "locsnn_compile/frontends/",
            "locsnn_compile/models/",
        ),
        "a level knows what it is, not where it comes from or goes",
    ),
    "back ends know programs": (
        (
            "locsnn_compile/backends/played",
            "locsnn_compile/backends/waves",
            "locsnn_compile/backends/timeline",
            "locsnn_compile/backends/graphs",
            "locsnn_compile/backends/vectors/",
            "locsnn_compile/backends/sanafe/",
        ),
        ("locsnn_compile/network/", "locsnn_compile/passes/", "locsnn_compile/pipeline"),
        "hardware is handed a program; how a network became it is not its business",
    ),
    "back ends ask no report": (
        ("locsnn_compile/backends/",),
        ("locsnn_compile/report/",),
        "files for other tools and pages for people change for different reasons",
    ),
    "renderers know content": (
        ("locsnn_compile/report/renderers/", "locsnn_compile/report/pictures/"),
        (
            "locsnn_compile/network/",
            "locsnn_compile/pipeline",
            "hw_model/program/",
            "hw_model/simulation",
        ),
        "a figure is computed once, and every form of the report shows the same",
    ),
    "nobody below calls the command line": (
        tuple(
            f"locsnn_compile/{name}/"
            for name in ("network", "passes", "verification", "report", "backends", "data")
        ),
        ("locsnn_compile/cli/", "locsnn_compile/api"),
        "one way in from above",
    ),
}
"""For each rule: the prefixes of the modules that it restricts, the prefixes that these must not reach, and the reason."""


def reached(modules, files=FILES):
    """Yield each module that one of the modules reaches, with the path of imports to it."""
    for module in modules:
        yield from nx.single_source_shortest_path(files, module).items()


@pytest.mark.parametrize("rule", RULES)
def test_no_module_reaches_what_it_must_not_know(rule):
    inside, outside, why = RULES[rule]
    members = [module for module in MODULES if module.startswith(inside)]
    assert members
    for prefix in outside:
        assert any(module.startswith(prefix) for module in MODULES), (
            f"no module begins with {prefix}"
        )
    broken = {" > ".join(path) for target, path in reached(members) if target.startswith(outside)}
    assert not broken, why


def test_a_path_through_another_module_is_found():
    files = nx.DiGraph([("passes/a", "reference/b"), ("reference/b", "verification/c")])
    paths = [path for _, path in reached(["passes/a"], files)]
    assert ["passes/a", "reference/b", "verification/c"] in paths


def test_there_are_no_import_cycles_between_modules_rooms_or_parts_of_rooms():
    """A room is a folder."""
    assert circles(FILES) == []
    assert circles(between(FILES, room)) == []
    assert inner_circles(FILES) == []


@pytest.mark.parametrize("package", ["hw_model", "locsnn_compile"])
def test_few_modules_are_outside_of_any_room(package):
    outside_rooms = [
        module for module in MODULES if room(module) == module and module.startswith(f"{package}/")
    ]
    assert len(outside_rooms) <= 9


def modules(package):
    """Return the Python files of a package."""
    return sorted((ROOT / package).rglob("*.py"))


def imported(path, *, lazy=True):
    """Return the names of all modules that a file imports; without ``lazy`` only those at its top level."""
    tree = ast.parse(path.read_text())
    nodes = ast.walk(tree) if lazy else tree.body
    names = set()
    for node in nodes:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names.add(node.module or "")
    return names


def roots(names):
    """Return the packages of dotted module names."""
    return {name.split(".")[0] for name in names}


@pytest.mark.parametrize("path", modules("hw_model"), ids=lambda p: str(p.relative_to(ROOT)))
def test_the_chip_model_knows_neither_torch_nor_the_compiler(path):
    assert not roots(imported(path)) & {"torch", "locsnn_compile"}


@pytest.mark.parametrize("path", modules("locsnn_compile"), ids=lambda p: str(p.relative_to(ROOT)))
def test_torch_is_imported_by_models_and_training_and_to_write_its_files(path):
    name = path.relative_to(ROOT).with_suffix("").as_posix()
    if not name.startswith(("locsnn_compile/models/", "locsnn_compile/training/")):
        assert "torch" not in roots(imported(path, lazy=False))
        assert "torch" not in roots(imported(path)) or name == "locsnn_compile/data/torch_file"


def test_compiling_reaches_no_module_that_imports_torch_at_its_top():
    """Only the module that writes torch's own files imports torch, within a function."""
    heavy = {
        name for name in MODULES if "torch" in roots(imported(ROOT / f"{name}.py", lazy=False))
    }
    light = [name for name in MODULES if not name.startswith(TRAINS)]
    light += [
        f"locsnn_compile/models/{name}" for name in ("checkpoint_reader", "graph_and_windows")
    ]
    assert len(heavy) > 10
    assert len(light) > 200
    assert not {" > ".join(path) for target, path in reached(light) if target in heavy}


@pytest.mark.parametrize(
    "path",
    [*modules("hw_model"), *modules("locsnn_compile")],
    ids=lambda p: str(p.relative_to(ROOT)),
)
def test_only_the_command_line_prints_or_exits(path):
    if "cli" in path.parts:
        return
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in ("print", "exit"), f"line {node.lineno}"
        if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
            exception = node.exc.func
            if isinstance(exception, ast.Name):
                assert exception.id != "SystemExit", f"line {node.lineno}"


def check_script(script, cwd=None):
    """Run a script in a new interpreter, and check that it exits with code 0 and prints no error.

    A new interpreter has imported nothing yet; a script exits with the names of modules that it should not have loaded.
    """
    process = subprocess.run(
        [sys.executable, "-c", script], cwd=cwd, capture_output=True, text=True, check=False
    )
    assert (process.returncode, process.stderr) == (0, "")


@pytest.mark.parametrize("command", ["compile", "main"])
def test_help_imports_nothing_heavy(command):
    script = (
        "import sys\n"
        f"from locsnn_compile.cli.{command} import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit:\n    pass\n"
        "heavy = {'torch', 'numba', 'numpy', 'scipy', 'rich', 'yaml'} & set(sys.modules)\n"
        "sys.exit(' '.join(sorted(heavy)) or 0)\n"
    )
    check_script(script)


def test_every_public_name_can_be_imported_without_torch():
    script = (
        "import sys\nsys.modules['torch'] = None\nimport hw_model, locsnn_compile\n"
        "for package in (hw_model, locsnn_compile):\n    for name in package.__all__:\n        getattr(package, name)\n"
    )
    check_script(script)


@pytest.mark.parametrize("package", ["hw_model", "locsnn_compile"])
def test_dir_lists_public_names_that_are_not_imported_yet(package):
    script = f"import sys, {package} as p\nassert {{*p.__all__}} <= {{*dir(p)}}\nassert 'numpy' not in sys.modules\n"
    check_script(script)


def test_compiling_from_the_command_line_loads_no_package_that_it_does_not_need(tmp_path):
    script = (
        "import os, sys\n"
        "from locsnn_compile.cli.compile import main\n"
        f"assert main({['examples/models/objects-hybrid.pt', '--quiet', '-o', str(tmp_path / 'out')]}) == 0\n"
        "heavy = {'torch', 'networkx', 'scipy.signal', 'scipy.stats', 'matplotlib', 'h5py', 'dask'} & set(sys.modules)\n"
        "assert os.environ['OPENBLAS_NUM_THREADS']\n"
        "sys.exit(' '.join(sorted(heavy)) or 0)\n"
    )
    check_script(script, cwd=ROOT)


def test_running_a_program_loads_no_network_and_no_report(tmp_path):
    script = (
        "import sys\n"
        "from locsnn_compile.cli.main import main\n"
        f"assert main(['run', {str(tmp_path)!r}, '--events', 'examples/recordings/touches.npz']) == 0\n"
        "heavy = {'scipy.sparse', 'locsnn_compile.network.network', 'locsnn_compile.report.words'} & set(sys.modules)\n"
        "sys.exit(' '.join(sorted(heavy)) or 0)\n"
    )
    recordings = lc.read_recordings(ROOT / "examples/recordings/touches.npz")
    compiled = lc.compile(
        lc.load(ROOT / "examples/models/objects-hybrid-loihi.pt"),
        events=recordings,
        diagnosis=False,
    )
    compiled.save(tmp_path)
    check_script(script, cwd=ROOT)
