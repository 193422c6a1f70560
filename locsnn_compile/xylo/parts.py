"""Divide a network into the parts of a Xylo: input lines, hidden neurons and outputs.

Before: a checked ``Network``.
After:  ``XyloParts``. A network with anything that a Xylo does not have is refused; the error names it.

Functions ``_check_...`` raise ``TargetError`` for one kind of such things each.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from hw_model.arithmetic import xylo
from hw_model.errors import TargetError, counted, listed
from hw_model.values import BoolArray, FloatArray, Shown
from hw_model.xylo.chips import XyloChip
from locsnn_compile.network.check import check_network
from locsnn_compile.network.network import InputView, Network, Population
from locsnn_compile.network.neurons import Cuba, Leaky, SoftCuba, SrmAlpha
from locsnn_compile.network.projections import values_of
from locsnn_compile.network.xylo_neurons import XyloNeuron

MOST_LOST = 2.0**-0.5
"""Currents must lose less than this share per step. A dash d stands for a loss of 2^-d, and the dash is rounded in the
exponent, so a loss of 2^-0.5 or more would get dash 0: the current would lose everything before it acts."""
_EXACT = 1e-6
"""How much a neuron's drop may differ from a subtraction of the threshold, relative to the threshold. Chosen by hand:
room for parameters in float32."""


class XyloParts(Shown):
    """A network that fits the structure of a Xylo.

    ``view`` is its one input, ``hidden`` the populations that become the chip's hidden neurons, in network order, and
    ``outputs`` the population that is read out.
    """

    network: Network
    view: InputView
    hidden: tuple[Population, ...]
    outputs: Population

    @property
    def on_grid(self) -> bool:
        """Whether the network was trained in the integers of a Xylo, so that nothing has to be rounded."""
        return not self.network.has_float_weights


def check_fits_xylo(chip: XyloChip, network: Network) -> None:
    """Raise ``TargetError`` for a network that has something that a Xylo does not have, or too much of something."""
    check_network(network)
    parts_of(network, chip)


def parts_of(network: Network, chip: XyloChip) -> XyloParts:
    """Return the parts of a network; a ``TargetError`` names the first thing that the chip does not have."""
    for check in _CHECKS_OF_NETWORK:
        check(network)
    # `_check_readout` has made sure that there is just one.
    (output_name,) = network.readout.populations
    parts = XyloParts(
        network=network,
        view=network.views[0],
        hidden=tuple(p for p in network.populations if p.name != output_name),
        outputs=network.population(output_name),
    )
    _check_outputs(parts)
    _check_sizes(parts, chip)
    return parts


def _check_axes(network: Network) -> None:
    """Refuse location phases, and more than one phase."""
    for population in network.populations:
        if population.axis != "time":
            what = "it steps over locations, and a Xylo steps over time alone"
            fix = "Give a network with a time branch only."
            raise TargetError(population.where, what, fix=fix)
    phases = [phase.name for phase in network.phases]
    if len(phases) > 1:
        what = "a Xylo plays a recording once, in one phase"
        raise TargetError(
            f"model {network.name!r}",
            what,
            measured=f"{listed(phases)} against 1 phase",
            fix="Compile one branch at a time.",
        )


def _check_views(network: Network) -> None:
    """Refuse more than one input, and recordings that start at the first touch."""
    if len(network.views) > 1:
        measured = f"{counted(len(network.views), 'input')} against 1"
        what = "a Xylo hears a recording in one way"
        raise TargetError(
            f"model {network.name!r}", what, measured=measured, fix="Join the inputs into one."
        )
    view = network.views[0]
    if view.align_events is not None:
        what = "it starts at the first touch, and a Xylo starts with the recording"
        raise TargetError(view.where, what, fix="Train without aligning recordings.")


def _check_neurons(network: Network) -> None:
    """Refuse neurons that the chip does not have. Neurons in the chip's own integers need fewer checks."""
    for population in network.populations:
        neuron = population.neuron
        if isinstance(neuron, XyloNeuron):
            _check_spikes(network, population, neuron)
            continue
        if isinstance(neuron, SrmAlpha):
            what = "its neurons have spike response kernels, and those of a Xylo leak"
            fix = "Give a network of leaky neurons with a current."
            raise TargetError(population.where, what, fix=fix)
        if neuron.on_grid:
            what = "its parameters are integers of a chip with another arithmetic"
            fix = (
                "Give the network in float, as it was before it was rounded or trained in integers."
            )
            raise TargetError(population.where, what, fix=fix)
        if not isinstance(neuron, Cuba | SoftCuba):
            what = f"a Xylo has no neurons like {type(neuron).__name__}"
            fix = "Give Cuba or SoftCuba neurons."
            raise TargetError(population.where, what, fix=fix)
        _check_decays(population, neuron, has_inputs=bool(network.into(population.name)))
        _check_reset(population, neuron)


