"""What spiking and conventional networks cost on paper: their operations, and the energy of their arithmetic.

No chip is simulated: this reproduces the comparison of a published paper.
"""
