"""Turn one phase of a program into Lava processes: LIF neurons, Dense synapses onto them, and sources of spikes.

A LIF process has one threshold and one pair of decays, so a population becomes as many processes as its compartments
have different triples of these. A Dense process has one format of weights and, for each pair of a sender and a target,
one synapse: a pair that the program connects twice takes two processes. Lava runs only what is connected to the process
that it is told to run, so a phase is cut into connected parts, each of which has a run of its own.

A column is the number of a compartment in arrays over the phase.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.sparse import csgraph

from hw_model.arithmetic.fixed_point import SIGN_MODES, SignMode
from hw_model.program.chip_program import ChipProgram, Core
from hw_model.values import Frozen, IntArray
from locsnn_compile.backends.lava.synapse_table import earlier_twins, synapses_of_phase


class LavaNeurons(Frozen, eq=False):
    """A LIF process. ``index`` and biases are (neurons,).

    It plays the compartments ``index`` of a population. ``du`` and ``dv`` are Lava's parameters: in a step, its
    currents lose ``du + 1`` parts of 4096, and its potentials ``dv`` parts.
    """

    population: str
    index: IntArray
    du: int
    dv: int
    vth: int
    bias_mantissa: IntArray
    bias_exponent: IntArray


class LavaSource(Frozen, eq=False):
    """A source that plays the lines of an input; ``columns`` (lines,) are their numbers among the phase's lines."""

    input: str
    columns: IntArray


class LavaSynapses(Frozen, eq=False):
    """A Dense process; with a delay other than 0, a DelayDense.

    It connects two nodes, which are sources and LIF processes: ``sender`` and ``target`` are their numbers, sources
    first. ``weights`` are mantissas and ``delays`` steps, each (neurons of the target, neurons of the sender).
    """

    sender: int
    target: int
    weights: IntArray
    delays: IntArray
    exponent: int
    weight_bits: int
    sign_mode: SignMode


class LavaPart(Frozen, eq=False):
    """A connected part of a phase, which runs alone; its synapses count only the nodes of the part."""

    phase: str
    sources: tuple[LavaSource, ...]
    neurons: tuple[LavaNeurons, ...]
    synapses: tuple[LavaSynapses, ...]


class _ProcessSettings(Frozen, eq=False):
    """Which LIF process plays each compartment of a phase, and the settings that a process has.

    - ``settings``: the number of the population, decay_u, decay_v and the threshold, (processes, 4)
    - ``process``: the process of each compartment, (columns,), numbered population by population
    """

    settings: IntArray
    process: IntArray


class _Places(Frozen, eq=False):
    """Which node has each sender of a phase; senders are input lines first, then compartments.

    ``node`` (senders,) is the number of a source or LIF process, ``index`` (senders,) the place of the sender in it.
    """

    node: IntArray
    index: IntArray