def _check_spikes(network: Network, population: Population, neuron: XyloNeuron) -> None:
    """Refuse neurons trained in a Xylo's integers next to float ones, or with another limit of spikes per step.

    The chip's limit is 31 for a hidden neuron, and 1 for an output.
    """
    if network.has_float_weights:
        what = "it has the integers of a Xylo, and other populations are in float"
        raise TargetError(population.where, what, fix="Give all populations in one kind of number.")
    most_spikes = xylo.HIDDEN_SPIKES_MAX
    if population.name in network.readout.populations:
        most_spikes = xylo.OUTPUT_SPIKES_MAX
    if neuron.most_spikes != most_spikes:
        what = "its neurons may spike another number of times in a step than a Xylo's"
        measured = f"{neuron.most_spikes} against {most_spikes}"
        raise TargetError(population.where, what, measured=measured, fix=f"Give {most_spikes}.")


def _check_reset(population: Population, neuron: Cuba | SoftCuba) -> None:
    """Refuse resets, floors and refractory steps that a Xylo does not have."""
    if neuron.has_floor:
        what = "its potential has a floor, and on a Xylo only the end of a register stops it"
        raise TargetError(population.where, what, fix="Train without a floor.")
    if isinstance(neuron, SoftCuba):
        _check_drop(population, neuron)
        return
    longest = int(np.max(neuron.refractory))
    if longest > 1:
        what = "its neurons rest after a spike, and those of a Xylo have no refractory steps"
        measured = f"{counted(longest - 1, 'step')} against 0"
        fix = "Train without a refractory period."
        raise TargetError(population.where, what, measured=measured, fix=fix)
    # With a decay of 1, the potential is forgotten in every step anyway, so a reset to 0 is no difference.
    if np.any(neuron.decay_v < 1):
        what = "a spike resets its potential to 0, and on a Xylo it subtracts the threshold"
        fix = "Read a NIR graph with --reset subtract, or give SoftCuba neurons."
        raise TargetError(population.where, what, fix=fix)


def _check_decays(population: Population, neuron: Leaky, *, has_inputs: bool) -> None:
    """Refuse decays that are too far from those that the chip has.

    Without inputs, the current is always 0, so that its decay does not matter.
    """
    for name, decay in (("current", neuron.decay_u), ("potential", neuron.decay_v)):
        if np.any(decay == 0):
            what = f"its {name} never decays, and on a Xylo every {name} does"
            fix = "Train with a finite time constant."
            raise TargetError(population.where, what, fix=fix)
    largest_loss = float(np.max(neuron.decay_u))
    if largest_loss >= MOST_LOST and has_inputs:
        what = "its current decays faster than one of a Xylo, which keeps half of it or more"
        measured = f"a step loses {largest_loss:.4g} against less than {MOST_LOST:.4g}"
        fix = "Train neurons with a synaptic current, or give a smaller step (--dt)."
        raise TargetError(population.where, what, measured=measured, fix=fix)


def _check_drop(population: Population, neuron: SoftCuba) -> None:
    """Refuse soft resets that are no subtraction of the threshold.

    A Xylo subtracts the threshold in the step of the spike. A SoftCuba neuron subtracts ``drop`` in the next step,
    after the decay; both are equal if the drop is the decayed threshold.
    """
    decayed_threshold = (1 - neuron.decay_v) * neuron.threshold
    differs = np.abs(neuron.drop - decayed_threshold) > _EXACT * neuron.threshold
    if not differs.any():
        return
    first = int(np.flatnonzero(differs)[0])
    measured = f"{neuron.drop[first]:.4g} against {decayed_threshold[first]:.4g} in neuron {first}"
    what = "what a spike takes from the next potential is not the decayed threshold"
    fix = "Read a NIR graph with --reset subtract, or give drop = (1 - decay_v) * threshold."
    raise TargetError(population.where, what, measured=measured, fix=fix)


