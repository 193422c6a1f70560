"""``--emit pynn``: a program for SpiNNaker as a script for sPyNNaker, which talks to the boards."""
