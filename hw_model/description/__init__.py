"""Chips as their YAML files describe them: registers, limits, mesh, energy and time."""
