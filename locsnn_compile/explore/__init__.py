"""Speed against error against energy: compare settings of the compiler, and recommend one.

    grid -> study -> sweep (here, in processes, or on Dask; finished points in a store) -> front -> recommend -> files

The figures of a point depend only on model, recordings, chip, setting and code, never on where it was measured.
"""
