"""The ends of a NIR graph: the input lines, and the populations that are read out."""

from collections.abc import Mapping

from locsnn_compile.data.channels import Channels, image_channels
from locsnn_compile.errors import InputError
from locsnn_compile.frontends.nir.flat import NEURONS, PASSING, READOUTS, FlatGraph
from locsnn_compile.network.network import InputView

INPUTS = "nir/inputs"
"""The name of the one input view of a graph with several Inputs.

It has the lines of all of them, one after the other, in the order of their names, as HDF5 lists nodes."""


def input_view(flat: FlatGraph, where: str) -> InputView:
    """Return the view of a graph's inputs.

    Raises ``InputError`` for a graph without inputs or neurons, with an edge into an input, or with an integrator (I).
    """
    for name in flat.named("I"):
        what = "an integrator without leak or threshold overflows every register"
        raise InputError(
            f"{where}, node {name!r}", what, fix="Use an LI with a long tau, or an IF."
        )
    names = flat.named("Input")
    if not names:
        raise InputError(
            where, "a graph needs an Input", fix="Add an Input node before the first weights."
        )
    for name in names:
        for source in flat.sources[name]:
            raise InputError(
                f"{where}, node {name!r}",
                "an edge leads into an Input",
                measured=f"from {source!r}",
                fix="Connect it to the nodes that the Input feeds.",
            )
    if not flat.named(*NEURONS):
        raise InputError(where, "it has no neurons", fix="Export a network with LIF neurons.")
    lines = sum(flat.size(name) for name in names)
    view_name = names[0] if len(names) == 1 else INPUTS
    return InputView(view_name, "time", lines)


def image_of(flat: FlatGraph) -> Channels | None:
    """Return the pixels of an Input of shape (C, H, W); None for other shapes, and for several inputs."""
    inputs = flat.named("Input")
    if len(inputs) != 1:
        return None
    return image_channels(flat.shapes[inputs[0]])


def outputs_of(flat: FlatGraph, where: str) -> tuple[str, ...]:
    """Return the populations that are read out: those that reach an Output directly, or through a Flatten."""
    read_out: list[str] = []
    # Go back from the Outputs, through nodes that change nothing, to neurons. This ends, because ``flatten_graph``
    # refuses circles without a neuron.
    waiting = flat.named("Output")
    if not waiting:
        raise InputError(
            where, "a graph needs an Output", fix="Add an Output node behind the last neurons."
        )
    while waiting:
        name = waiting.pop(0)
        kind = flat.nodes[name].kind
        if kind in NEURONS:
            read_out.append(name)
        elif kind in PASSING and flat.sources[name]:
            waiting.extend(flat.sources[name])
        else:
            what = f"it outputs the values of {kind}, but the chip outputs spikes"
            fix = "End the graph in a LIF, or in an LI whose potential is read."
            raise InputError(f"{where}, node {name!r}", what, fix=fix)
    outputs = tuple(dict.fromkeys(read_out))
    sizes = {flat.size(name) for name in outputs}
    if len(sizes) > 1:
        raise InputError(
            where, "its outputs differ in size", measured=f"{sorted(sizes)}", fix="Keep one Output."
        )
    return outputs


def potentials_from(
    flat: FlatGraph, outputs: tuple[str, ...], depths: Mapping[str, int], where: str
) -> int | None:
    """Return the step from which potentials of readouts equal those of a framework; None if outputs spike.

    Here a spike takes one step per population, so earlier potentials belong to no step of the framework.
    """
    graded = [name for name in outputs if flat.nodes[name].kind in READOUTS]
    if graded and len(graded) < len(outputs):
        fix = "Keep outputs of one kind."
        raise InputError(
            f"{where}, node {graded[0]!r}", "some outputs are potentials, others spikes", fix=fix
        )
    return max(depths[name] for name in graded) if graded else None
