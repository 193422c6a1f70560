"""Run scripts next to this one, each in a process of its own, so that memory and start-up are those of the script alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent


def run(script: str, *arguments: object, environment: Mapping[str, str] | None = None) -> Any:
    """Run a script and return what it prints, read as JSON."""
    call = [sys.executable, str(HERE / script), *map(str, arguments)]
    done = subprocess.run(
        call,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        env={**os.environ, **(environment or {})},
    )
    return json.loads(done.stdout)


def peak_mib(script: str, *arguments: object) -> float:
    """Run a script and return its ``peak_mib``."""
    return float(run(script, *arguments)["peak_mib"])
