"""Round weights onto the chip's grid: each by itself, or those of a neuron together, so that errors cancel."""
