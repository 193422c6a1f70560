"""Read slayerPytorch checkpoints with the YAML that describes their network."""
