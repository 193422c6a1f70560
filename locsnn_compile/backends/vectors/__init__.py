"""``--emit vectors``: memory images, stimuli and expected values for a test bench."""
