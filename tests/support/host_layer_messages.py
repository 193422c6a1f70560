"""What is said of a number of host layers that a network of three layers cannot have, by any frontend."""

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
"""For each case: what is given for ``--host-layers``, and the message behind the place."""
