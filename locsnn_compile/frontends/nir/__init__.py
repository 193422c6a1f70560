"""NIR graphs in."""
