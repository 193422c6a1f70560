"""A peer simulator in a process of its own, which waits until it is its turn."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "peers"))
from make_environments import python_of, why_missing

__all__ = ["PeerProcess", "why_missing"]


class PeerProcess:
    """A process of ``peer_worker.py`` that holds the networks of a job. Call :meth:`ready` first.

    Between turns it waits for a line of input, so it takes no processor time from the others.
    """

    def __init__(self, tool: str, job: Path) -> None:
        self._said = tempfile.TemporaryFile("w+")
        self._process = subprocess.Popen(
            [str(python_of(tool)), str(Path(__file__).with_name("peer_worker.py")), tool, str(job)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            text=True,
        )

    def ready(self) -> tuple[str, list[dict[str, NDArray[np.int64]]]]:
        """Wait until the peer can play; return its version and the spikes of each network on the first recording."""
        answer = self._answer()
        spikes = [
            {name: np.array(rows) for name, rows in network.items()} for network in answer["spikes"]
        ]
        return answer["version"], spikes

    def start(self, mode: str) -> None:
        """Let the peer begin a turn in a mode; mode ``peak`` asks for its peak memory instead."""
        assert self._process.stdin is not None
        self._process.stdin.write(mode + "\n")
        self._process.stdin.flush()

    def finish(self) -> float:
        """Wait for the end of the turn and return its seconds per recording."""
        return float(self._answer()["seconds"])

    def turn(self, mode: str) -> float:
        """Play one turn and return its seconds per recording."""
        self.start(mode)
        return self.finish()

    def peak_mib(self) -> float:
        """Return the most memory that the process has held."""
        self.start("peak")
        return float(self._answer()["mib"])

    def __enter__(self) -> PeerProcess:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._process, self._said:
            self._process.kill()

    def _answer(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._said.seek(0)
            raise RuntimeError(f"the peer ended: {self._said.read()[-2000:]}")
        answer: dict[str, Any] = json.loads(line)
        return answer
