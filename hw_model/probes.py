"""What of a simulation to keep: spikes and registers, of all or chosen populations, in all or chosen steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from hw_model.errors import InputError, did_you_mean
from hw_model.placement import Slice
from hw_model.program import ChipProgram
from hw_model.trace import KINDS, Kind, Window


@dataclass(frozen=True)
class Probe:
    """Keep ``kind`` of ``populations`` (None: all) in rows ``steps`` (None: all; a range of step 1)."""

    kind: Kind
    populations: tuple[str, ...] | None = None
    steps: range | None = None


def read_probes(program: ChipProgram, probe: Sequence[Kind | Probe]) -> dict[Kind, Probe]:
    """Return the probes by kind; an unknown kind or population, or a kind twice, is an ``InputError``."""
    found: dict[Kind, Probe] = {}
    for item in probe:
        one = item if isinstance(item, Probe) else Probe(item)
        if one.kind not in KINDS:
            raise InputError(f"probe {one.kind!r}", "does not exist", fix=did_you_mean(one.kind, KINDS))
        if one.kind in found:
            raise InputError(f"probe {one.kind!r}", "is asked for twice", fix="List its populations in one probe.")
        for name in one.populations or ():
            if name not in program.populations:
                raise InputError(
                    f"probe {one.kind!r}", f"there is no {name!r}", fix=did_you_mean(name, program.populations)
                )
        if one.steps is not None and (one.steps.step != 1 or one.steps.start < 0):
            raise InputError(f"probe {one.kind!r}", "steps must count up by one from 0 or later", fix="Give a range.")
        found[one.kind] = one
    return found


class PhaseProbes:
    """Where the populations that a probe wants lie in the arrays of a phase."""

    def __init__(self, program: ChipProgram, phase: str, probes: dict[Kind, Probe], steps: int) -> None:
        self._sizes = program.populations
        self._steps = steps
        self._pieces: dict[Kind, list[tuple[Slice, slice]]] = {kind: [] for kind in probes}
        self._rows = {kind: _rows(probe, steps) for kind, probe in probes.items()}
        for piece, columns in program.columns_of(phase):
            for kind, probe in probes.items():
                wanted = probe.populations is None or piece.group in probe.populations
                if wanted and (kind != "spikes" or piece.group in program.spiking):
                    self._pieces[kind].append((piece, columns))

    def windows(self) -> dict[Kind, Window]:
        """Return what the engine must keep; spikes it gives anyway."""
        return {kind: self._window(kind) for kind in self._pieces if kind != "spikes"}

    def by_population(self, kind: Kind, kept: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
        """Return what was kept, (rows, n) by population; of spikes, ``kept`` are all (steps, compartments)."""
        window = self._window(kind)
        found: dict[str, npt.NDArray[Any]] = {}
        at = 0
        for piece, columns in self._pieces[kind]:
            array = found.setdefault(
                piece.group, np.zeros((window.stop - window.start, self._sizes[piece.group]), dtype=kept.dtype)
            )
            if kind == "spikes":
                array[:, piece.start : piece.stop] = kept[window.start : window.stop, columns]
            else:
                array[:, piece.start : piece.stop] = kept[:, at : at + piece.size]
            at += piece.size
        return found

    def _window(self, kind: Kind) -> Window:
        parts = [np.arange(columns.start, columns.stop) for _, columns in self._pieces[kind]]
        columns = np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)
        rows = self._rows[kind]
        return Window(columns, rows.start, rows.stop)


def _rows(probe: Probe, steps: int) -> range:
    if probe.steps is None:
        return range(steps)
    return range(min(probe.steps.start, steps), min(max(probe.steps.stop, probe.steps.start), steps))
