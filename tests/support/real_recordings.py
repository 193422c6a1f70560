"""Where the public touch recordings are, and the mark of tests that play them.

Without them such tests are skipped by name. ``LOCSNN_REQUIRE_DATA=1``, as CI sets it, lets them run and fail instead.
"""

import os
from pathlib import Path

import pytest

REAL = Path(__file__).parents[3] / "shared/data/neutouch"
REQUIRED = os.environ.get("LOCSNN_REQUIRE_DATA") == "1"

on_real_recordings = pytest.mark.skipif(
    not REAL.is_dir() and not REQUIRED, reason="the real recordings are not next to the repository"
)
