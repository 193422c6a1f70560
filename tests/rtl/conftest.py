"""Find the modules of the studies of hardware and energy, which some tests here import, and share built cores."""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("docs/research/hardware", "docs/research/energy-130nm")
sys.path[:0] = [str(ROOT / folder) for folder in FOLDERS]


@pytest.fixture(scope="module")
def cores_of_this_run(tmp_path_factory):
    """Build each core once for all processes of a run, in a cache folder of the run and not the user's."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # which all workers share
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cores"))
        yield
