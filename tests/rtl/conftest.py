"""Programs out of the tests of the chip model, and networks that ship, are played here, too.

A plan of memories is checked as the study of energy checks it.
"""

import os
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FOLDERS = ("docs/research/hardware", "docs/research/energy-130nm")
sys.path[:0] = [str(ROOT / folder) for folder in FOLDERS]


@pytest.fixture(scope="module")
def cores_of_this_run(tmp_path_factory):
    """Build each core once for all processes of a run, apart from the user's cache."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cores"))
        yield
