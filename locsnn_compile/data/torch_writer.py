"""Write torch's files with torch, which is installed only for training: compiling needs nothing here."""

import io
import sys
from typing import Any

import numpy as np

from hw_model.io.extras import needed


def torch_bytes(values: dict[str, Any], where: str) -> bytes:
    """Return the file of a dict of plain values, dicts and arrays; arrays of text become lists, others tensors."""
    torch, content = needed("torch", "train", where), io.BytesIO()
    torch.save(_with_tensors(values), content)
    return content.getvalue()


def _with_tensors(value: Any) -> Any:
    import torch

    if isinstance(value, dict):
        return {_with_tensors(key): _with_tensors(entry) for key, entry in value.items()}
    if isinstance(value, str):
        return sys.intern(value)  # equal texts are written once: equal values give equal bytes
    if isinstance(value, np.ndarray):
        return value.tolist() if value.dtype.kind == "U" else torch.tensor(value)
    return value
