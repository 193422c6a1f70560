"""Xylo: its chips, programs and their files, and the two engines that play them."""
