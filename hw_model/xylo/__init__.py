"""Xylo: its chips, networks as it stores them, and the plain engine that plays them."""
