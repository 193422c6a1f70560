"""What is seen of recordings on both sides: the float reference and the chip.

Match, error budget, cause, margins, excerpt and viewer are functions of an :class:`Observed`, so
that a side plays no recording anew for each of them.
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
"""Most neurons times steps of a sample whose registers are remembered; each takes some 24 bytes.

A larger sample is played again by whoever asks for it.
"""


class Observation(Frozen, eq=False):
    """A batch of recordings on both sides; each side plays them when it is first asked.

    - ``recordings`` (batch, steps, channels) have the network's own steps and channels
    - ``registers``: whether registers are kept besides spikes
    - ``known_reference``: what the float network does, if it played them before
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
    ``labels`` (samples,) are classes of it, or None. ``source`` names them in messages. Raises
    ``InputError`` for labels that do not belong to them or to the network.
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
        seen = (self._with_registers(numbers[rows]) for rows in batches(len(numbers)))
        if len(numbers) * neuron_steps(self.network) <= REMEMBERED_NEURON_STEPS:
            self._remembered[numbers] = tuple(seen)
            yield from self._remembered[numbers]
        else:
            yield from seen

    def recording(self, number: int) -> Observation:
        """Return one recording with its registers."""
        (observation,) = self.closely((number,))
        return observation

    def _with_registers(self, numbers: tuple[int, ...]) -> Observation:
        played = self.recordings[list(numbers)]
        return Observation(self.levels.quantized, self.levels.program, played, registers=True)


def neuron_steps(network: Network) -> int:
    """Return neurons times steps of one recording, the cost of evaluating it."""
    return sum(
        population.size * network.steps_of(population.phase) for population in network.populations
    )


def check_labels(network: Network, labels: IntArray | None, samples: int, source: str) -> None:
    """Refuse labels (samples,) that are not classes of the network, or too few or many."""
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
