"""The second level: the same populations and projections, with only integers that the chip holds."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

from hw_model.mapping.graph import Readout
from hw_model.values import FloatArray, Frozen
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.network import Network, Population
from locsnn_compile.network.projections import ChipProjection

LEAST_WEIGHT = 1 << 14
"""Least weight of a readout of spikes and potentials: rounding to a whole number costs at most one part in 32,768."""


class KernelFit(Frozen):
    """How far the chip's integer responses are from the kernels of the float neuron, as shares of the kernels.

    ``input_max`` and ``input_rms`` concern the response to an input spike whose peak is at the threshold:
    the largest difference over the largest value of the kernel, and the root of the summed squares of the difference
    over those of the kernel. ``refractory_max`` and ``refractory_rms`` are the same for what an own spike takes from
    the potential; None if the neuron has no refractory kernel.
    """

    input_max: float
    input_rms: float
    refractory_max: float | None
    refractory_rms: float | None


class QuantizedPopulation(Frozen, eq=False):
    """A population of the network in the chip's integers.

    A potential of 1 in the float network is ``scale[i]`` in the registers of neuron i, (n,). ``fit`` is None if the
    population was on the grid from the start, in which case nothing was rounded and the scale is 1, or if the model has
    no measure of its fit.
    """

    population: Population
    neuron: ChipNeuron
    scale: FloatArray
    measure_fit: Callable[[], KernelFit | None] | None

    @cached_property
    def fit(self) -> KernelFit | None:
        """How well its neurons fit. It is measured on demand: nobody asks for strategies that are only compared."""
        return self.measure_fit() if self.measure_fit else None

    @property
    def strategy(self) -> str:
        """How neurons become compartments: by a strategy for SRM neurons, or ``native``, one compartment each."""
        own = self.neuron.strategy
        return "reset" if own == "native" and self.population.neuron.by_strategy else own

    @property
    def biases_lost(self) -> int:
        """The number of biases other than 0 that round to 0."""
        return int((self.population.neuron.biased & ~self.neuron.biased).sum())


class QuantizedNetwork(Frozen, eq=False):
    """A network in integers, with the structure and the views of ``network``.

    One projection of the network may become several here, whose weights add up. ``weights_pruned`` weights became 0.
    """

    network: Network
    populations: tuple[QuantizedPopulation, ...]
    projections: tuple[ChipProjection, ...]
    weights_pruned: int

    @property
    def strategy(self) -> str:
        """The strategies of its populations in order, each named once."""
        return ", ".join(dict.fromkeys(q.strategy for q in self.populations))

    @property
    def readout(self) -> Readout:
        """The readout of the integers that corresponds to the network's readout of floats.

        Potentials are added, but each population has its own scale, so all are brought to the scale of the first. If
        some populations give spikes and others potentials, a spike counts 1 and a potential 1 over its scale. Weights
        with more than a few bits are made whole, the least at least :data:`LEAST_WEIGHT`, so that sums are exact on any
        hardware.
        """
        readout, read = self.network.readout, self.network.readout.from_step
        mixed = isinstance(readout.potentials_from, tuple)
        scale = {name: float(self.population(name).scale.max()) for name in read}
        unit = 1.0 if mixed else next(iter(scale.values()), 1.0)
        weights = [w * unit / scale.get(name, 1.0) for name, w in readout.terms]
        if not all((w * LEAST_WEIGHT).is_integer() for w in weights):
            factor = LEAST_WEIGHT / min(abs(w) for w in weights if w)
            weights = [float(round(w * factor)) for w in weights]
        return replace(readout, weights=tuple(weights))

    @property
    def score_scale(self) -> float:
        """The class score of the integers that corresponds to a class score of 1 of the network of floats."""
        readout = self.readout
        rows = zip(readout.populations, readout.weights, self.network.readout.weights, strict=True)
        # The least weight is the one that was made whole without rounding.
        weights = [
            (abs(on_grid), abs(in_float), name) for name, on_grid, in_float in rows if on_grid
        ]
        least, in_float, name = min(weights, default=(1.0, 1.0, ""))
        reads_potentials = name in readout.from_step
        scale = float(self.population(name).scale.max()) if reads_potentials else 1.0
        return least / in_float * scale

    def on_grid(self) -> Network:
        """Return the network with these integers in it: when evaluated, it spikes as the program must, bit for bit."""
        populations = tuple(replace(q.population, neuron=q.neuron) for q in self.populations)
        return replace(
            self.network,
            populations=populations,
            projections=self.projections,
            readout=self.readout,
        )

    def population(self, name: str) -> QuantizedPopulation:
        """Return a population by name."""
        return next(q for q in self.populations if q.population.name == name)
