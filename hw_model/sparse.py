"""scipy's sparse matrices, imported without what they do not need, which takes a command a tenth of its time.

scipy copies every name of numpy, and asking for some of them makes numpy import large packages that only tests and
Fortran use. They have a placeholder meanwhile; who asks numpy for them later gets them.
"""

import numpy as np

_UNUSED = [name for name in ("f2py", "testing") if name not in vars(np)]
for _name in _UNUSED:
    setattr(np, _name, None)
try:
    from scipy import sparse
finally:
    for _name in _UNUSED:
        delattr(np, _name)

__all__ = ["sparse"]
