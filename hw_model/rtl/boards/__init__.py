"""Boards that the open core is made for: what else is here goes into ``rtl/`` of ``--emit rtl`` as it is."""

BOARDS = {"ulx3s-25f": "ecp5-25f", "ulx3s-85f": "ecp5-85f", "icebreaker": "ice40up5k"}
"""The device of each board; the first board of a device is taken where none is named."""
