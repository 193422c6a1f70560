"""What networks cost on paper: operations and arithmetic energy of spiking and conventional networks."""
