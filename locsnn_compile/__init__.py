"""locsnn_compile."""
