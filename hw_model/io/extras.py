"""Packages that are installed only with an extra of this project."""

from importlib import import_module
from typing import Any

from hw_model.errors import InputError


def needed(package: str, extra: str, where: str) -> Any:
    """Return a package; raise ``InputError`` if it is not installed. ``where`` names what needs it."""
    try:
        return import_module(package)
    except ImportError:
        fix = f"Install it with: pip install 'locsnn-compile[{extra}]'."
        raise InputError(where, f"it needs {package}, which is not installed", fix=fix) from None
