"""``--emit xylo``: a program as a specification for rockpool, which talks to the chips."""
