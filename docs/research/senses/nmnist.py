"""Sight: an event camera before handwritten digits (Orchard et al. 2015); 2,312 channels, 32 steps.

These are the first 1,000 training and 100 test recordings.
"""

from sense import Sense

SENSE = Sense(
    name="nmnist", file="nmnist/nmnist.zip", grid="34x34", step_seconds=0.01, most_to_measure=250
)
