"""Read a state dict of torch with a YAML file that lists its layers."""
