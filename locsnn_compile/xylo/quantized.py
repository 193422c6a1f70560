"""The integers of a Xylo next to the populations that they came from."""

from hw_model.values import FloatArray, IntArray, Shown
from hw_model.xylo.network import XyloNetwork
from locsnn_compile.network.network import Population
from locsnn_compile.xylo.parts import XyloParts


class XyloScales(Shown):
    """How many units of the registers the float network's units become, neuron by neuron, (n,).

    ``current``: of a weight. ``potential``: of a threshold and a bias. They differ because the
    chip's response to a spike has another peak than the float neuron's. ``level``: the largest
    weight of a neuron is 127 * 2^level units.
    """

    current: FloatArray
    potential: FloatArray
    level: int


class QuantizedXylo(Shown):
    """A network in the integers of a Xylo, and the scales that made them."""

    parts: XyloParts
    network: XyloNetwork
    hidden_scales: XyloScales
    output_scales: XyloScales

    @property
    def populations(self) -> tuple[Population, ...]:
        """Hidden populations, then that of the outputs."""
        return (*self.parts.hidden, self.parts.outputs)

    def scales_of(self, name: str) -> FloatArray:
        """Return the potential scale of each neuron of a population, (n,)."""
        if name == self.parts.outputs.name:
            return self.output_scales.potential
        return self.hidden_scales.potential[self.place(name)]

    def place(self, name: str) -> slice:
        """Return where a hidden population lies among the hidden neurons."""
        return places(self.parts.hidden)[name]

    def dashes_of(self, name: str) -> tuple[IntArray, IntArray]:
        """Return the dashes of current and potential of each neuron of a population, (n,) each."""
        if name == self.parts.outputs.name:
            outputs = self.network.outputs
            return outputs.dash_syn[:, 0], outputs.dash_mem
        place = self.place(name)
        return self.network.hidden.dash_syn[place, 0], self.network.hidden.dash_mem[place]


def places(populations: tuple[Population, ...]) -> dict[str, slice]:
    """Return where each population lies if they stand one after the other."""
    first = 0
    place: dict[str, slice] = {}
    for population in populations:
        place[population.name] = slice(first, first + population.size)
        first += population.size
    return place
