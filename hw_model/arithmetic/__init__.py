"""Every integer formula of the chips, once: one page (module) per chip's arithmetic.

``loihi``, ``spinnaker`` and ``xylo`` define what a step of a neuron computes. Next to them,
``..._inverse`` modules find settings for a trained network, and ``loihi_bounds`` bounds registers.
"""
