"""Recordings played on both sides: by the float network (the *reference*) and by the program (the *chip*).

Match, error budget, cause, margins, excerpt and viewer all take an :class:`Observed`, which remembers small results, so
that recordings are not played again for each of them.
"""

from collections.abc import Iterator
from dataclasses import field
from functools import cached_property

import hw_model as hw
from hw_model.engine.probes import Kind
from hw_model.values import ByteArray, Frozen, IntArray, Shown
from locsnn_compile.data.recordings import batches
from locsnn_compile.errors import InputError, check_same
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedNetwork
from locsnn_compile.pipeline import Levels
from locsnn_compile.reference.evaluate import ReferenceResult, evaluate

REMEMBERED_NEURON_STEPS = 1 << 22
"""Largest number of neurons times steps of a sample whose registers are remembered: about 100 MB, at 24 bytes each.

A larger sample is played again whenever it is asked for.
"""


class Observation(Frozen, eq=False):
    """A batch of recordings on both sides; each side plays them when its result is first read.

    - ``recordings`` (batch, steps, channels) have the network's own steps and channels
    - ``registers``: whether registers and potentials are kept in addition to spikes
    - ``known_reference``: the float network's result, if it has played them before
    """

    quantized: QuantizedNetwork
    program: hw.ChipProgram
    recordings: ByteArray
    registers: bool = False
    known_reference: ReferenceResult | None = None

    def __len__(self) -> int:
        return len(self.recordings)

    @cached_property
    def reference(self) -> ReferenceResult:
        """Spikes and scores of the float network; with registers, its potentials as well."""
        if self.known_reference is not None:
            return self.known_reference
        chip_registers = self.program.chip.registers
        return evaluate(
            self.quantized.network,
            self.recordings,
            potentials=self.registers,
            registers=chip_registers,
        )

    @cached_property
    def chip(self) -> hw.SimulationResult:
        """Spikes, scores and activity of the program; with registers, u and potentials as well."""
        probe: tuple[Kind, ...] = ("spikes", "activity")
        if self.registers:
            probe += ("u", "potential")
        return hw.simulate(self.program, self.recordings, probe=probe)


class Observed(Shown):
    """Recordings, and both sides of a compiled network that play them.

    ``recordings`` (samples, steps, channels) have the network's own steps and channels, and
    ``labels`` (samples,) are classes of the network, or None. ``source`` names the recordings in messages. Raises
    ``InputError`` for labels that do not match the recordings or the network.
    """

    levels: Levels
    recordings: ByteArray
    labels: IntArray | None = None
    source: str = "array"
    _remembered: dict[tuple[int, ...], tuple[Observation, ...]] = field(
        default_factory=dict, init=False, repr=False
    )

    def __post_init__(self) -> None:
        check_labels(self.network, self.labels, len(self.recordings), self.source)

    def __len__(self) -> int:
        return len(self.recordings)

    @property
    def numbers(self) -> tuple[int, ...]:
        """The numbers of all recordings."""
        return tuple(range(len(self.recordings)))

    @property
    def network(self) -> Network:
        """The trained network."""
        return self.levels.network

    def closely(self, numbers: tuple[int, ...]) -> Iterator[Observation]:
        """Yield the recordings with these numbers, a batch at a time, with their registers."""
        if numbers in self._remembered:
            yield from self._remembered[numbers]
            return
        observations = (self._with_registers(numbers[rows]) for rows in batches(len(numbers)))
        if len(numbers) * neuron_steps(self.network) <= REMEMBERED_NEURON_STEPS:
            self._remembered[numbers] = tuple(observations)
            yield from self._remembered[numbers]
        else:
            yield from observations

    def recording(self, number: int) -> Observation:
        """Return one recording with its registers."""
        (observation,) = self.closely((number,))
        return observation

    def _with_registers(self, numbers: tuple[int, ...]) -> Observation:
        """Return a batch of the recordings with these numbers, which keeps registers."""
        played = self.recordings[list(numbers)]
        return Observation(self.levels.quantized, self.levels.program, played, registers=True)


def neuron_steps(network: Network) -> int:
    """Return the number of neurons times steps of one recording, to which the cost of evaluating it is proportional."""
    return sum(
        population.size * network.steps_of(population.phase) for population in network.populations
    )


def check_labels(network: Network, labels: IntArray | None, samples: int, source: str) -> None:
    """Raise ``InputError`` unless there is one label per recording, (samples,), each a class of the network."""
    if labels is None:
        return
    where = f"labels of {source!r}"
    fix = "Give one class number for every recording."
    check_same(labels.shape, (samples,), where, "there is not one label per recording", fix=fix)
    if labels.min() < 0 or labels.max() >= network.classes:
        measured = f"{labels.min()}..{labels.max()} against 0..{network.classes - 1}"
        fix = "Check that the events belong to this model."
        raise InputError(
            where, "a label is not one of the model's classes", measured=measured, fix=fix
        )
