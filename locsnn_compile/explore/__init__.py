"""Speed against error against energy: settings of the compiler measured next to each other, and one recommended.

    grid -> study -> sweep (here, in processes, or on Dask; finished points in a store) -> front -> recommend -> files

A point's figures depend on model, recordings, chip, setting and the code alone, never on where it was measured.
"""
