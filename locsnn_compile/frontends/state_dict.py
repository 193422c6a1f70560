"""Read the tensors of a state dict that torch saved, as arrays.

The file was unpickled without torch, and without running any code, by ``data.tensors``.
"""

import math
from collections.abc import Collection
from typing import Any

import numpy as np

from locsnn_compile.data.tensors import FLOATS, Tensor
from locsnn_compile.errors import InputError, check_most

MAX_WEIGHTS = 50_000_000
"""Largest number of entries of a tensor: 400 MB as float64."""
WHOLE_NUMBERS = ("torch.uint8", "torch.int32", "torch.int64", "torch.bool")
"""Types of tensors that hold whole numbers, such as masks and counters."""
WEIGHT_ENDS = (
    ".weight",
    ".weight_g",
    ".weight_v",
    *(f".parametrizations.weight.original{i}" for i in range(2)),
)
"""The ends of names of weights: plain ones, and those of torch's weight normalisation, in its old and new form."""
SAVE_A_STATE_DICT = "Save net.state_dict() with torch.save."
_STATE_KEYS = ("state_dict", "model_state_dict", "net", "model")
"""Usual keys under which training scripts save the state dict, next to an optimiser and an epoch."""


def state_tensors(content: object, where: str, dtypes: Collection[str] = FLOATS) -> dict[str, Any]:
    """Return the tensors of a state dict as arrays of float64, by name, in order.

    Other entries are left out, except that weights must be tensors. Raises ``InputError`` if ``content`` is not a state
    dict, and for tensors that are too large, not finite, or of other types than ``dtypes``.
    """
    if isinstance(content, dict):
        for key in _STATE_KEYS:
            if isinstance(content.get(key), dict):
                content = content[key]
                break
    if not isinstance(content, dict) or not content:
        measured = f"a {type(content).__name__}"
        raise InputError(where, "it is not a state dict", measured=measured, fix=SAVE_A_STATE_DICT)
    arrays: dict[str, Any] = {}
    for key, tensor in content.items():
        is_text = isinstance(key, str)
        if is_text and (isinstance(tensor, Tensor) or key.endswith(WEIGHT_ENDS)):
            place = f"{where}, entry {key[:80]!r}"
            # DataParallel puts "module." in front of every name.
            arrays[key.removeprefix("module.")] = _array(key, tensor, dtypes, place)
    return arrays


def _array(key: str, tensor: object, dtypes: Collection[str], place: str) -> Any:
    """Return a tensor as float64; check its type and size before it takes memory."""
    if not isinstance(tensor, Tensor) or not tensor.dense or tensor.dtype not in dtypes:
        measured = tensor.dtype if isinstance(tensor, Tensor) else type(tensor).__name__
        what = "it is not a dense float tensor"
        raise InputError(place, what, measured=measured, fix=SAVE_A_STATE_DICT)
    check_most(len(key), 200, place, "its name is too long", unit="characters", fix="Rename it.")
    size = math.prod(tensor.shape)
    check_most(size, MAX_WEIGHTS, place, "too many weights", fix="Give a smaller layer.")
    with np.errstate(invalid="ignore"):
        array = np.array(tensor.array(), dtype=np.float64)
    if not np.isfinite(array).all():
        raise InputError(place, "a weight is not a finite number", fix="Train again.")
    return array
