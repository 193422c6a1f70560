"""Read NIR graphs."""
