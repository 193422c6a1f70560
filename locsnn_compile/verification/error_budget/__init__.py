"""Break the difference between the float network and the chip down by stage of the compiler, with float twins."""
