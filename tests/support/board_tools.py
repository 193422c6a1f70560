"""Where the files of boards lie, and where the tools of FPGAs (yosys, nextpnr) are found."""

from __future__ import annotations

import os
import sys
from pathlib import Path

BOARDS = Path(__file__).parents[2] / "hw_model/rtl/boards"
# Pip installs tools next to Python, a folder that may not be on the path.
TOOL_PATH = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
