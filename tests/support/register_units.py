"""Names for numbers of the chip's registers, for tests that work out results by hand.

``hw_model/arithmetic/loihi.py`` describes the registers; the numbers are repeated here so that tests do not depend on it.
"""

FORGETS_AT_ONCE = 4096
"""The decay that leaves nothing of a current or voltage: a decay d keeps (4096 - d) / 4096 in each step."""
KEEPS_ALL = 0
"""The decay that leaves all of a current or voltage."""
UNIT = 64
"""Register units that a weight of 1 adds to a current and a threshold of 1 stands for. Biases are in register units."""
LARGEST_THRESHOLD = (1 << 17) - 1
"""In units of 64; a compartment with it spikes only close to the end of its register."""
LARGEST_BIAS = ((1 << 12) - 1) << 7
"""A mantissa of 12 bits times 2^7."""
LARGEST_WEIGHT = 254
"""The largest weight of eight bits with both signs, which are multiples of 2; an exponent of 7 makes it 2^7 times as much."""
CHARGE_RANGE = 1 << 22
"""Number of values of a charge, by which it wraps: 21 bits and a sign."""
CURRENT_RANGE = 1 << 24
"""Number of values of a current, by which it wraps, alone or with the bias added: 23 bits and a sign."""
VOLTAGE_MAX = (1 << 23) - 1
"""Where a voltage is clipped unless the core has a lower vmax."""
