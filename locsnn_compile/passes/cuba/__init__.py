"""Integers for leaky integrate-and-fire neurons with a current (current-based, "CUBA")."""
