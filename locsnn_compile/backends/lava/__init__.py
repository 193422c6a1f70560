"""``--emit lava``: a program of ``loihi-sim`` as Lava processes, and a recording to compare by."""
