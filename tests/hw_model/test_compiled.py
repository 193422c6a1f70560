"""The cache of compiled loops: where it lies, when it is invalid, damaged files, and helpers that compile ahead.

Most tests run a copy of the package in a process, with a loop of their own, and look at the files that it leaves.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hw_model.engine.compiled
from hw_model.engine import ahead as engine_ahead
from hw_model.streaming import ahead
from tests.support.marks import first_quick

ROOT = Path(__file__).parents[2]
PACKAGE = Path(hw_model.__file__).parent
USER = """\
from hw_model.engine.compiled import compiled
from hw_model.engine.alone import dendrite

@compiled
def wrapped(x):
    return dendrite(0, 0, x, 0, 1 << 29, 1 << 23, 1 << 29)[0] // 64
"""


def test_all_folders_with_loops_make_the_cache_invalid():
    """The formulas of the arithmetic are compiled into loops of other rooms, and have no decorators."""
    loop = re.compile(
        r"^@(compiled|shared|inner|absorbed|intrinsic|kernel)|intrinsic", re.MULTILINE
    )
    with_loops = {
        path.parent.name for path in PACKAGE.rglob("*.py") if loop.search(path.read_text())
    }
    assert with_loops | {"arithmetic"} == set(hw_model.engine.compiled.FOLDERS_OF_LOOPS)


def test_private_parts_of_numba_are_used_in_one_file():
    """Other files use only documented parts of numba, and of llvmlite ``ir``, to write instructions."""
    private = re.compile(
        r"\bnumba\.(?!njit\b|typeof\b|config\b)\w+|import .*numba\.core|from numba"
    )
    users = {
        path.name: private.findall(path.read_text())
        for path in PACKAGE.rglob("*.py")
        if path.name not in ("private_numba.py", "usable.py")
    }
    assert {name: parts for name, parts in users.items() if parts} == {}


def run(folder, *, limits="true", **environment):
    """Run a loop of a copy of the package in a process, and return its result: 5, if charges wrap at 2^24.

    ``limits`` is a shell command that runs before.
    """
    if not (folder / "user.py").exists():
        shutil.copytree(PACKAGE, folder / "hw_model", ignore=shutil.ignore_patterns("__pycache__"))
        (folder / "user.py").write_text(USER)
    python = (
        f"{sys.executable} -c 'import numpy, user; print(user.wrapped(numpy.int32(2**24 + 5)))'"
    )
    variables = {
        key: value
        for key, value in os.environ.items()
        if key not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    }
    variables |= {"PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"} | environment
    process = subprocess.run(
        ["bash", "-c", f"{limits}; {python}"],
        cwd=folder,
        env=variables,
        capture_output=True,
        text=True,
        timeout=100,
    )
    assert (process.returncode, process.stderr) == (0, "")
    return int(process.stdout)


def kept_in(folder):
    """Return the folders below one that hold compiled code."""
    return {path.parent.relative_to(folder).parts[0] for path in folder.rglob("*.nbi")}


@pytest.mark.slow
def test_a_change_in_another_file_is_seen(tmp_path):
    cache = str(tmp_path / "cache")
    assert run(tmp_path, NUMBA_CACHE_DIR=cache) == 5
    # Without the wrap in another file, the loop of this one returns the charge itself.
    source = tmp_path / "hw_model/engine/chunks.py"
    text = source.read_text()
    wrapped = "(low_bits ^ half) - half"
    assert wrapped in text
    source.write_text(text.replace(wrapped, "x"))
    assert run(tmp_path, NUMBA_CACHE_DIR=cache) == 2**24 + 5


def block_pycache(folder):
    """Put a file where ``__pycache__`` would be, so that nothing can be written next to the functions, even by root."""
    folder.mkdir()
    (folder / "__pycache__").write_text("a file")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("writable", "place"),
    [
        (("named", "own", "home"), "named"),
        (("own", "home"), "__pycache__"),
        (("home",), "home"),
        ((), None),
    ],
    ids=["the named folder", "next to the function", "the user's", "nowhere"],
)
def test_code_is_kept_in_the_first_folder_that_can_be_written(tmp_path, writable, place):
    package = tmp_path / "package"
    if "own" not in writable:
        block_pycache(package)
    package.mkdir(exist_ok=True)
    home = package / "home" if "home" in writable else "/proc/self/home"
    named = package / "named" if "named" in writable else "/proc/self/named"
    for _ in range(2):
        assert run(package, HOME=str(home), NUMBA_CACHE_DIR=str(named)) == 5
    assert kept_in(package) == ({place} if place else set())


@pytest.mark.slow
def test_where_there_is_no_room_for_code_it_is_used_and_not_kept(tmp_path):
    """With ``ulimit -f 0``, a file cannot grow beyond 0 bytes."""
    assert run(tmp_path, limits="ulimit -f 0", NUMBA_CACHE_DIR=str(tmp_path / "cache")) == 5
    assert not any(path.stat().st_size for path in (tmp_path / "cache").rglob("*.nb?"))


def cut(path):
    """Leave half of a file."""
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def blank(path):
    """Fill the second half of a file with zeros, as after a power cut: its size stays."""
    content = path.read_bytes()
    half = len(content) // 2
    path.write_bytes(content[:half] + bytes(len(content) - half))


def one_bit(path):
    """Change a bit at the end of the code."""
    content = bytearray(path.read_bytes())
    content[-40] ^= 1  # behind the code are the 32 bytes of its checksum
    path.write_bytes(content)


# Kind of file (code or index), what happens to it, and the reason in the log.
DAMAGES = [
    ("nbc", cut, "pickle data was truncated|its checksum differs"),
    ("nbc", blank, "its checksum differs"),
    ("nbc", one_bit, "its checksum differs"),
    ("nbi", cut, ".+"),
    ("nbi", blank, ".+"),
]
LOGGED = (
    USER
    + """
