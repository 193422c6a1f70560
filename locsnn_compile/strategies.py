"""How spike response neurons can be laid out on a chip: every strategy once, in the order in which they are tried.

Nothing here imports anything heavy, so that help and completion can say the names.
"""

from dataclasses import dataclass

NATIVE = "native"
"""What neurons are that the chip has as they are: they need no strategy."""
AUTO = "auto"
"""The cheapest strategy that loses no more than it may."""


@dataclass(frozen=True)
class Strategy:
    """``layout``: a neuron in compartments, in words; it has so many ``dendrites`` of each kind.

    ``trainable``: networks can be trained on its integers. A ``last_resort`` costs more than any other, with split
    weights or without: it is tried where no other keeps a budget, or where it is asked for.
    """

    layout: str
    dendrites: int = 1
    trainable: bool = True
    last_resort: bool = False


STRATEGIES = {
    "dendrite": Strategy("three joined compartments per neuron: alpha dendrite, refractory dendrite, memoryless soma"),
    "delay-line": Strategy("two joined compartments per neuron, the refractory kernel through delayed self-synapses"),
    "reset": Strategy("one compartment per neuron with the chip's own reset, an approximation"),
    "paired-dendrite": Strategy(
        "five joined compartments per neuron: dendrite with two dendrites of each kind, at a finer scale",
        dendrites=2,
        trainable=False,
        last_resort=True,
    ),
}
LAYOUTS = {name: strategy.layout for name, strategy in STRATEGIES.items()} | {
    NATIVE: "one compartment per neuron, as the model has it"
}
TRAINABLE = tuple(name for name, strategy in STRATEGIES.items() if strategy.trainable)
USUAL = tuple(name for name, strategy in STRATEGIES.items() if not strategy.last_resort)
"""Those that are tried first."""
