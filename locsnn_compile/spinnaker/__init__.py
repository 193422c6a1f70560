"""Compile networks for SpiNNaker 1: refuse what it cannot run, make the integers of its neuron model, check the
program.

SpiNNaker's neuron model is IF_curr_exp of PyNN: a leaky integrate-and-fire neuron with exponentially decaying synaptic
currents. The levels, and the modules that lead to them:

Network -> QuantizedNetwork -> CompartmentGraph -> LoweredSpinnaker -> SpinnakerProgram
(network)  (passes)            (passes)            lower               compile
"""
