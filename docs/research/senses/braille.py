"""Touch: an iCub fingertip slides over Braille letters (Mueller-Cleve et al. 2022).

There are 24 channels and 315 steps. The split is the authors' own. Most recordings of the space are
silent, and a third of those of P are.
"""

from sense import Sense

SENSE = Sense(
    name="braille",
    file="braille/braille.zip",
    layout="braille/icub-fingertip.yaml",
    step_seconds=0.01,
    tie="Space",
    most_to_choose=1_350,
    most_to_measure=540,
)
