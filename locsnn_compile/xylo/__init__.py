"""Compile networks for Xylo: refuse what it cannot run, round to its integers, make the program, check it.

The levels, and the functions that lead to them:

Network -> XyloParts -> QuantizedXylo -> XyloProgram
(network)  parts_of     quantize        compile_for_xylo
"""