def _check_delays(network: Network) -> None:
    """Refuse delays."""
    for projection in network.projections:
        longest = int(np.max(projection.delay, initial=0))
        # A delay of synapses that are all 0 delays nothing.
        if longest and values_of(projection.held).any():
            what = "its spikes arrive late, and a Xylo has no delays"
            measured = f"{counted(longest, 'step')} against 0"
            raise TargetError(
                projection.where, what, measured=measured, fix="Train without delays."
            )


def _check_readout(network: Network) -> None:
    """Refuse several output populations, and a readout of potentials."""
    readout = network.readout
    if len(readout.populations) > 1:
        names = listed([repr(name) for name in readout.populations])
        what = "several populations give spikes to the scores, and a Xylo has one of outputs"
        fix = "Give a network with one output population."
        raise TargetError("readout", what, measured=names, fix=fix)
    if readout.from_step:
        what = "it reads potentials, and a Xylo sends spikes"
        fix = "End the network in neurons that spike, such as CubaLIF instead of LI or CubaLI."
        raise TargetError("readout", what, fix=fix)


_CHECKS_OF_NETWORK: tuple[Callable[[Network], Any], ...] = (
    _check_axes,
    _check_views,
    _check_neurons,
    _check_delays,
    _check_readout,
)


def _check_outputs(parts: XyloParts) -> None:
    """Refuse synapses onto outputs from anything but hidden neurons, and synapses from outputs."""
    hidden = {population.name for population in parts.hidden}
    for projection in parts.network.projections:
        if projection.target == parts.outputs.name and projection.source not in hidden:
            what = "outputs of a Xylo hear hidden neurons only"
            fix = "Put a hidden layer in between."
            if projection.source == parts.outputs.name:
                fix = (
                    "End the network in neurons without synapses among themselves, such as CubaLIF."
                )
            raise TargetError(projection.where, what, fix=fix)
        if projection.source == parts.outputs.name:
            what = "outputs of a Xylo send spikes to nothing on the chip"
            fix = "Read out a population behind it."
            raise TargetError(projection.where, what, fix=fix)


def _check_sizes(parts: XyloParts, chip: XyloChip) -> None:
    """Refuse more inputs, hidden neurons or outputs than the chip has."""
    inputs = parts.view.lines
    if inputs > chip.inputs:
        fix = (
            "Train on fewer channels: merge polarities (--merge-polarities), "
            f"or neighbours (--merge-channels {chip.inputs})."
        )
        raise TargetError(
            chip.name,
            "too many inputs",
            measured=f"{inputs} against {chip.inputs}",
            fix=fix,
        )
    neurons = sum(population.size for population in parts.hidden)
    if neurons > chip.hidden:
        largest = max(parts.hidden, key=lambda population: population.size)
        measured = f"{neurons} against {chip.hidden}, of which {largest.name!r} has {largest.size}"
        fix = "Train smaller layers, or convolutions with a larger stride or fewer channels."
        raise TargetError(chip.name, "too many hidden neurons", measured=measured, fix=fix)
    outputs = parts.outputs.size
    if outputs > chip.outputs:
        measured = f"{outputs} against {chip.outputs}"
        fix = "Train with fewer classes, or for a Xylo with more outputs."
        raise TargetError(chip.name, "too many outputs", measured=measured, fix=fix)


class XyloNeurons(Shown):
    """The float parameters of the neurons of some populations, one population after the other, each (n,).

    A neuron spikes if v > threshold where ``strict``, else if v >= threshold.
    """

    decay_u: FloatArray
    decay_v: FloatArray
    threshold: FloatArray
    bias: FloatArray
    strict: BoolArray


def neurons_of(populations: tuple[Population, ...]) -> XyloNeurons:
    """Return the parameters of populations that :func:`parts_of` has accepted."""
    by_population = [_neurons(population) for population in populations]
    joined = {
        name: np.concatenate([getattr(neurons, name) for neurons in by_population])
        for name in XyloNeurons.__dataclass_fields__
    }
    return XyloNeurons(**joined)


def _neurons(population: Population) -> XyloNeurons:
    """Return the parameters of one population. SoftCuba neurons have no bias, and compare with v > threshold."""
    neuron = population.neuron
    assert isinstance(neuron, Cuba | SoftCuba)
    at_threshold = isinstance(neuron, Cuba) and neuron.rule == ">="
    return XyloNeurons(
        decay_u=neuron.decay_u,
        decay_v=neuron.decay_v,
        threshold=neuron.threshold,
        bias=neuron.bias if isinstance(neuron, Cuba) else np.zeros(population.size),
        strict=np.full(population.size, not at_threshold),
    )
