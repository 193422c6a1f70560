"""One phase of a program as a network file of SANA-FE: neuron groups, edges, and where each neuron is mapped.

A group of compartments is a group of neurons, under a name that SANA-FE allows; ``<input>_tile<n>`` are the input lines
that reach tile n, in ascending order. Weights and thresholds are mantissas, so a potential is v in units.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.mapping.graph import Input
from hw_model.program.chip_program import Core
from hw_model.values import ByteArray, IntArray
from locsnn_compile.backends.played import Played, unique_names
from locsnn_compile.backends.sanafe.architecture import (
    DENDRITE,
    LINE,
    REPLAY,
    SOMA,
    SYNAPSE,
    tile_number,
)
from locsnn_compile.backends.sanafe.rules import AFTER_SPIKE


class PhaseNetwork:
    """The network of one phase; if ``replayed``, compartments play their spikes back, and weights are 0."""

    def __init__(self, played: Played, phase: str, *, replayed: bool) -> None:
        self._played, self._phase, self._replayed = played, phase, replayed
        program = played.program
        self._program, self._cores = program, program.cores_of(phase)
        lines = [_lines_of(item, tile) for item, tile, _ in self._inputs()]
        self._names = unique_names([*lines, *program.columns_of(phase)])

    def lines_by_tile(self) -> dict[int, int]:
        """Return how many input lines each tile needs."""
        found: dict[int, int] = {}
        for _, tile, lines in self._inputs():
            found[tile] = found.get(tile, 0) + len(lines)
        return found

    def input_spikes(self) -> int:
        """Count the spikes of all input neurons; a line has a neuron on every tile that it reaches."""
        return sum(int(self._spikes_of(item)[:, lines].sum()) for item, _, lines in self._inputs())

    def text(self) -> str:
        """Return the file."""
        lines = [
            "network:",
            f"  name: {unique_names([self._phase])[self._phase]}",
            "  groups:",
            *self._groups(),
            "  edges:",
            *self._edges(),
            "mappings:",
            *self._mappings(),
        ]
        return "\n".join(lines) + "\n"

    def _inputs(self) -> Iterator[tuple[Input, int, IntArray]]:
        """Yield every input with each tile that it reaches, and the lines that reach it."""
        for item in self._program.inputs_of(self._phase):
            route = self._program.route_of(item.name)
            tiles = np.array([self._tile(core) for core in self._program.cores], dtype=np.int64)[
                route.core
            ]
            for tile in np.unique(tiles).tolist():
                yield item, tile, np.unique(route.line[tiles == tile])

    def _spikes_of(self, item: Input) -> ByteArray:
        """Return the spikes of an input's lines, (steps, lines)."""
        return self._played.lines[self._phase][:, self._program.lines_of(self._phase)[item.name]]

    def _tile(self, core: Core) -> int:
        return tile_number(self._program.chip, core.slot)

    def _groups(self) -> Iterator[str]:
        for item, tile, lines in self._inputs():
            yield f"    - name: {self._names[_lines_of(item, tile)]}"
            yield "      attributes: {log_spikes: true}"
            yield "      neurons:"
            for i, spikes in enumerate(self._spikes_of(item)[:, lines].T):
                yield f"        - {i}: {_spike_list(spikes)}"
        for group, columns in self._program.columns_of(self._phase).items():
            yield f"    - name: {self._names[group]}"
            yield f"      attributes: {{log_spikes: true, log_potential: {str(not self._replayed).lower()}}}"
            yield "      neurons:"
            settings = self._played_back(group) if self._replayed else self._settings(group)
            assert len(settings) == columns.stop - columns.start
            changes = [
                0,
                *(i for i in range(1, len(settings)) if settings[i] != settings[i - 1]),
                len(settings),
            ]
            for start, stop in pairwise(changes):
                yield f"        - {start}..{stop - 1}: {settings[start]}"

    def _played_back(self, group: str) -> list[str]:
        if group not in self._played.result.spikes:
            silent = np.zeros(self._played.steps(self._phase), dtype=np.uint8)
            return [_spike_list(silent)] * self._program.populations[group]
        return [
            _spike_list(column) for column in self._played.recorded(self._phase, "spikes", group).T
        ]

    def _settings(self, group: str) -> list[str]:
        """Return the attributes of every neuron of a group, in order."""
        here = self._program.columns_of(self._phase)[group]
        kept: tuple[Callable[[Core], IntArray | int], ...] = (
            lambda core: core.setting("decay_u"),
            lambda core: core.setting("decay_v"),
            lambda core: loihi.whole_units(core.threshold_voltage),
            lambda core: core.bias,
            lambda core: core.vmin,
        )
        rows = zip(
            *(self._program.by_column(self._phase, values)[here].tolist() for values in kept),
            strict=True,
        )
        return [
            f"{{soma: {{input_decay: {loihi_inverse.share_kept(decay_u)!r}, "
            f"leak_decay: {loihi_inverse.share_kept(decay_v)!r}, "
            f"threshold: {threshold}, bias: {loihi.in_units(bias)!r}, reset: {AFTER_SPIKE!r}, "
            f"reverse_threshold: {loihi.in_units(vmin)!r}, reverse_reset_mode: saturate}}}}"
            for decay_u, decay_v, threshold, bias, vmin in rows
        ]

    def _edges(self) -> Iterator[str]:
        for core in self._cores:
            sources, axons = self._sources(core), core.axons
            targets = self._neurons(core)
            weights = loihi.whole_units(core.effective_weights)
            axon = axons.axon_of_synapse.tolist()
            rows = zip(
                axon, axons.target.tolist(), weights.tolist(), axons.delay.tolist(), strict=True
            )
            for source, target, weight, delay in rows:
                held = f"weight: {weight}, delay: {delay}" if not self._replayed else "weight: 0"
                yield f"    - {sources[source]} -> {targets[target]}: {{{held}}}"

    def _sources(self, core: Core) -> list[str]:
        """Return the neuron behind each input axon of a core."""
        found = [""] * core.axons.input_axons
        for item, tile, lines in self._inputs():
            if tile == self._tile(core):
                route = self._program.route_of(item.name)
                here = route.core == core.number
                for axon, line in zip(
                    route.axon[here].tolist(), route.line[here].tolist(), strict=True
                ):
                    found[axon] = (
                        f"{self._names[_lines_of(item, tile)]}.{np.searchsorted(lines, line)}"
                    )
        for sender in self._cores:
            neurons, axons = self._neurons(sender), sender.axons
            for k in np.flatnonzero(axons.out_core == core.number).tolist():
                found[axons.out_axon[k]] = neurons[axons.out_compartment[k]]
        return found

    def _neurons(self, core: Core) -> list[str]:
        """Return the neuron of every compartment of a core."""
        return [f"{self._names[p.group]}.{i}" for p in core.slices for i in range(p.start, p.stop)]

    def _mappings(self) -> Iterator[str]:
        host = self._program.chip.mesh.cores_per_tile
        used: dict[int, int] = {}
        for item, tile, lines in self._inputs():
            for i in range(len(lines)):
                soma = f"{LINE}[{used.get(tile, 0)}]"
                yield f'  - {self._names[_lines_of(item, tile)]}.{i}: {{core: {tile}.{host}, soma: "{soma}"}}'
                used[tile] = used.get(tile, 0) + 1
        for core in self._cores:
            place = f"core: {self._tile(core)}.{core.slot % self._program.chip.mesh.cores_per_tile}"
            units = f"synapse: {SYNAPSE}, dendrite: {DENDRITE}"
            for piece in core.slices:
                name = self._names[piece.group]
                if self._replayed:
                    for i in range(piece.size):
                        soma = f"{REPLAY}[{piece.offset + i}]"
                        yield f'  - {name}.{piece.start + i}: {{{place}, {units}, soma: "{soma}"}}'
                else:
                    yield f"  - {name}.{piece.start}..{piece.stop - 1}: {{{place}, {units}, soma: {SOMA}}}"


def _lines_of(item: Input, tile: int) -> str:
    """Return what an input's lines on a tile are named after: by its null character, no population is called so."""
    return f"{item.name}\0tile{tile}"


def _spike_list(spikes: ByteArray) -> str:
    return f"{{spikes: [{', '.join(map(str, spikes.tolist()))}]}}"
