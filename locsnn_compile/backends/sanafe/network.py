"""Write one phase of a program as a network file of SANA-FE: neuron groups, edges, and the core of each neuron.

A group of compartments becomes a group of neurons, under a name that SANA-FE allows. Weights and thresholds are whole
units of :mod:`hw_model.arithmetic.loihi`, so a potential in SANA-FE is v in these units.

In SANA-FE only neurons can send spikes, so an input line is a neuron, too. It lies on the host's core, which every tile
has next to its own cores (:mod:`locsnn_compile.backends.sanafe.architecture`). A line that reaches several tiles is a
neuron on each of them: ``<input>_tile<n>`` is the group of the lines that reach tile n, in ascending order.
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
        """The text that the group is named after; no population has this name, because of the null character."""
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
        self._tile_inputs = list(self._inputs_by_tile())
        labels = [tile_input.label for tile_input in self._tile_inputs]
        self._names = unique_names([*labels, *played.program.columns_of(phase)])

    def lines_by_tile(self) -> dict[int, int]:
        """Return how many input lines each tile needs."""
        lines: Counter[int] = Counter()
        for tile_input in self._tile_inputs:
            lines[tile_input.tile] += len(tile_input.lines)
        return dict(lines)

    def input_spikes(self) -> int:
        """Count the spikes of all input neurons; a line has a neuron on every tile that it reaches."""
        return sum(int(self._line_spikes(tile_input).sum()) for tile_input in self._tile_inputs)

    def text(self) -> str:
        """Return the content of the file."""
        # Line by line rather than through a YAML library, which is slow for many edges.
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
        for phase_input in self._program.inputs_of(self._phase):
            route = self._program.route_of(phase_input.name)
            tiles = tile_of_core[route.core]
            for tile in np.unique(tiles).tolist():
                yield _TileInput(phase_input, tile, np.unique(route.line[tiles == tile]))

    def _line_spikes(self, tile_input: _TileInput) -> ByteArray:
        """Return the spikes of the lines of an input that reach a tile, (steps, lines)."""
        columns = self._program.lines_of(self._phase)[tile_input.input.name]
        return self._played.lines[self._phase][:, columns][:, tile_input.lines]

    def _tile(self, core: Core) -> int:
        return tile_number(self._program.chip, core.slot)

    def _input_groups(self) -> Iterator[str]:
        """Yield the rows that define the neurons of input lines, with the spikes that they play."""
        for tile_input in self._tile_inputs:
            yield f"    - name: {self._names[tile_input.label]}"
            yield "      attributes: {log_spikes: true}"
            yield "      neurons:"
            for i, spikes in enumerate(self._line_spikes(tile_input).T):
                yield f"        - {i}: {_spike_list(spikes)}"

    def _compartment_groups(self) -> Iterator[str]:
        """Yield the rows that define the neurons of compartments; replayed ones have no potential to log."""
        log_potential = str(not self._replayed).lower()
        for group, columns in self._program.columns_of(self._phase).items():
            yield f"    - name: {self._names[group]}"
            yield f"      attributes: {{log_spikes: true, log_potential: {log_potential}}}"
            yield "      neurons:"
            neurons = self._played_back(group) if self._replayed else self._settings(group)
            assert len(neurons) == columns.stop - columns.start
            # Neighbours with equal attributes are one row, as most neurons of a group are alike.
            start = 0
            for attributes, equal_neurons in groupby(neurons):
                stop = start + len(list(equal_neurons))
                yield f"        - {start}..{stop - 1}: {attributes}"
                start = stop

    def _played_back(self, group: str) -> list[str]:
        """Return the attributes of every neuron of a group, in order: the spikes that it plays back."""
        if group not in self._played.result.spikes:
            # Compartments that are joined to a parent never spike, so they are not in the result.
            silent = np.zeros(self._played.steps(self._phase), dtype=np.uint8)
            return [_spike_list(silent)] * self._program.populations[group]
        spikes = self._played.recorded(self._phase, "spikes", group)
        return [_spike_list(neuron_spikes) for neuron_spikes in spikes.T]

    def _settings(self, group: str) -> list[str]:
        """Return the attributes of every neuron of a group, in order: the settings by which it is computed."""
        columns = self._program.columns_of(self._phase)[group]

        def by_neuron(values: Callable[[Core], IntArray | int]) -> list[int]:
            group_values: list[int] = self._program.by_column(self._phase, values)[columns].tolist()
            return group_values

        neurons = zip(
            by_neuron(lambda core: core.setting("decay_u")),
            by_neuron(lambda core: core.setting("decay_v")),
            by_neuron(lambda core: loihi.whole_units(core.threshold_voltage)),
            by_neuron(lambda core: core.bias),
            by_neuron(lambda core: core.vmin),
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
        """Yield a row per synapse; in a phase that is replayed, weights are 0 and change nothing."""
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
        for tile_input in self._tile_inputs:
            if tile_input.tile != self._tile(core):
                continue
            route = self._program.route_of(tile_input.input.name)
            to_core = route.core == core.number
            # A line's neuron has the number of the line among those that reach the tile.
            numbers = np.searchsorted(tile_input.lines, route.line[to_core])
            for axon, number in zip(route.axon[to_core].tolist(), numbers.tolist(), strict=True):
                yield axon, f"{self._names[tile_input.label]}.{number}"

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
            f"{self._names[core_slice.group]}.{i}"
            for core_slice in core.slices
            for i in range(core_slice.start, core_slice.stop)
        ]

    def _input_mappings(self) -> Iterator[str]:
        """Yield the core and the soma of every neuron of an input line."""
        # The host's core of a tile comes after the cores of the chip, and each line there has a soma of its own.
        host_core = self._program.chip.mesh.cores_per_tile
        somas_in_use: Counter[int] = Counter()
        for tile_input in self._tile_inputs:
            name = self._names[tile_input.label]
            tile = tile_input.tile
            for i in range(len(tile_input.lines)):
                soma = f"{LINE}[{somas_in_use[tile]}]"
                yield f'  - {name}.{i}: {{core: {tile}.{host_core}, soma: "{soma}"}}'
                somas_in_use[tile] += 1

    def _compartment_mappings(self) -> Iterator[str]:
        """Yield the core and the units of every neuron of a compartment."""
        cores_per_tile = self._program.chip.mesh.cores_per_tile
        for core in self._cores:
            place = f"core: {self._tile(core)}.{core.slot % cores_per_tile}"
            units = f"{place}, synapse: {SYNAPSE}, dendrite: {DENDRITE}"
            for core_slice in core.slices:
                name = self._names[core_slice.group]
                if self._replayed:
                    # Spikes to play back belong to a soma: each compartment needs its own.
                    for i in range(core_slice.size):
                        soma = f"{REPLAY}[{core_slice.offset + i}]"
                        yield f'  - {name}.{core_slice.start + i}: {{{units}, soma: "{soma}"}}'
                else:
                    last = core_slice.stop - 1
                    yield f"  - {name}.{core_slice.start}..{last}: {{{units}, soma: {SOMA}}}"


def _spike_list(spikes: ByteArray | IntArray) -> str:
    """Return the attribute of a neuron that plays spikes: 0 or 1 for each step."""
    bits = ", ".join(map(str, spikes.tolist()))
    return f"{{spikes: [{bits}]}}"
