"""What a chip is: registers, limits, mesh, and named profiles of energy and time."""
