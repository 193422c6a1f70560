"""Networks with extreme numbers and inputs: what the chip does with them, and why.

A *case* is one population of neurons behind inputs, with recordings (``cases``). It is lowered and played to the float
network and to the chip (``measure.py``), and judged (``row.py``): ok, limited by named causes, refused, or unexplained.
Errors are compared with a bound that is derived for them (``bounds.py``). A *row* is a case with its verdict.
"""
