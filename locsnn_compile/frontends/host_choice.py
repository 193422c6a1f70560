"""Parse ``--host-layers``, the layers that run on the host: a number of layers, counted from the input, or names."""

from collections.abc import Sequence

from locsnn_compile.errors import InputError, check_known, counted


def chosen_layers(
    host_layers: str, names: Sequence[str], layers: Sequence[str], place: str
) -> list[str]:
    """Return the layers that the option ``host_layers`` means.

    ``names`` are all layers that can be named, ``layers`` those that a number counts, from the input. Raises
    ``InputError`` for names that do not exist, and for a number that leaves no layer for the chip.
    """
    if not host_layers.isdecimal():
        chosen = [name.strip() for name in host_layers.split(",")]
        for name in chosen:
            check_known(place, f"there is no layer {name[:60]!r}", name, names)
        return chosen
    number = int(host_layers)
    if not 1 <= number < len(layers):
        what = f"it is not a number of layers from 1 to {len(layers) - 1}"
        measured = f"{number}, of {counted(len(layers), 'layer')}"
        raise InputError(place, what, measured=measured, fix="Leave one for the chip.")
    return list(layers[:number])


def none_left(place: str) -> InputError:
    """Return the error for host layers that leave no neurons for the chip."""
    return InputError(place, "no neurons are left for the chip", fix="Name fewer layers.")
