"""The artificial networks that spiking networks are compared with: GRU-MLP and CNN-3D of Kang et al. 2022.

Both take x (batch, steps, channels), floats 0 or 1, and return {"output": class scores (batch, classes)}. They are
trained like the spiking networks, and their operations are counted for the comparison of energy, but they cannot be
compiled for a chip. Their weights start with torch's defaults.
"""

import torch
from torch import Tensor, nn

from locsnn_compile.baselines.ann_shapes import CONVOLUTIONS
from locsnn_compile.data.sensor import frame_cells, frame_size
from locsnn_compile.models.description import NetworkDescription
from locsnn_compile.models.touch_model import TouchModel


class GruMlp(TouchModel):
    """``gru-mlp``: GRU(channels -> hidden) over the steps, then one linear layer on its state at the last step."""

    def __init__(self, description: NetworkDescription) -> None:
        super().__init__(description)
        self.gru = nn.GRU(description.input.channels, description.hidden, batch_first=True)
        self.readout = nn.Linear(description.hidden, description.classes)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the class scores of ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        states, _ = self.gru(x)
        return {"output": self.readout(states[:, -1])}


class Cnn3d(TouchModel):
    """``cnn-3d``: two convolutions with ReLU over the frames of each fingertip, then one linear layer over all of them.

    A frame is an image with a cell for every taxel, the touch-sensitive point of a sensor. For a sensor that is a grid,
    the frame is the grid; for NeuTouch it has 9 x 7 cells, of which
    :data:`locsnn_compile.data.sensor.FRAME_OF_TAXELS` assigns 39 to taxels, and the others stay 0. The channels of the
    image are the polarities, and the convolutions go over steps, rows and columns. All fingertips (surfaces of the
    sensor) go through the same convolutions.
    """

    cells: Tensor
    """The cell of each taxel in its frame, counted row by row, (taxels,)."""

    def __init__(self, description: NetworkDescription) -> None:
        super().__init__(description)
        shapes = description.weight_shapes
        for number, (outputs, kernel, stride) in enumerate(CONVOLUTIONS, start=1):
            inputs = shapes[f"conv_{number}.weight"][1]
            self.add_module(f"conv_{number}", nn.Conv3d(inputs, outputs, kernel, stride))
        self.readout = nn.Linear(shapes["readout.weight"][1], description.classes)
        # The sensor determines the cells, so they are not stored with the weights (persistent=False). A
        # copy, because the array may be read-only, which torch does not support.
        cells = torch.from_numpy(frame_cells(description.input.sensor).copy())
        self.register_buffer("cells", cells, persistent=False)

    def forward(self, x: Tensor) -> dict[str, Tensor]:
        """Return the class scores of ``x`` (batch, steps, channels)."""
        self.check_shape(x)
        batch = len(x)
        steps = self.description.input.steps
        sensor = self.description.input.sensor
        touch = x.reshape(batch, steps, sensor.surfaces, sensor.taxels, sensor.polarities)
        rows, columns = frame_size(sensor)
        frames = x.new_zeros(batch, sensor.surfaces, sensor.polarities, steps, rows * columns)
        # (batch, surfaces, polarities, steps, taxels): taxels go to their cells.
        frames[..., self.cells] = touch.permute(0, 2, 4, 1, 3)
        # The surfaces join the batch for the convolutions, and the features of all surfaces of a
        # recording lie side by side for the linear layer.
        activity = frames.reshape(-1, sensor.polarities, steps, rows, columns)
        for number in range(1, len(CONVOLUTIONS) + 1):
            convolution = self.get_submodule(f"conv_{number}")
            activity = torch.relu(convolution(activity))
        return {"output": self.readout(activity.reshape(batch, -1))}
