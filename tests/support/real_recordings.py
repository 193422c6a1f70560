"""The folder of the public touch recordings, and the mark of tests that need them.

Where the folder is missing, such tests are skipped. With ``LOCSNN_REQUIRE_DATA=1``, which CI sets, they fail instead.
"""

import os
from pathlib import Path

import pytest

REAL = Path(__file__).parents[3] / "shared/data/neutouch"
REQUIRED = os.environ.get("LOCSNN_REQUIRE_DATA") == "1"

on_real_recordings = pytest.mark.skipif(
    not REAL.is_dir() and not REQUIRED, reason="the real recordings are not next to the repository"
)
