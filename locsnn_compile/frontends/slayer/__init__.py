"""slayerPytorch checkpoints with their YAML in."""
