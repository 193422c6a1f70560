"""One phase of a program as a network file of SANA-FE: neuron groups, edges, and where each neuron is mapped.

A group of compartments is a group of neurons, under a name that SANA-FE allows; ``<input>_tile<n>`` are the input lines
that reach tile n, in ascending order. Weights and thresholds are mantissas, so a potential is v in units.

An input spike is a spike of a neuron of the host's core, which every tile has next to its own ones, see
:mod:`locsnn_compile.backends.sanafe.architecture`. So an input has one group of neurons for each tile that it reaches.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import groupby

import numpy as np

from hw_model.arithmetic import loihi, loihi_inverse
from hw_model.mapping.graph import Input
from hw_model.program.chip_program import Core
from hw_model.values import ByteArray, Frozen, IntArray
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


class _TileInput(Frozen, eq=False):
    """The lines (n,) of an input that reach a tile, in ascending order; ``tile`` is SANA-FE's number."""

    input: Input
    tile: int
    lines: IntArray

    @property
    def label(self) -> str:
        """What the group is named after; by its null character, no population is called so."""
        return f"{self.input.name}\0tile{self.tile}"


class PhaseNetwork:
    """The network of one phase.

    If ``replayed``, compartments play back the spikes that the chip found, and weights are 0: so SANA-FE counts the
    traffic of a phase that its own neurons cannot compute.
    """

    def __init__(self, played: Played, phase: str, *, replayed: bool) -> None:
        self._played = played
        self._phase = phase
        self._replayed = replayed
        self._program = played.program
        self._cores = played.program.cores_of(phase)
        self._inputs = list(self._inputs_by_tile())
        labels = [reached.label for reached in self._inputs]
        self._names = unique_names([*labels, *played.program.columns_of(phase)])

    def lines_by_tile(self) -> dict[int, int]:
        """Return how many input lines each tile needs."""
        lines: Counter[int] = Counter()
        for reached in self._inputs:
            lines[reached.tile] += len(reached.lines)
        return dict(lines)

    def input_spikes(self) -> int:
        """Count the spikes of all input neurons; a line has a neuron on every tile that it reaches."""
        return sum(int(self._line_spikes(reached).sum()) for reached in self._inputs)

    def text(self) -> str:
        """Return the file."""
        rows = [
            "network:",
            f"  name: {unique_names([self._phase])[self._phase]}",
            "  groups:",
            *self._input_groups(),
            *self._compartment_groups(),
            "  edges:",
            *self._edges(),
            "mappings:",
            *self._input_mappings(),
            *self._compartment_mappings(),
        ]
        return "\n".join(rows) + "\n"

    def _inputs_by_tile(self) -> Iterator[_TileInput]:
        """Yield every input with each tile that it reaches, and the lines that reach it."""
        tile_of_core = np.array([self._tile(core) for core in self._program.cores], dtype=np.int64)
        for item in self._program.inputs_of(self._phase):
            route = self._program.route_of(item.name)
            tiles = tile_of_core[route.core]
            for tile in np.unique(tiles).tolist():
                yield _TileInput(item, tile, np.unique(route.line[tiles == tile]))

    def _line_spikes(self, reached: _TileInput) -> ByteArray:
        """Return the spikes of the lines of an input that reach a tile, (steps, lines)."""
        columns = self._program.lines_of(self._phase)[reached.input.name]
        return self._played.lines[self._phase][:, columns][:, reached.lines]

    def _tile(self, core: Core) -> int:
        return tile_number(self._program.chip, core.slot)

    def _input_groups(self) -> Iterator[str]:
        for reached in self._inputs:
            yield f"    - name: {self._names[reached.label]}"
            yield "      attributes: {log_spikes: true}"
            yield "      neurons:"
            for i, spikes in enumerate(self._line_spikes(reached).T):
                yield f"        - {i}: {_spike_list(spikes)}"

    def _compartment_groups(self) -> Iterator[str]:
        log_potential = str(not self._replayed).lower()
        for group, columns in self._program.columns_of(self._phase).items():
            yield f"    - name: {self._names[group]}"
            yield f"      attributes: {{log_spikes: true, log_potential: {log_potential}}}"
            yield "      neurons:"
            neurons = self._played_back(group) if self._replayed else self._settings(group)
            assert len(neurons) == columns.stop - columns.start
            # Neighbours with equal attributes are one row, as most neurons of a group are alike.
            start = 0
            for attributes, alike in groupby(neurons):
                stop = start + len(list(alike))
                yield f"        - {start}..{stop - 1}: {attributes}"
                start = stop

    def _played_back(self, group: str) -> list[str]:
        """Return the attributes of every neuron of a group, in order, for its spikes to be played back."""
        if group not in self._played.result.spikes:
            # What is joined to a parent never spikes itself, so nothing is recorded of it.
            silent = np.zeros(self._played.steps(self._phase), dtype=np.uint8)
            return [_spike_list(silent)] * self._program.populations[group]
        spikes = self._played.recorded(self._phase, "spikes", group)
        return [_spike_list(spikes_of_neuron) for spikes_of_neuron in spikes.T]

    def _settings(self, group: str) -> list[str]:
        """Return the attributes of every neuron of a group, in order, for it to be computed."""
        columns = self._program.columns_of(self._phase)[group]

        def of_group(values: Callable[[Core], IntArray | int]) -> list[int]:
            of_neurons: list[int] = self._program.by_column(self._phase, values)[columns].tolist()
            return of_neurons

        neurons = zip(
            of_group(lambda core: core.setting("decay_u")),
            of_group(lambda core: core.setting("decay_v")),
            of_group(lambda core: loihi.whole_units(core.threshold_voltage)),
            of_group(lambda core: core.bias),
            of_group(lambda core: core.vmin),
            strict=True,
        )
        return [
            f"{{soma: {{input_decay: {loihi_inverse.share_kept(decay_u)!r}, "
            f"leak_decay: {loihi_inverse.share_kept(decay_v)!r}, "
            f"threshold: {threshold}, bias: {loihi.in_units(bias)!r}, reset: {AFTER_SPIKE!r}, "
            f"reverse_threshold: {loihi.in_units(vmin)!r}, reverse_reset_mode: saturate}}}}"
            for decay_u, decay_v, threshold, bias, vmin in neurons
        ]

    def _edges(self) -> Iterator[str]:
        for core in self._cores:
            sources = self._sources(core)
            targets = self._neurons(core)
            axons = core.axons
            synapses = zip(
                axons.axon_of_synapse.tolist(),
                axons.target.tolist(),
                loihi.whole_units(core.effective_weights).tolist(),
                axons.delay.tolist(),
                strict=True,
            )
            for axon, target, weight, delay in synapses:
                if self._replayed:
                    attributes = "weight: 0"
                else:
                    attributes = f"weight: {weight}, delay: {delay}"
                yield f"    - {sources[axon]} -> {targets[target]}: {{{attributes}}}"

    def _sources(self, core: Core) -> list[str]:
        """Return the neuron behind each input axon of a core: an input line on its tile, or a compartment."""
        sources = [""] * core.axons.input_axons
        for axon, neuron in (*self._lines_onto(core), *self._compartments_onto(core)):
            sources[axon] = neuron
        return sources

    def _lines_onto(self, core: Core) -> Iterator[tuple[int, str]]:
        """Yield each input axon of a core that an input line reaches, with the neuron of the line."""
        for reached in self._inputs:
            if reached.tile != self._tile(core):
                continue
            route = self._program.route_of(reached.input.name)
            to_core = route.core == core.number
            numbers = np.searchsorted(reached.lines, route.line[to_core])
            for axon, number in zip(route.axon[to_core].tolist(), numbers.tolist(), strict=True):
                yield axon, f"{self._names[reached.label]}.{number}"

    def _compartments_onto(self, core: Core) -> Iterator[tuple[int, str]]:
        """Yield each input axon of a core that a compartment reaches, with the neuron of the compartment."""
        for sender in self._cores:
            neurons = self._neurons(sender)
            axons = sender.axons
            for k in np.flatnonzero(axons.out_core == core.number).tolist():
                yield int(axons.out_axon[k]), neurons[axons.out_compartment[k]]

    def _neurons(self, core: Core) -> list[str]:
        """Return the neuron of every compartment of a core."""
        return [
            f"{self._names[part.group]}.{i}"
            for part in core.slices
            for i in range(part.start, part.stop)
        ]

    def _input_mappings(self) -> Iterator[str]:
        # The host's core of a tile comes after its own ones, and each line there has a soma.
        host_core = self._program.chip.mesh.cores_per_tile
        somas_in_use: Counter[int] = Counter()
        for reached in self._inputs:
            name = self._names[reached.label]
            tile = reached.tile
            for i in range(len(reached.lines)):
                soma = f"{LINE}[{somas_in_use[tile]}]"
                yield f'  - {name}.{i}: {{core: {tile}.{host_core}, soma: "{soma}"}}'
                somas_in_use[tile] += 1

    def _compartment_mappings(self) -> Iterator[str]:
        cores_per_tile = self._program.chip.mesh.cores_per_tile
        for core in self._cores:
            place = f"core: {self._tile(core)}.{core.slot % cores_per_tile}"
            units = f"{place}, synapse: {SYNAPSE}, dendrite: {DENDRITE}"
            for part in core.slices:
                name = self._names[part.group]
                if self._replayed:
                    # Spikes to play back belong to a soma: each compartment needs its own.
                    for i in range(part.size):
                        soma = f"{REPLAY}[{part.offset + i}]"
                        yield f'  - {name}.{part.start + i}: {{{units}, soma: "{soma}"}}'
                else:
                    last = part.stop - 1
                    yield f"  - {name}.{part.start}..{last}: {{{units}, soma: {SOMA}}}"


def _spike_list(spikes: ByteArray | IntArray) -> str:
    return f"{{spikes: [{', '.join(map(str, spikes.tolist()))}]}}"
