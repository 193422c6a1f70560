"""Where the difference between the float network and the chip comes from, stage by stage."""