class PhaseProcesses:
    """The Lava processes of one phase of a program; :meth:`parts` gives them part by part."""

    def __init__(self, program: ChipProgram, phase: str) -> None:
        self._program = program
        self._phase = phase

    def parts(self) -> Iterator[LavaPart]:
        """Yield the connected parts that hold neurons, in the order of their first node."""
        sources = self._sources()
        neurons = self._neurons()
        synapses = tuple(self._synapses())
        for nodes in _connected_nodes(len(sources) + len(neurons), synapses):
            part_sources = tuple(sources[node] for node in nodes if node < len(sources))
            if len(part_sources) == len(nodes):
                # An input without synapses; there is nothing to run.
                continue
            # Nodes ascend, so sources come first.
            process_nodes = nodes[len(part_sources) :]
            yield LavaPart(
                self._phase,
                part_sources,
                tuple(neurons[node - len(sources)] for node in process_nodes),
                _numbered_within(nodes, synapses),
            )

    def _sources(self) -> tuple[LavaSource, ...]:
        lines = self._program.lines_of(self._phase)
        return tuple(
            LavaSource(name, np.arange(columns.start, columns.stop))
            for name, columns in lines.items()
        )

    def _neurons(self) -> tuple[LavaNeurons, ...]:
        """Return the LIF processes of the phase."""
        populations = self._program.columns_of(self._phase)
        names = list(populations)
        mantissa = self._program.by_column(self._phase, lambda core: core.bias_mantissa)
        exponent = self._program.by_column(self._phase, lambda core: core.bias_exponent)
        processes = []
        for process, setting in enumerate(self._process_settings.settings.tolist()):
            population, decay_u, decay_v, threshold = setting
            name = names[population]
            columns = np.flatnonzero(self._process_settings.process == process)
            processes.append(
                LavaNeurons(
                    population=name,
                    index=columns - populations[name].start,
                    du=decay_u - 1,  # Lava adds 1 to it
                    dv=decay_v,
                    vth=threshold,
                    bias_mantissa=mantissa[columns],
                    bias_exponent=exponent[columns],
                )
            )
        return tuple(processes)

    @cached_property
    def _process_settings(self) -> _ProcessSettings:
        """The processes: one for each different row of population, decays and threshold."""
        populations = self._program.columns_of(self._phase).values()
        sizes = [columns.stop - columns.start for columns in populations]
        setting_of_column = np.stack(
            (
                np.repeat(np.arange(len(sizes)), sizes),
                self._by_column("decay_u"),
                self._by_column("decay_v"),
                self._program.by_column(self._phase, _threshold_mantissas),
            ),
            axis=1,
        )
        settings, process = np.unique(setting_of_column, axis=0, return_inverse=True)
        # Some versions of numpy return the inverse as a column.
        return _ProcessSettings(settings, process.ravel())

    def _by_column(self, name: str) -> IntArray:
        """Return a setting of every compartment of the phase, (columns,)."""
        return self._program.by_column(self._phase, lambda core: core.setting(name))

    def _synapses(self) -> Iterator[LavaSynapses]:
        """Yield a Dense process for each pair of nodes and format; it counts all nodes of the phase."""
        table = synapses_of_phase(self._program, self._phase)
        places = self._places()
        # Synapses with equal rows fit one process. The last column is 0 for the first synapse between a sender and a
        # target, 1 for the second, and so on, as a process has one synapse for each such pair.
        block_keys = np.stack(
            (
                places.node[table.sender],
                places.node[table.target],
                table.exponent,
                table.weight_bits,
                table.sign,
                earlier_twins(table),
            ),
            axis=1,
        )
        blocks, block_of_synapse = np.unique(block_keys, axis=0, return_inverse=True)
        node_sizes = np.bincount(places.node)
        for number, block in enumerate(blocks.tolist()):
            sender, target, exponent, weight_bits, sign, _ = block
            synapse = np.flatnonzero(block_of_synapse.ravel() == number)
            row = places.index[table.target[synapse]]
            column = places.index[table.sender[synapse]]
            weights = np.zeros((node_sizes[target], node_sizes[sender]), dtype=np.int64)
            weights[row, column] = table.mantissa[synapse]
            delays = np.zeros_like(weights)
            delays[row, column] = table.delay[synapse]
            yield LavaSynapses(
                sender=sender,
                target=target,
                weights=weights,
                delays=delays,
                exponent=exponent,
                weight_bits=weight_bits,
                sign_mode=SIGN_MODES[sign],
            )

    def _places(self) -> _Places:
        """Return the node of each sender of the phase, and its place there."""
        sources = self._sources()
        process = self._process_settings.process
        nodes = [np.full(len(source.columns), node) for node, source in enumerate(sources)]
        indices = [np.arange(len(source.columns)) for source in sources]
        index_in_process = np.empty(len(process), dtype=np.int64)
        for number in np.unique(process):
            columns = np.flatnonzero(process == number)
            index_in_process[columns] = np.arange(len(columns))
        return _Places(
            node=np.concatenate([*nodes, process + len(sources)]),
            index=np.concatenate([*indices, index_in_process]),
        )


def _threshold_mantissas(core: Core) -> IntArray:
    """Return the threshold of each compartment of a core, (compartments,); the core stores each threshold once."""
    mantissas: IntArray = np.array(core.thresholds, dtype=np.int64)[core.threshold]
    return mantissas


def _connected_nodes(nodes: int, synapses: tuple[LavaSynapses, ...]) -> Iterator[list[int]]:
    """Yield the nodes of each connected part, in ascending order; ``nodes`` is the number of all nodes."""
    ends = ([block.sender for block in synapses], [block.target for block in synapses])
    links = sparse.coo_array((np.ones(len(synapses)), ends), shape=(nodes, nodes))
    parts, part_of_node = csgraph.connected_components(links, directed=False)
    for part in range(parts):
        yield np.flatnonzero(part_of_node == part).tolist()


def _numbered_within(
    nodes: list[int], synapses: tuple[LavaSynapses, ...]
) -> tuple[LavaSynapses, ...]:
    """Return the synapses among some nodes, with sender and target numbered by their place in ``nodes``."""
    place = {node: i for i, node in enumerate(nodes)}
    # Nodes are a connected part, so the target is one of them if the sender is.
    return tuple(
        replace(block, sender=place[block.sender], target=place[block.target])
        for block in synapses
        if block.sender in place
    )
