"""The boards that ship."""

BOARDS = {"ulx3s-25f": "ecp5-25f", "ulx3s-85f": "ecp5-85f", "icebreaker": "ice40up5k"}
"""The chip whose core each board gets. The first board of a chip is used where a user names none.
"""
