"""The chip's integer arithmetic and its grid of weights: every formula once."""