if __name__ == "__main__":
    import logging, sys, numpy
    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    logging.getLogger("locsnn").setLevel(logging.INFO)
    print(wrapped(numpy.int32(2**24 + 5)))
"""
)


def run_logged(folder):
    """Run the loop of a copy of the package in a process; return its output, and its log without times."""
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    process = subprocess.run(
        [sys.executable, "logged.py"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=100,
    )
    return process.stdout, re.sub(r"in [0-9.]+ s", "in some s", process.stderr)


@pytest.fixture(scope="module")
def with_code(tmp_path_factory):
    """A copy of the package, a loop, and its compiled code."""
    folder = tmp_path_factory.mktemp("with_code")
    shutil.copytree(PACKAGE, folder / "hw_model", ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "logged.py").write_text(LOGGED)
    assert run_logged(folder) == (
        "5\n",
        "compiling __main__ for this machine, once\ncompiled in some s\n",
    )
    assert run_logged(folder) == ("5\n", "")
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "damage", "why"), DAMAGES)
def test_damaged_code_is_dropped_and_compiled_anew(kind, damage, why, with_code):
    (path,) = (with_code / "cache").rglob(f"*.{kind}")
    damage(path)
    output, log = run_logged(with_code)
    assert output == "5\n"
    assert re.fullmatch(
        rf"compiled code of \S*wrapped\S* is damaged, and is dropped: ({why})\n"
        r"compiling __main__ for this machine, once\ncompiled in some s\n",
        log,
    )
    assert run_logged(with_code) == ("5\n", "")


# A helper process that compiles `twice`, its loops, and a program that prints which loops it compiles itself.
AHEAD = """\
import sys
from other.loops import twice
if __name__ == "__main__":
    twice(3)
    sys.exit({code})
"""
LOOPS = """\
from hw_model.engine.compiled import compiled

@compiled
def twice(x):
    return 2 * x
"""
ASKS = """\
from numba.core import event
from hw_model.engine.ahead import compile_ahead
import user
from other.loops import twice

class Listener(event.Listener):
    def on_start(self, event):
        if event.data["dispatcher"].py_func.__module__ in ("user", "other.loops"):
            print(event.data["dispatcher"].py_func.__name__, end=" ")

    def on_end(self, event):
        pass

