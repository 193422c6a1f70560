"""hw_model."""
