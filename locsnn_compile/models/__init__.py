"""The networks that ``locsnn train`` knows: in torch, as descriptions without torch, and as checkpoints in files."""
