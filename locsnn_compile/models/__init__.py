"""The touch networks in torch, their description without torch, and the checkpoints that hold them."""
