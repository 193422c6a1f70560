"""Error messages for a number of host layers that a network of three layers cannot have, equal for all frontends.

Host layers are the first layers of a network that run on the host computer in place of the chip.
"""

BAD_NUMBERS = {
    "no layer": (
        "0",
        "it is not a number of layers from 1 to 2 (0, of 3 layers). Leave one for the chip.",
    ),
    "all layers": (
        "3",
        "it is not a number of layers from 1 to 2 (3, of 3 layers). Leave one for the chip.",
    ),
}
"""For each case: the value of ``--host-layers``, and the message after the part that says where."""
