"""The window network in torch: fixed hidden neurons that count events in windows, and an output that learns.

The hidden neurons are known before the first epoch, so training is a linear problem: the potential of output k is

    v_k = sum over hidden neurons h that spike:  w_kh   +   bias_k

It is learned as ``w (o - usual) + b``, with ``usual`` the mean of every hidden spike over the recordings that are
learned from: hidden spikes share a large mean, which would slow the descent along everything else. The network that is
kept has ``bias = b - w usual``.
"""

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from hw_model.values import AnyArray, ByteArray
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.touch_model import TouchModel


class WindowNetwork(TouchModel):
    """``window-snn``: hidden neurons of :class:`~locsnn_compile.models.windows.WindowParameters`, output potentials.

    Or that branch of a network that has others. Weights start at 0, so that no seed is in them.
    """

    walk: Tensor
    starts: Tensor
    usual: Tensor

    def __init__(self, description: NetworkDescription) -> None:
        super().__init__(description)
        layout, self.windows = description.input, description.windows
        self.register_buffer("walk", torch.from_numpy(description.walk.copy()), persistent=False)
        self.register_buffer("starts", torch.from_numpy(self.windows.starts(layout.steps)), persistent=False)
        self.names = description.window_names
        classes, hidden = description.weight_shapes[self.names[0]]
        self.output = nn.Parameter(torch.zeros(classes, hidden))
        self.bias = nn.Parameter(torch.zeros(classes))
        self.register_buffer("usual", torch.zeros(hidden))

    def weight(self, name: str) -> nn.Parameter:
        """Return a parameter as it is learned."""
        return self.output if name == self.names[0] else self.bias

    def begin(self, spikes: ByteArray) -> None:
        """Take the mean of every hidden spike over recordings (samples, steps, channels); scores stay as they are."""
        total = torch.zeros(self.usual.shape, dtype=torch.float64, device=self.usual.device)
        for start in range(0, len(spikes), 32):
            part = torch.from_numpy(np.array(spikes[start : start + 32])).to(self.usual)
            total += self.hidden(part).sum(dim=0, dtype=torch.float64)
        usual = (total / max(len(spikes), 1)).to(self.usual.dtype)
        with torch.no_grad():
            self.bias.add_(self.output @ (usual - self.usual))
        self.usual.copy_(usual)

    def hidden(self, x: Tensor) -> Tensor:
        """Return the spikes (batch, hidden) of the hidden neurons for ``x`` (batch, steps, channels)."""
        events = torch.nn.functional.pad(self.aligned(x, moved=True).cumsum(dim=1), (0, 0, 1, 0))
        counted = events.index_select(1, self.starts + self.windows.steps) - events.index_select(1, self.starts)
        levels = torch.tensor(self.windows.levels, dtype=x.dtype, device=x.device)
        spikes = counted.index_select(2, self.walk).transpose(1, 2).unsqueeze(-1) >= levels
        return spikes.to(x.dtype).reshape(len(x), -1)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the potentials (batch, classes) of the output for ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        return {self.names[0]: torch.nn.functional.linear(self.hidden(x) - self.usual, self.output, self.bias)}

    def scores(self, activity: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return the potentials of the output."""
        return {self.description.structure.window_branch: activity[self.names[0]]}

    def weights(self) -> dict[str, NDArray[np.float32]]:
        """Return copies of the weights by name, the bias as the kept network has it."""
        with torch.no_grad():
            bias = self.bias.double() - self.output.double() @ self.usual.double()
        return {
            self.names[0]: self.output.detach().to(torch.float32).cpu().numpy().copy(),
            self.names[1]: bias.to(torch.float32).cpu().numpy(),
        }

    def load_weights(self, weights: Mapping[str, AnyArray]) -> None:
        """Take weights by name; ``InputError`` where a name or shape does not fit."""
        super().load_weights(weights)
        with torch.no_grad():
            self.bias.add_(self.output @ self.usual)
