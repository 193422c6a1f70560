"""A network in the integers of a Xylo, together with the populations and scales that they came from."""

from hw_model.values import FloatArray, IntArray, Shown
from hw_model.xylo.network import XyloNetwork
from locsnn_compile.network.network import Population
from locsnn_compile.xylo.parts import XyloParts


class XyloScales(Shown):
    """How many units of the chip's registers 1 in the float network becomes, per neuron, (n,).

    ``current`` is for weights, ``potential`` for thresholds and biases. They differ because the response to a spike has
    another peak on the chip than in the float neuron. At ``level``, the largest weight of a neuron is 127 * 2^level
    units.
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
        """The hidden populations, then the outputs."""
        return (*self.parts.hidden, self.parts.outputs)

    def scales_of(self, name: str) -> FloatArray:
        """Return the potential scale of each neuron of a population, (n,)."""
        if name == self.parts.outputs.name:
            return self.output_scales.potential
        return self.hidden_scales.potential[self.place(name)]

    def place(self, name: str) -> slice:
        """Return the place of a hidden population among all hidden neurons."""
        return places(self.parts.hidden)[name]

    def dashes_of(self, name: str) -> tuple[IntArray, IntArray]:
        """Return the dashes (stored decays) of current and potential of a population's neurons, (n,) each."""
        if name == self.parts.outputs.name:
            outputs = self.network.outputs
            return outputs.dash_syn[:, 0], outputs.dash_mem
        place = self.place(name)
        return self.network.hidden.dash_syn[place, 0], self.network.hidden.dash_mem[place]


def places(populations: tuple[Population, ...]) -> dict[str, slice]:
    """Return the place of each population's neurons if the populations follow one another."""
    first = 0
    place_of: dict[str, slice] = {}
    for population in populations:
        place_of[population.name] = slice(first, first + population.size)
        first += population.size
    return place_of
