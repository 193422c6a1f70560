"""Sound: spoken digits by six speakers, as events of a model cochlea (Free Spoken Digit Dataset).

There are 64 channels and 100 steps. Channels are 32 bands from low to high with two polarities
each: the order ``loop`` walks up, ``reverse`` down, and ``spiral`` from the middle outwards. The
split is the published one, and both parts have the same speakers.
"""

from sense import Sense

SENSE = Sense(
    name="fsdd", file="fsdd/fsdd.zip", grid="32x1", step_seconds=0.01, most_to_measure=300
)
