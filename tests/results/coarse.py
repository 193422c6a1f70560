"""Windows whose weights have few bits on the chip: the ways with ``bits`` of ``tried_settings.yaml``.

The weights are rounded after training, or already in training: there the forward pass hears them rounded, each output population
by its largest weight, and the descent goes on as if they were not (a straight-through estimate). Either network is compiled at so
many bits, and what is measured are the scores of its program.
"""

from __future__ import annotations

from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils import parametrize
from ways import Coarse, Division, Floats, Rows, Scorer, Setting

import hw_model as hw
import locsnn_compile as lc
from hw_model.arithmetic.fixed_point import weight_grid
from hw_model.values import ByteArray
from locsnn_compile.models.checkpoint import Checkpoint
from locsnn_compile.models.networks import WindowNetwork, build_network
from locsnn_compile.models.touch_model import TouchModel
from locsnn_compile.training import train as training

HEARD = 16
"""Recordings that the compiler hears."""


class Rounded(nn.Module):
    """Weights [out, in] of ``parts`` of the columns, each on the grid of so many bits that its largest weight spans."""

    def __init__(self, parts: list[slice], bits: int) -> None:
        super().__init__()
        grid = weight_grid(bits, "excitatory")
        self.parts, self.steps = parts, grid.high // grid.step

    def forward(self, weights: Tensor) -> Tensor:
        rounded = torch.cat([self.on_grid(weights.detach()[:, part]) for part in self.parts], dim=1)
        return weights + (rounded - weights.detach())

    def on_grid(self, weights: Tensor) -> Tensor:
        unit = weights.abs().max().clamp_min(1e-12) / self.steps
        return unit * (weights / unit).round()


def rounding(bits: int) -> Any:
    """Return what builds networks of windows whose weights are rounded in the forward pass."""

    def build(*args: Any, **options: Any) -> TouchModel:
        network = build_network(*args, **options)
        assert isinstance(network, WindowNetwork)
        parametrize.register_parametrization(network, "output", Rounded(network.description.output_parts, bits))
        return network

    return mock.patch.object(training, "build_network", build)


def coarse(way: Coarse, of: Division, rows: Rows) -> Scorer:
    """Train on ``rows``, and return the scores of the chip's program, in its integers: they tell classes apart, no more."""
    setting = of.known[way.setting]
    assert isinstance(setting, Setting)
    if way.in_training:
        with rounding(way.bits):
            _, network = setting.trained(of, rows)
    else:
        _, network = setting.trained(of, rows)
    with TemporaryDirectory() as folder:
        path = f"{folder}/windows.pt"
        Checkpoint(network.description, network.weights(), training={}).save(path)
        events = of.recordings.subset(rows[:HEARD])
        program = lc.compile(lc.load(path), weight_bits=way.bits, events=events, diagnosis=False).program

    def score(spikes: ByteArray) -> Floats:
        return np.asarray(hw.simulate(program, spikes).scores, dtype=np.float64)

    return score
