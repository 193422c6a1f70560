"""Torch layers with random weights, for the tests of models and of training."""

import torch

from locsnn_compile.models.touch_model import INITIAL_SCALE, draw_weights


def drawn(layer, generator, scale=INITIAL_SCALE):
    """Draw the weights of a layer as those of a network with this initial scale, and return the layer.

    ``generator`` is a torch generator or a seed.
    """
    if isinstance(generator, int):
        generator = torch.Generator().manual_seed(generator)
    draw_weights(layer.weight, scale, generator)
    return layer
