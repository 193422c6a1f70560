"""Numbers of the chip by name, for figures that tests work out by hand; ``hw_model/arithmetic/loihi.py`` defines them."""

FORGETS_AT_ONCE = 4096
"""A decay that leaves nothing of a current or voltage: a decay d keeps (4096 - d) / 4096 in each step."""
KEEPS_ALL = 0
"""A decay that leaves all of it."""
UNIT = 64
"""What a weight of 1 adds to a current, and a threshold of 1 is in units of a voltage. A bias is not multiplied by it."""
LARGEST_THRESHOLD = (1 << 17) - 1
"""In units of 64; a compartment with it spikes only close to the end of its register."""
LARGEST_BIAS = ((1 << 12) - 1) << 7
"""A mantissa of 12 bits times 2^7."""
LARGEST_WEIGHT = 254
"""Of eight bits with both signs, a multiple of 2; an exponent of 7 makes it 2^7 times as much."""
CHARGE_RANGE = 1 << 22
"""By which a charge wraps: a register of 21 bits and a sign."""
CURRENT_RANGE = 1 << 24
"""By which a current, or current and bias together, wrap: 23 bits and a sign."""
VOLTAGE_MAX = (1 << 23) - 1
"""Where a voltage is clipped unless the core has a lower vmax."""
