"""Products of spikes with weights that touch the weights of active inputs alone: most inputs are silent at most steps.

    drive(r, o) = sum over the inputs i with x(r, i) != 0, from the first on:  x(r, i) * weight(i, o)

The gradient by the weights takes the same inputs; that by x is a matrix product, made where it is asked for.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from hw_model.compiled import compiled


@compiled
def _list_active(x: NDArray[Any], ends: NDArray[Any], inputs: NDArray[Any]) -> int:  # pragma: no cover - compiled
    """Fill ``ends`` (rows,) and ``inputs``, which has room for one entry more than x, row by row; return how many."""
    rows, size = x.shape
    found = 0
    for r in range(rows):
        for i in range(size):
            inputs[found] = i
            found += x[r, i] != 0
        ends[r] = found
    return found


@compiled
def _add_rows(
    x: NDArray[Any], ends: NDArray[Any], inputs: NDArray[Any], weight: NDArray[Any], drive: NDArray[Any]
) -> None:  # pragma: no cover - compiled
    size = weight.shape[1]
    begin = 0
    for r in range(len(ends)):
        total = drive[r]
        total[:] = 0
        for k in range(begin, ends[r]):
            value, row = x[r, inputs[k]], weight[inputs[k]]
            for o in range(size):
                total[o] += value * row[o]
        begin = ends[r]


@compiled
def _spread_rows(
    x: NDArray[Any], ends: NDArray[Any], inputs: NDArray[Any], gradient: NDArray[Any], found: NDArray[Any]
) -> None:  # pragma: no cover - compiled
    size = gradient.shape[1]
    begin = 0
    for r in range(len(ends)):
        sent = gradient[r]
        for k in range(begin, ends[r]):
            value, row = x[r, inputs[k]], found[inputs[k]]
            for o in range(size):
                row[o] += value * sent[o]
        begin = ends[r]


class _SpikeProduct(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor) -> Tensor:
        rows, by_input = x.detach().contiguous().numpy(), weight.detach().contiguous().numpy()
        ends, room = np.empty(len(rows), np.int64), np.empty(rows.size + 1, np.int32)
        inputs = room[: _list_active(rows, ends, room)].copy()
        drive = np.empty((len(rows), by_input.shape[1]), by_input.dtype)
        _add_rows(rows, ends, inputs, by_input, drive)
        ctx.active = rows, ends, inputs
        ctx.save_for_backward(weight)
        return torch.from_numpy(drive)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> tuple[Tensor | None, Tensor | None]:
        (weight,) = ctx.saved_tensors
        gradient = grads[0].contiguous()
        by_x = by_weight = None
        if ctx.needs_input_grad[0]:
            # numpy asks for large pages: a tensor of its own takes torch as long to allocate as half of the product.
            by_x = torch.from_numpy(np.empty((len(gradient), len(weight)), gradient.numpy().dtype))
            torch.mm(gradient, weight.T, out=by_x)
        if ctx.needs_input_grad[1]:
            by_weight = torch.zeros(weight.shape, dtype=weight.dtype)
            _spread_rows(*ctx.active, gradient.numpy(), by_weight.numpy())
        return by_x, by_weight


def spike_product(x: Tensor, weight: Tensor) -> Tensor:
    """Return x (..., inputs) times ``weight`` (inputs, outputs), (..., outputs), differentiable by both."""
    rows = x.reshape(-1, x.shape[-1])
    drive: Tensor = _SpikeProduct.apply(rows, weight)  # type: ignore[no-untyped-call]
    return drive.reshape(*x.shape[:-1], weight.shape[1])
