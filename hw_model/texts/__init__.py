"""Texts in files next to the code that fills them."""
