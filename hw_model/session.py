"""A recording as it arrives: push events step by step, and know the prediction after every one, in bounded memory.

This is the timestep-wise inference of hybrid networks (Kang et al. 2022): after step t the time phases have run up to
t, and the location phases are what they would be if nothing followed. A location phase is not run again for every
step: see :mod:`hw_model.replay`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from hw_model.errors import InputError
from hw_model.fast_kernels import NOTHING_KEPT, TILE, first_state, run_tile, workspace
from hw_model.fast_layout import fast_layout
from hw_model.fixed_point import IntArray
from hw_model.graph import Input, Phase
from hw_model.playing import Spikes, read_streams
from hw_model.program import ChipProgram
from hw_model.replay import Replay
from hw_model.trace import ByteArray

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StepScores:
    """The state of the readout after each of some steps.

    ``spikes[name]`` (steps, classes): spikes so far of each population of the readout; ``scores`` (steps, classes).
    """

    spikes: dict[str, IntArray]
    scores: FloatArray

    @property
    def prediction(self) -> IntArray:
        """Class with the highest score after each step, the first of equals, (steps,)."""
        return np.asarray(self.scores.argmax(axis=1), dtype=np.int64)

    @property
    def lead(self) -> FloatArray:
        """By how much the best score after each step is above the second, (steps,)."""
        return leads(self.scores)


def leads(scores: FloatArray) -> FloatArray:
    """Return by how much the best of scores (..., classes) is above the second; an only one is above 0."""
    if scores.shape[-1] == 1:
        return scores[..., 0]
    best = np.partition(scores, -2, axis=-1)
    return np.asarray(best[..., -1] - best[..., -2])


class Session:
    """One recording, played to a program as it arrives. The integers are those of :func:`hw_model.simulate`.

    ``psi``: weigh the time populations by 1 - w and the location populations by w of :func:`location_share`; None
    leaves the readout's own weights. Phases that mix inputs as they come with transposed ones, and programs without a
    readout, are an ``InputError``.
    """

    def __init__(self, program: ChipProgram, psi: float | None = None) -> None:
        if program.readout is None:
            raise InputError(
                f"program {program.name!r}", "has no readout, so it predicts nothing", fix="Add a readout."
            )
        self.program, self.psi = program, psi
        self._length = _length(program, psi)
        self.reset()

    def reset(self) -> None:
        """Forget the recording, and be ready for another."""
        self.steps = 0
        self._phases = [_phase(self.program, phase) for phase in self.program.phases]

    def push(self, spikes: Spikes) -> StepScores:
        """Play further rows, (rows, channels) or (channels,) of 0 and 1, or a mapping of streams to them.

        Rows after the last step that a phase is for change nothing in it.
        """
        given = spikes if isinstance(spikes, Mapping) else {name: spikes for name in list(self.program.streams)[:1]}
        streams, batched = read_streams(self.program, {name: np.atleast_2d(array) for name, array in given.items()})
        if batched:
            raise InputError("spikes", "a session plays one recording", fix="Give rows, (rows, channels).")
        rows = next(iter(streams.values())).shape[1]
        counts: dict[str, IntArray] = {}
        for phase in self._phases:
            counts.update(phase.push(self.steps, {name: array[0] for name, array in streams.items()}))
        self.steps += rows
        readout = self.program.readout
        assert readout is not None
        found = {name: counts[name] for name in readout.populations}
        step = np.arange(self.steps - rows + 1, self.steps + 1)
        scores = np.zeros((rows, next(iter(found.values())).shape[1]))
        for name, weight in zip(readout.populations, readout.weights, strict=True):
            scores += (weight * self._share(name, step))[:, None] * found[name]
        return StepScores(found, scores)

    @property
    def replayed(self) -> tuple[int, int]:
        """Steps of transposed phases run so far, and how many it would be to run all again after every step."""
        parts = [(phase.replay.steps_run, phase.replay.steps_of_all) for phase in self._phases if phase.replay]
        return sum(part[0] for part in parts), self.steps * sum(part[1] for part in parts)

    def spikes(self, population: str) -> ByteArray:
        """Return the spikes of a population of a transposed phase as things stand, (steps, n)."""
        for phase in self._phases:
            if phase.replay is not None and population in phase.columns:
                return phase.replay.spikes()[:, phase.columns[population]]
        raise InputError(f"population {population!r}", "is in no transposed phase", fix="Read its counts from push.")

    def _share(self, population: str, step: IntArray) -> FloatArray:
        """Return what a population counts for after each step, by its axis."""
        if self.psi is None:
            return np.ones(len(step))
        location = location_share(self.psi, step, self._length)
        axis = next(p.phase.axis for p in self._phases if population in p.columns)
        return location if axis == "location" else 1.0 - location


def location_share(psi: float, step: IntArray, steps: int) -> FloatArray:
    """Return w = 1 / (1 + exp(-psi (t / T - 1))) after step t of T, which rises to 1/2 (Kang et al. 2022)."""
    with np.errstate(over="ignore"):  # a large psi counts as 0 what is early
        shares: FloatArray = 1.0 / (1.0 + np.exp(-psi * (np.minimum(step, steps) / steps - 1.0)))
    return shares


def check_psi(psi: float) -> None:
    """Refuse a psi that is negative or not a number."""
    if not (np.isfinite(psi) and psi >= 0):
        raise InputError("psi", "it is no rate", measured=f"got {psi}", fix="Give 0 or more, such as 10.")


class _Live:
    """A phase whose inputs are played as they come: its state goes on from push to push."""

    replay: None = None

    def __init__(self, program: ChipProgram, phase: Phase, inputs: tuple[Input, ...]) -> None:
        self.phase, self.inputs = phase, inputs
        self.columns = program.columns_of(phase.name)
        self._layout = fast_layout(program, phase.name)
        self._state, self._work = first_state(self._layout), workspace(self._layout)
        self._sent = np.zeros(sum(item.size for item in inputs) + self._layout.columns, dtype=np.int64)

    def push(self, before: int, streams: dict[str, ByteArray]) -> dict[str, IntArray]:
        """Run the rows and return the spikes so far of every group after each of them, (rows, n)."""
        rows = len(next(iter(streams.values())))
        lasting = rows if self.phase.steps is None else max(0, min(rows, self.phase.steps - before))
        layout, n = self._layout, self._layout.columns
        counts = np.repeat(self._sent[None, -n:], rows, axis=0)
        for low in range(0, lasting, TILE):
            high = min(low + TILE, lasting)
            first, line = _lists([streams[item.stream][low:high] for item in self.inputs])
            spikes = np.zeros((high - low, n), dtype=np.uint8)
            active = np.zeros((high - low, layout.cores), dtype=np.int64)
            run_tile(
                before + low, high - low, first, line, layout.nodes, layout.chunks, layout.links, self._state,
                self._work, True, spikes, self._sent, active, 0, NOTHING_KEPT,
            )  # fmt: skip
            counts[low:high] += spikes.cumsum(axis=0, dtype=np.int64)
            counts[high:] = self._sent[-n:]
        return {name: counts[:, columns] for name, columns in self.columns.items()}


class _Turned:
    """A phase whose inputs come through the transpose buffer."""

    def __init__(self, program: ChipProgram, phase: Phase, inputs: tuple[Input, ...]) -> None:
        self.phase, self.inputs = phase, inputs
        self.columns = program.columns_of(phase.name)
        assert all(item.positions is not None for item in inputs)
        self.replay = Replay(fast_layout(program, phase.name), phase.steps or len(inputs[0].positions or ()))

    def push(self, before: int, streams: dict[str, ByteArray]) -> dict[str, IntArray]:
        """Add the events of the rows and return the spikes of every group after each of them, (rows, n)."""
        parts = []
        for node, item in enumerate(self.inputs):
            assert item.positions is not None
            row, channel = np.nonzero(streams[item.stream][: max(0, item.size - before)])
            parts.append(np.stack((row, np.full(len(row), node), before + row, item.positions[channel])))
        row, nodes, line, position = np.concatenate(parts, axis=1)
        order = np.argsort(row, kind="stable")
        rows = len(next(iter(streams.values())))
        first = np.searchsorted(row[order], np.arange(rows + 1))
        counts = self.replay.push(nodes[order], line[order], position[order], first)
        return {name: counts[:, columns] for name, columns in self.columns.items()}


def _phase(program: ChipProgram, phase: Phase) -> _Live | _Turned:
    inputs = program.inputs_of(phase.name)
    turned = [item.positions is not None for item in inputs]
    if any(turned) and not all(turned):
        raise InputError(
            f"phase {phase.name!r}",
            "has inputs as they come beside transposed ones, so it cannot run as they arrive",
            fix="Use simulate.",
        )
    return _Turned(program, phase, inputs) if any(turned) else _Live(program, phase, inputs)


def _length(program: ChipProgram, psi: float | None) -> int:
    """Return T, the steps of a whole recording, where it is needed."""
    lengths = [phase.steps for phase in program.phases if phase.axis == "time" and phase.steps]
    if psi is not None:
        check_psi(psi)
    if psi is not None and not lengths:
        raise InputError("psi", "the program does not say how long a recording is", fix="Fix the steps of its phase.")
    return lengths[0] if lengths else 1


def _lists(rows: list[ByteArray]) -> tuple[IntArray, npt.NDArray[np.int32]]:
    """Return the events of several inputs, (rows, lines) each, as lists, input after input."""
    first, lines, before = [], [np.empty(0, dtype=np.int64)], 0
    for array in rows:
        row, line = np.nonzero(array)
        first.append(before + np.searchsorted(row, np.arange(len(array) + 1)))
        lines.append(line)
        before += len(line)
    return np.stack(first, axis=1), np.concatenate(lines).astype(np.int32)
