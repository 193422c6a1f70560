"""Read model files: one frontend per file format turns a file into a checked ``Network``."""

import lazy_loader

# Help shows the table of formats, and must not wait until all readers are imported.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
