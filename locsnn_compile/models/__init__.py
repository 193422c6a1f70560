"""The touch networks in torch, their torch-free description, and the checkpoints that hold them."""
