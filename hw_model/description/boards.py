"""Boards that the open core is made for."""

BOARDS = {"ulx3s-25f": "ecp5-25f", "ulx3s-85f": "ecp5-85f", "icebreaker": "ice40up5k"}
"""The chip of each board; the first board of a chip is taken where none is named."""
