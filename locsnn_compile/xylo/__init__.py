"""Networks for Xylo: what fits, its integers, the program, and the check against the float network.

Network -> XyloParts -> QuantizedXylo -> XyloProgram
(network)  parts_of     quantize        compile_for_xylo
"""
