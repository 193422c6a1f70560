"""SpiNNaker 1: its chip, programs and their files, and the two engines that play them."""
