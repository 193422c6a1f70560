"""Touch recordings: their type, their files, the sensor's layout and synthetic ones."""

import lazy_loader

# The table of formats is shown by help, which must not wait for the readers.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
