"""How a recording becomes spikes on a phase's input lines: as it comes, or through the transpose buffer."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from hw_model.errors import InputError
from hw_model.graph import Input, Phase
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
    if array.dtype.kind not in "biuf" or not np.isin(array, (0, 1)).all():
        raise InputError(
            where, "values other than 0 and 1", fix="Binarise the events; graded spikes do not exist here."
        )
    return array.astype(np.uint8)


def play(program: ChipProgram, phase: Phase, streams: dict[str, ByteArray], steps: int | None) -> PhaseInput:
    """Lay one recording out as the lines of a phase: as it comes, or through the transpose buffer."""
    rows = len(next(iter(streams.values())))
    length = phase.steps if phase.steps is not None else (steps if steps is not None else rows)
    lines, played, transposed, dropped = {}, 0, 0, 0
    for item in program.inputs_of(phase.name):
        recording = streams[item.stream]
        if item.positions is None:
            lines[item.name] = _fit(recording, length)
            played += int(lines[item.name].sum())
            dropped += int(recording[length:].sum())
        else:
            lines[item.name] = transpose(recording, item)
            transposed += int(lines[item.name].sum())
            dropped += int(recording[item.size :].sum())
    return PhaseInput(length, lines, played, transposed, dropped)


def transpose(recording: ByteArray, item: Input) -> ByteArray:
    """Return what the transpose buffer plays: an event (step t, channel c) becomes line t at step ``positions[c]``."""
    assert item.positions is not None
    played = np.zeros((len(item.positions), item.size), dtype=np.uint8)
    played[item.positions] = _fit(recording, item.size).T
    return played


def _fit(recording: ByteArray, length: int) -> ByteArray:
    """Cut a recording, or pad it with silence, to a length in steps."""
    kept = recording[:length]
    return np.concatenate((kept, np.zeros((length - len(kept), recording.shape[1]), dtype=np.uint8)))
