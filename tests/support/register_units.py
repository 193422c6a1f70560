"""Numbers of the chip by name, for figures that tests work out by hand; ``hw_model/arithmetic/loihi.py`` defines them."""

FORGETS_AT_ONCE = 4096
"""A decay that leaves nothing of a current or voltage: a decay d keeps (4096 - d) / 4096 in each step."""
KEEPS_ALL = 0
"""A decay that leaves all of it."""
UNIT = 64
"""What a weight of 1 adds to a current, and a threshold of 1 is in units of a voltage. A bias is not multiplied by it."""
