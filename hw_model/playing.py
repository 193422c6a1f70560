"""How recordings become spikes on a phase's input lines: as they come, or through the transpose buffer."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from hw_model.errors import InputError
from hw_model.fixed_point import IntArray
from hw_model.graph import Phase
from hw_model.program import ChipProgram
from hw_model.trace import ByteArray, PhaseInput

Spikes = npt.ArrayLike | Mapping[str, npt.ArrayLike]


def read_streams(program: ChipProgram, spikes: Spikes) -> tuple[dict[str, ByteArray], bool]:
    """Return every stream as (batch, steps, channels) of 0 and 1, and whether a batch was given."""
    expected = program.streams
    given = dict(spikes) if isinstance(spikes, Mapping) else {name: spikes for name in list(expected)[:1]}
    if sorted(given) != sorted(expected):
        raise InputError(
            "spikes", f"the program plays {', '.join(sorted(expected))}", fix="Give a mapping with one array for each."
        )
    arrays = {name: _stream(name, given[name], channels) for name, channels in expected.items()}
    if len({array.shape[:-1] for array in arrays.values()}) != 1:
        raise InputError("spikes", "the streams differ in batch or steps", fix="Give arrays of equal length.")
    batched = next(iter(arrays.values())).ndim == 3
    return {name: array if batched else array[None] for name, array in arrays.items()}, batched


def _stream(name: str, given: npt.ArrayLike, channels: int) -> ByteArray:
    array = np.asarray(given)
    where = f"spikes of {name!r}"
    if array.ndim not in (2, 3) or array.shape[-1] != channels:
        raise InputError(
            where,
            "the shape does not fit",
            measured=f"{array.shape} against (steps, {channels}) or (batch, steps, {channels})",
            fix="Give one column a channel.",
        )
    if array.dtype.kind == "u":
        binary = array.size == 0 or bool(array.max() <= 1)
    else:
        binary = array.dtype.kind in "bif" and bool(((array == 0) | (array == 1)).all())
    if not binary:
        raise InputError(
            where, "values other than 0 and 1", fix="Binarise the events; graded spikes do not exist here."
        )
    return array.astype(np.uint8, copy=False)


def play(program: ChipProgram, phase: Phase, streams: dict[str, ByteArray], steps: int | None) -> PhaseInput:
    """Lay recordings out as the lines of a phase; ``steps`` where the phase does not fix them, else all rows."""
    batch, rows = next(iter(streams.values())).shape[:2]
    length = phase.steps if phase.steps is not None else (steps if steps is not None else rows)
    played, transposed, dropped = (np.zeros(batch, dtype=np.int64) for _ in range(3))
    lines = []
    for item in program.inputs_of(phase.name):
        recordings = streams[item.stream]
        if item.positions is None:
            lines.append(_fit(recordings, length))
            played += _events(lines[-1])
            dropped += _events(recordings[:, length:])
        else:
            lines.append(transpose(recordings, item.positions, item.size))
            transposed += _events(lines[-1])
            dropped += _events(recordings[:, item.size :])
    together = lines[0] if len(lines) == 1 else np.concatenate(lines, axis=2)
    return PhaseInput(np.ascontiguousarray(together), played, transposed, dropped)


def transpose(recordings: ByteArray, positions: IntArray, lines: int) -> ByteArray:
    """Return what the buffer plays: an event (step t, channel c) becomes line t at step ``positions[c]``."""
    played = np.zeros((len(recordings), len(positions), lines), dtype=np.uint8)
    played[:, positions] = _fit(recordings, lines).transpose(0, 2, 1)
    return played


def _events(spikes: ByteArray) -> IntArray:
    return np.array([np.count_nonzero(recording) for recording in spikes], dtype=np.int64)


def _fit(recordings: ByteArray, length: int) -> ByteArray:
    """Cut recordings, or pad them with silence, to a length in steps."""
    kept = recordings[:, :length]
    missing = length - kept.shape[1]
    return np.pad(kept, ((0, 0), (0, missing), (0, 0))) if missing else kept
