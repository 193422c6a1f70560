"""Networks for SpiNNaker 1: what fits, the integers of IF_curr_exp, the program, and its check.

Network -> QuantizedNetwork -> CompartmentGraph -> LoweredSpinnaker -> SpinnakerProgram
(network)  (passes)            (passes)            lower               compile
"""