event.register("numba:compile", Listener())
compile_ahead("other.ahead", ("other.loops",))
print(user.wrapped(5), twice(3))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("exit_code", "cores", "stdout"),
    first_quick([(0, 2, "wrapped 5 6"), (1, 2, "wrapped twice 5 6"), (0, 1, "wrapped twice 5 6")]),
    ids=["in another process", "which fails", "of one core"],
)
def test_loops_of_a_package_are_compiled_beside_others(tmp_path, exit_code, cores, stdout):
    """The helper compiles ``twice``; if it fails, or with one core, the program compiles it itself."""
    files = {
        "user": USER,
        "other/__init__": "",
        "other/loops": LOOPS,
        "other/ahead": AHEAD.format(code=exit_code),
        "asks": ASKS,
    }
    shutil.copytree(PACKAGE, tmp_path / "hw_model", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "other").mkdir()
    for name, text in files.items():
        (tmp_path / f"{name}.py").write_text(text)
    start = f"import os; os.sched_getaffinity = lambda _: range({cores}); import runpy; runpy.run_path('asks.py')"
    environment = os.environ | {
        "PYTHONPATH": str(tmp_path),
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
    }

    def run_asks():
        process = subprocess.run(
            [sys.executable, "-c", start],
            cwd=tmp_path,
            env=environment,
            capture_output=True,
            text=True,
            timeout=100,
        )
        assert (process.returncode, process.stderr) == (0, "")
        return process.stdout.strip()

    assert run_asks() == stdout
    assert run_asks() == "5 6"


@pytest.mark.parametrize(
    ("files", "cache", "starts"),
    [
        pytest.param([], None, True, id="nothing compiled"),
        pytest.param(["events.list_into-113.py311.nbi"], None, True, id="the tile is missing"),
        pytest.param(["tiles.run_tile-30.py311.nbi"], None, False, id="compiled before"),
        pytest.param([], "elsewhere", False, id="kept elsewhere"),
    ],
)
def test_helpers_start_at_once_where_nothing_is_compiled(
    files, cache, starts, tmp_path, monkeypatch
):
    (tmp_path / "__pycache__").mkdir()
    for name in files:
        (tmp_path / "__pycache__" / name).touch()
    started = []
    monkeypatch.setattr(engine_ahead, "__file__", str(tmp_path / "ahead.py"))
    monkeypatch.setattr(engine_ahead, "start_ahead", lambda: started.append("helpers"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    if cache is not None:
        monkeypatch.setenv("NUMBA_CACHE_DIR", cache)
    engine_ahead.start_ahead_where_nothing_is_compiled()
    assert started == (["helpers"] if starts else [])


@pytest.mark.slow
def test_numba_keeps_the_tile_where_helpers_look_for_it(tmp_path):
    shutil.copytree(PACKAGE, tmp_path / "hw_model", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {name: os.environ[name] for name in os.environ if name != "NUMBA_CACHE_DIR"}
    command = [sys.executable, "-P", "-m", "hw_model.engine.ahead_of_tiles"]
    environment["PYTHONPATH"] = str(tmp_path)
    subprocess.run(command, cwd=tmp_path, env=environment, check=True, timeout=300)
    assert list((tmp_path / "hw_model/engine").glob(engine_ahead.TILE_FILES))


@pytest.mark.minutes
def test_the_helper_compiles_exactly_the_loops_that_a_session_needs(tmp_path):
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    subprocess.run([sys.executable, "-m", ahead.__name__], env=environment, check=True, timeout=300)
    before = sorted(tmp_path.rglob("*.nbc"))
    assert before
    plays = (
        "import numpy as np, hw_model as hw, locsnn_compile as lc\n"
        "network = lc.load('examples/models/objects-hybrid.pt')\n"
        "program = lc.compile(network, strategy='dendrite', diagnosis=False).program\n"
        "hw.Session(program).push(np.ones((3, program.streams['touch']), dtype=np.uint8))\n"
    )
    subprocess.run(
        [sys.executable, "-c", plays], cwd=ROOT, env=environment, check=True, timeout=300
    )
    after = sorted(
        path for path in tmp_path.rglob("*.nbc") if path.parent.name.startswith("streaming")
    )
    assert after == before
