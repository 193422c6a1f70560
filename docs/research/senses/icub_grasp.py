"""Touch: an iCub hand grasps nine objects or nothing (Soh, Su and Demiris, IROS 2012).

There are 120 channels and 24 steps. No split is published. Five rounds test on a fifth of each
class, so that every recording is tested on once. In each round networks are chosen on the other
four fifths. Nine of the twenty recordings of "none" are silent.
"""

from sense import Sense

SENSE = Sense(
    name="icub_grasp",
    file="icub_grasp/grasps.npz",
    layout="icub_grasp/icub-hand.yaml",
    tie="none",
    test_share=0.2,
)
