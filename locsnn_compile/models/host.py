"""Between a tensor, on whichever device, and the arrays that compiled scans work on.

The steps of a spiking layer follow from one another, so they run as compiled scans on the processor, whatever device
the matrix products run on; what they take and give is copied there and back.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor


def to_host(values: Tensor) -> NDArray[Any]:
    """Return the values as a C-contiguous array, not copied where they lie in the processor's memory like that."""
    array: NDArray[Any] = values.detach().cpu().numpy()
    return np.ascontiguousarray(array)


def to_device(array: NDArray[Any], like: Tensor) -> Tensor:
    """Return the array as a tensor on the device of another, not copied where that is the processor."""
    return torch.from_numpy(array).to(like.device)
