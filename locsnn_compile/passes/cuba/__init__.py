"""Integrate-and-fire neurons: integers for them."""
