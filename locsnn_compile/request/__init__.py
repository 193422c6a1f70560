"""What is asked of the compiler, and the setting that it chooses if the user leaves it open.

A setting is one value for each dial: strategy, weight bits and split weights (``settings.py``).
"""
