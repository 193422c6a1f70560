"""What a chip is, as its YAML file describes it: registers, limits, mesh, and profiles of energy
and time."""
