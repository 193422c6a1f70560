"""Speed against error against energy: compare settings of the compiler, and recommend one.

    grid -> study -> sweep (here, in processes, or on Dask; finished points in a store) -> front -> recommend -> files

- A *setting* is one value for each dial of the compiler: strategy, weight bits and split weights (``settings.py``);
  the *grid* is the list of settings to try.
- A *study* is what all of them share: network, chip and recordings.
- A *point* is a setting that was compiled and checked, with its figures, or with the reason why the chip refused it.
- The *front* holds the points that no other point beats in error, energy and time at once.

The figures of a point depend only on model, recordings, chip, setting and code, never on where it was measured.
Of several chips, the same network is compiled for each (``chip_points.py``, ``chips.py``, ``chips_result.py``).
"""
