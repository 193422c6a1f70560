"""Integers for integrate-and-fire neurons."""
