"""The artificial networks that spiking networks are compared with: GRU-MLP and CNN-3D of Kang et al. 2022.

Both take x (batch, steps, channels), floats 0 or 1, and return class scores (batch, classes) under the name ``output``.
They are trained and counted, but not compiled. Weights start with torch's defaults.
"""

import torch
from torch import Tensor, nn

from locsnn_compile.baselines.ann_shapes import CONVOLUTIONS
from locsnn_compile.data.sensor import frame_cells, frame_size
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.touch_model import TouchModel


class GruMlp(TouchModel):
    """``gru-mlp``: GRU(channels -> hidden), then one linear layer at the last step."""

    def __init__(self, description: NetworkDescription) -> None:
        super().__init__(description)
        self.gru = nn.GRU(description.input.channels, description.hidden, batch_first=True)
        self.readout = nn.Linear(description.hidden, description.classes)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the class scores of ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        return {"output": self.readout(self.gru(x)[0][:, -1])}


class Cnn3d(TouchModel):
    """``cnn-3d``: two convolutions with ReLU over the frames of each fingertip, then one linear layer over all of them.

    A frame is the grid of a sensor, or 9 x 7 cells, of which :data:`locsnn_compile.data.sensor.FRAME_OF_TAXELS` assigns
    39 to taxels. Its channels are the polarities. All fingertips go through the same convolutions.
    """

    cells: Tensor

    def __init__(self, description: NetworkDescription) -> None:
        super().__init__(description)
        shapes = description.weight_shapes
        for number, (outputs, kernel, stride) in enumerate(CONVOLUTIONS, start=1):
            inputs = shapes[f"conv_{number}.weight"][1]
            self.add_module(f"conv_{number}", nn.Conv3d(inputs, outputs, kernel, stride))
        self.readout = nn.Linear(shapes["readout.weight"][1], description.classes)
        self.register_buffer(
            "cells",
            torch.from_numpy(frame_cells(description.input.sensor).copy()),
            persistent=False,
        )

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the class scores of ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        sensor, steps = self.description.input.sensor, self.description.input.steps
        touch = x.reshape(len(x), steps, sensor.surfaces, sensor.taxels, sensor.polarities)
        frame = frame_size(sensor)
        frames = x.new_zeros(len(x), sensor.surfaces, sensor.polarities, steps, frame[0] * frame[1])
        frames[..., self.cells] = touch.permute(0, 2, 4, 1, 3)
        stream = frames.reshape(-1, sensor.polarities, steps, *frame)
        for number in range(1, len(CONVOLUTIONS) + 1):
            stream = torch.relu(self.get_submodule(f"conv_{number}")(stream))
        return {"output": self.readout(stream.reshape(len(x), -1))}
