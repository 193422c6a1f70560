"""The Lava processes of one phase: LIF processes, the synapses onto them, and the sources that spike.

A LIF process has one threshold and one pair of decays, so a population becomes one for each triple
that its compartments have. A Dense process has one format and, for a pair of ends, one synapse: what
a program connects twice becomes two processes. Lava runs only what is connected to the process that
it is told to run, so a phase falls into parts, each of which has a run of its own.
"""

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from hw_model.arithmetic.fixed_point import SignMode
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import Frozen, IntArray

SIGN_MODES: tuple[SignMode, ...] = ("mixed", "excitatory", "inhibitory")
"""As numbers in :attr:`SynapseTable.sign`."""


class LavaNeurons(Frozen, eq=False):
    """A LIF process. ``index`` and biases are (neurons,).

    ``population[index]`` are the compartments that it plays. ``du`` and ``dv`` are Lava's registers:
    its currents lose du + 1 parts of 4096 in a step, its potentials dv.
    """

    population: str
    index: IntArray
    du: int
    dv: int
    vth: int
    bias_mantissa: IntArray
    bias_exponent: IntArray


class LavaSource(Frozen, eq=False):
    """A source that plays the lines of an input: ``columns`` (lines,) are theirs in the phase."""

    input: str
    columns: IntArray


class LavaSynapses(Frozen, eq=False):
    """A Dense process; with a delay other than 0, a DelayDense.

    ``sender`` and ``target`` number the nodes of a part: its sources first, then its LIF processes.
    ``weights`` are mantissas and ``delays`` steps, each (targets, senders).
    """

    sender: int
    target: int
    weights: IntArray
    delays: IntArray
    exponent: int
    weight_bits: int
    sign_mode: SignMode


class LavaPart(Frozen, eq=False):
    """What runs together: a connected part of a phase."""

    phase: str
    sources: tuple[LavaSource, ...]
    neurons: tuple[LavaNeurons, ...]
    synapses: tuple[LavaSynapses, ...]


class SynapseTable(Frozen, eq=False):
    """All synapses of a phase, one by one, each array (synapses,).

    Ends are numbered as in :attr:`~hw_model.program.chip_program.ChipProgram.senders`: input lines
    first, then compartments by their column.
    """

    sender: IntArray
    target: IntArray
    mantissa: IntArray
    delay: IntArray
    exponent: IntArray
    weight_bits: IntArray
    sign: IntArray


