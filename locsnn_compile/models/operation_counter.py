"""Count the operations of any artificial network in torch, module by module.

The counts are for comparisons with spiking networks, and follow the rules of the published figures (Kang et al. 2022):

- A product with a weight counts as a multiplication and an addition (a *mac*).
- Biases of linear layers and convolutions, comparisons, and functions of one number are not counted.
- For each of its gates and hidden units, a recurrent cell adds the contributions of the input, the state and two
  biases, which are three additions.
- Products of gates and their sums are counted as they are.

So GRU(I -> H) has 2 * 3 * (I * H + H * H) + 13 * H operations per step: 13 = 3 gates * 3 additions + 3 products + 1
sum, per hidden unit.
"""

from collections.abc import Callable
from functools import partial
from math import prod
from typing import Any

import torch
from torch import Tensor, nn

from locsnn_compile.baselines.operations import AnnCounts
from locsnn_compile.errors import InputError

Counter = Callable[[Any, Tensor, Tensor], AnnCounts]
"""Returns the counts of a module, given its input and its output."""


def count_operations(network: nn.Module, example: Tensor) -> AnnCounts:
    """Return the counts of one pass of ``example``, a single recording (1, ...), through ``network``.

    Every module without inner modules is counted according to its kind, each time that it is called. What ``forward``
    computes outside of modules is not counted. Raises ``InputError`` for a kind without a counter, and for a module
    that has both inner modules and its own weights.
    """
    counts: list[AnnCounts] = []
    counters = {
        module: _counter(name, module)
        for name, module in network.named_modules()
        if _is_counted(name, module)
    }
    hooks = [
        module.register_forward_hook(partial(_add, counts, counter))
        for module, counter in counters.items()
    ]
    # In evaluation mode, so that layers such as dropout do nothing; the network is left as it was.
    training = network.training
    try:
        network.eval()
        with torch.no_grad():
            network(example)
    finally:
        network.train(training)
        for hook in hooks:
            hook.remove()
    return AnnCounts(
        sum(c.macs for c in counts),
        sum(c.multiplications for c in counts),
        sum(c.additions for c in counts),
    )


def _is_counted(name: str, module: nn.Module) -> bool:
    """Return whether a module is counted itself, rather than through its inner modules.

    Raises ``InputError`` for a module that has inner modules and weights of its own, which nothing would count.
    """
    if next(module.children(), None) is None:
        return True
    if next(module.parameters(recurse=False), None) is not None:
        raise _unknown(name, module)
    return False


def _counter(name: str, module: nn.Module) -> Counter:
    """Return the counter of a kind of module; ``InputError`` if there is none. LSTMs with projections have none."""
    if type(module) not in _COUNTERS or getattr(module, "proj_size", 0) > 0:
        raise _unknown(name, module)
    return _COUNTERS[type(module)]


def _unknown(name: str, module: nn.Module) -> InputError:
    what = f"operations of a {type(module).__name__} are not known"
    fix = f"Use modules of these kinds: {', '.join(kind.__name__ for kind in _COUNTERS)}."
    return InputError(f"module {name or type(module).__name__!r}", what, fix=fix)


def _add(
    counts: list[AnnCounts],
    counter: Counter,
    module: nn.Module,
    inputs: tuple[Tensor, ...],
    output: Any,
) -> None:
    """Append the counts of one call of a module; called by torch after it."""
    # Recurrent modules return (output, last state).
    first_output = output if isinstance(output, Tensor) else output[0]
    counts.append(counter(module, inputs[0], first_output))


def _products(
    of_output: Callable[[Any], int], module: nn.Module, module_input: Tensor, output: Tensor
) -> AnnCounts:
    """Count the products with weights in each output; ``of_output`` returns their number for a module."""
    macs = output.numel() * of_output(module)
    return AnnCounts(macs, macs, macs)


def _weights_of_pixel(module: nn.Conv1d | nn.Conv2d | nn.Conv3d) -> int:
    """Return how many weights one output of a convolution multiplies."""
    return module.in_channels // module.groups * prod(module.kernel_size)


def _recurrent(
    gates: int, products: int, sums: int, module: nn.RNNBase, module_input: Tensor, output: Tensor
) -> AnnCounts:
    """Count a recurrent cell with these numbers of gates, element-wise products and sums per step and hidden unit."""
    directions = 2 if module.bidirectional else 1
    hidden = module.hidden_size
    # How often a layer's cell is computed: once per step, recording and direction.
    cells = directions * module_input.numel() // module.input_size
    macs = 0
    units = 0
    for layer in range(module.num_layers):
        inputs = module.input_size if layer == 0 else directions * hidden
        macs += cells * gates * (inputs * hidden + hidden * hidden)
        units += cells * hidden
    added = gates * (3 if module.bias else 1) + sums
    return AnnCounts(macs, macs + products * units, macs + added * units)


_FREE: tuple[type[nn.Module], ...] = (
    nn.ReLU,
    nn.Sigmoid,
    nn.Tanh,
    nn.Identity,
    nn.Flatten,
    nn.Unflatten,
    nn.Dropout,
    nn.Dropout1d,
    nn.Dropout2d,
    nn.Dropout3d,
    nn.MaxPool1d,
    nn.MaxPool2d,
    nn.MaxPool3d,
)
"""Modules without counted operations: functions of one number, comparisons, and reordering."""
_COUNTERS: dict[type[nn.Module], Counter] = {
    nn.Linear: partial(_products, lambda linear: linear.in_features),
    **dict.fromkeys((nn.Conv1d, nn.Conv2d, nn.Conv3d), partial(_products, _weights_of_pixel)),
    # Gates, element-wise products and sums per step and hidden unit, from torch's equations of each cell.
    nn.RNN: partial(_recurrent, 1, 0, 0),
    nn.GRU: partial(_recurrent, 3, 3, 1),
    nn.LSTM: partial(_recurrent, 4, 3, 1),
    **dict.fromkeys(_FREE, partial(_products, lambda _: 0)),
}
