"""From a graph of compartments to cores and routes."""