class PhaseProcesses:
    """Finds the processes of one phase of a program."""

    def __init__(self, program: ChipProgram, phase: str) -> None:
        self._program = program
        self._phase = phase
        self._lines = program.lines_of(phase)
        self._line_count = max((lines.stop for lines in self._lines.values()), default=0)

    def parts(self) -> Iterator[LavaPart]:
        """Yield the connected parts that hold neurons, in the order of their first node."""
        sources = self._sources()
        neurons = self._neurons()
        synapses = tuple(self._synapses())
        nodes = len(sources) + len(neurons)
        ends = (
            [block.sender for block in synapses],
            [block.target for block in synapses],
        )
        links = sparse.coo_array((np.ones(len(synapses)), ends), shape=(nodes, nodes))
        count, part_of = csgraph.connected_components(links, directed=False)
        for part in range(count):
            members = np.flatnonzero(part_of == part).tolist()
            if members[-1] < len(sources):
                continue  # an input that nothing listens to
            number = {node: place for place, node in enumerate(members)}
            yield LavaPart(
                self._phase,
                tuple(sources[node] for node in members if node < len(sources)),
                tuple(neurons[node - len(sources)] for node in members if node >= len(sources)),
                tuple(
                    LavaSynapses(
                        number[block.sender],
                        number[block.target],
                        block.weights,
                        block.delays,
                        block.exponent,
                        block.weight_bits,
                        block.sign_mode,
                    )
                    for block in synapses
                    if block.sender in number
                ),
            )

    def _sources(self) -> tuple[LavaSource, ...]:
        return tuple(
            LavaSource(name, np.arange(lines.start, lines.stop))
            for name, lines in self._lines.items()
        )

    def _by_column(self, name: str) -> IntArray:
        """Return a setting of every compartment of the phase, (columns,)."""
        return self._program.by_column(self._phase, lambda core: core.setting(name))

    @cached_property
    def _process_of_column(self) -> IntArray:
        """The LIF process of every compartment, (columns,), numbered population by population."""
        return self._settings[1]

    @cached_property
    def _settings(self) -> tuple[IntArray, IntArray]:
        """Population number, decays and threshold of each LIF process, and the process of a column."""
        columns = self._program.columns_of(self._phase)
        sizes = [place.stop - place.start for place in columns.values()]
        rows = (
            np.repeat(np.arange(len(sizes)), sizes),
            self._by_column("decay_u"),
            self._by_column("decay_v"),
            self._program.by_column(self._phase, _threshold_mantissas),
        )
        settings, process = np.unique(np.stack(rows, axis=1), axis=0, return_inverse=True)
        return settings, process.ravel()

    def _neurons(self) -> tuple[LavaNeurons, ...]:
        columns = self._program.columns_of(self._phase)
        names = list(columns)
        mantissa = self._program.by_column(self._phase, lambda core: core.bias_mantissa)
        exponent = self._program.by_column(self._phase, lambda core: core.bias_exponent)
        settings, process_of_column = self._settings
        processes = []
        for process, (population, decay_u, decay_v, threshold) in enumerate(settings.tolist()):
            held = np.flatnonzero(process_of_column == process)
            name = names[population]
            processes.append(
                LavaNeurons(
                    name,
                    held - columns[name].start,
                    du=decay_u - 1,
                    dv=decay_v,
                    vth=threshold,
                    bias_mantissa=mantissa[held],
                    bias_exponent=exponent[held],
                )
            )
        return tuple(processes)

    def _nodes(self) -> tuple[IntArray, IntArray]:
        """Return the node of every line and compartment, and its place in that node."""
        sources = self._sources()
        node = [np.full(len(source.columns), k) for k, source in enumerate(sources)]
        place = [np.arange(len(source.columns)) for source in sources]
        process = self._process_of_column
        within = np.empty(len(process), dtype=np.int64)
        for number in np.unique(process):
            held = np.flatnonzero(process == number)
            within[held] = np.arange(len(held))
        return (
            np.concatenate([*node, process + len(sources)]),
            np.concatenate([*place, within]),
        )

    def _synapses(self) -> Iterator[LavaSynapses]:
        """Yield a block for each pair of nodes and format; its ends count all nodes of the phase."""
        table = self._table()
        node, place = self._nodes()
        keys = np.stack(
            (
                node[table.sender],
                node[table.target],
                table.exponent,
                table.weight_bits,
                table.sign,
                _repeats(table),
            ),
            axis=1,
        )
        blocks, block_of = np.unique(keys, axis=0, return_inverse=True)
        sizes = np.bincount(node)
        for number, block in enumerate(blocks.tolist()):
            sender, target, exponent, weight_bits, sign, _ = block
            held = np.flatnonzero(block_of.ravel() == number)
            ends = place[table.target[held]], place[table.sender[held]]
            weights = np.zeros((sizes[target], sizes[sender]), dtype=np.int64)
            weights[ends] = table.mantissa[held]
            delays = np.zeros_like(weights)
            delays[ends] = table.delay[held]
            yield LavaSynapses(
                sender, target, weights, delays, exponent, weight_bits, SIGN_MODES[sign]
            )

    def _table(self) -> SynapseTable:
        parts = [self._of_core(core) for core in self._program.cores_of(self._phase)]
        return SynapseTable(*np.concatenate(parts, axis=1))

    def _of_core(self, core: Core) -> IntArray:
        """Return the columns of :class:`SynapseTable` for one core, (7, synapses)."""
        axons = core.axons
        forms = [
            (form.exponent, form.weight_bits, SIGN_MODES.index(form.sign_mode))
            for form in axons.formats
        ]
        of_synapse = np.array(forms, dtype=np.int64).reshape(-1, 3)[axons.format_index]
        ends = (
            self._program.senders[core.number][axons.axon_of_synapse],
            self._line_count + self._program.columns_of_core(core)[axons.target],
        )
        return np.stack((*ends, axons.mantissa, axons.delay, *of_synapse.T)).astype(np.int64)


def _threshold_mantissas(core: Core) -> IntArray:
    mantissas: IntArray = np.array(core.thresholds, dtype=np.int64)[core.threshold]
    return mantissas


def _repeats(table: SynapseTable) -> IntArray:
    """Count for each synapse how many before it have the same ends and format, (synapses,)."""
    keys = np.stack(
        (table.sender, table.target, table.exponent, table.weight_bits, table.sign), axis=1
    )
    _, group, sizes = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    order = np.argsort(group.ravel(), kind="stable")
    first = np.repeat(np.cumsum(sizes) - sizes, sizes)
    repeats = np.empty(len(order), dtype=np.int64)
    repeats[order] = np.arange(len(order)) - first
    return repeats
