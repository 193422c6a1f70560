"""What compiling shares for chips that do not compute as Loihi does, such as Xylo and SpiNNaker.

Each such family of chips has an arithmetic of its own, and a folder of its own for what only it has. Shared are: one
fixed setting of the compiler, the check of a program against the float network, and the report. The families share no
intermediate levels between network and program, and no energy of them is published.
"""
