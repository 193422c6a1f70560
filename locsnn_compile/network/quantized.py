"""The second level of the compiler: the network's populations and projections in integers that the chip holds.

``passes.quantize`` makes it from a :class:`Network`, and ``passes.lower_neurons`` turns its neurons into compartments.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property

from hw_model.mapping.graph import Readout
from hw_model.values import FloatArray, Frozen
from locsnn_compile.network.chip_neurons import ChipNeuron
from locsnn_compile.network.network import Network, Population
from locsnn_compile.network.projections import ChipProjection

LEAST_WEIGHT = 1 << 14
"""Smallest weight when the weights of a readout are made whole: rounding then changes a weight by at most 1/32,768."""


class KernelFit(Frozen):
    """How far the chip's integer responses are from the kernels of the float neuron, as shares of the kernels.

    ``input_max`` and ``input_rms`` concern the response to an input spike whose peak is at the threshold:
    the largest difference divided by the largest value of the kernel, and the root of the summed squares of the
    difference divided by that of the kernel. ``refractory_max`` and ``refractory_rms`` are the same for what an own
    spike takes from the potential; None if the neuron has no refractory kernel.
    """

    input_max: float
    input_rms: float
    refractory_max: float | None
    refractory_rms: float | None


class QuantizedPopulation(Frozen, eq=False):
    """A population of the network in the chip's integers.

    A potential of 1 in the float network is ``scale[i]`` in the registers of neuron i, (n,). ``neuron`` is what the
    neurons of ``population`` became. ``fit`` is None if the population was on the grid from the start, in which case
    nothing was rounded and the scale is 1, or if the model has no measure of its fit.
    """

    population: Population
    neuron: ChipNeuron
    scale: FloatArray
    measure_fit: Callable[[], KernelFit | None] | None

    @cached_property
    def fit(self) -> KernelFit | None:
        """How well its neurons fit the float ones; measured on demand, since comparing strategies does not need it."""
        return self.measure_fit() if self.measure_fit else None

    @property
    def strategy(self) -> str:
        """The strategy by which neurons become compartments; ``native`` for models with one compartment anyway."""
        layout = self.neuron.strategy
        # An SRM neuron in a single compartment is there by strategy "reset".
        return "reset" if layout == "native" and self.population.neuron.by_strategy else layout

    @property
    def biases_lost(self) -> int:
        """The number of biases other than 0 that round to 0."""
        return int((self.population.neuron.biased & ~self.neuron.biased).sum())


class QuantizedNetwork(Frozen, eq=False):
    """A network in integers, with the structure and the views of ``network``.

    One projection of the network may become several, whose weights add up. ``weights_pruned`` counts the weights that
    became 0.
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
        some populations give spikes and others potentials, a spike counts 1, and a potential is divided by its scale.
        Weights that are not multiples of ``1 / LEAST_WEIGHT`` are made whole, the smallest becoming
        :data:`LEAST_WEIGHT`, so that sums are exact on any hardware.
        """
        readout = self.network.readout
        is_mixed = isinstance(readout.potentials_from, tuple)
        # A readout weighs whole populations, so the largest scale stands for all neurons of one.
        scale_of = {name: float(self.population(name).scale.max()) for name in readout.from_step}
        unit = 1.0 if is_mixed else next(iter(scale_of.values()), 1.0)
        weights = [weight * unit / scale_of.get(name, 1.0) for name, weight in readout.terms]
        if not all((weight * LEAST_WEIGHT).is_integer() for weight in weights):
            factor = LEAST_WEIGHT / min(abs(weight) for weight in weights if weight)
            weights = [float(round(weight * factor)) for weight in weights]
        return replace(readout, weights=tuple(weights))

    @property
    def score_scale(self) -> float:
        """The class score of the integers that corresponds to a class score of 1 in the float network.

        It turns differences between the scores of chip and reference into the reference's unit.
        """
        readout = self.readout
        rows = zip(readout.populations, readout.weights, self.network.readout.weights, strict=True)
        # The ratio is taken at the smallest weight, which was made whole without rounding.
        weights = [
            (abs(on_grid), abs(in_float), name) for name, on_grid, in_float in rows if on_grid
        ]
        least, in_float, name = min(weights, default=(1.0, 1.0, ""))
        reads_potentials = name in readout.from_step
        scale = float(self.population(name).scale.max()) if reads_potentials else 1.0
        return least / in_float * scale

    def on_grid(self) -> Network:
        """Return the network with these integers in it, whose spikes the program must equal, bit for bit."""
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
