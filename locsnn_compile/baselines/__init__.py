"""What networks cost on paper: operations and arithmetic of spiking and conventional ones."""
