"""Layers with random weights."""

import torch

from locsnn_compile.models.touch_model import INITIAL_SCALE, draw_weights


def drawn(layer, generator, scale=INITIAL_SCALE):
    """Return a layer with weights as a network of this initial scale draws them."""
    generator = (
        torch.Generator().manual_seed(generator) if isinstance(generator, int) else generator
    )
    draw_weights(layer.weight, scale, generator)
    return layer
