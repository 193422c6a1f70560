"""``locsnn rtl``: the commands around the open core."""
