"""Map a graph of compartments to the chip: check it, place compartments on cores, arrange the cores, route spikes."""
