"""The one setting of the compiler for a Xylo, and why there is no other."""

from collections.abc import Mapping

from hw_model.arithmetic import xylo
from hw_model.errors import InputError
from hw_model.xylo.chips import XyloChip
from locsnn_compile.settings import AUTO, NATIVE, Setting, Value

_HELD: Mapping[str, tuple[Value, ...]] = {
    "strategy": (AUTO, NATIVE),
    "weight_bits": (xylo.WEIGHT_BITS,),
}
"""By dial: the values that mean what a Xylo does."""
_WHY: Mapping[str, str] = {
    "strategy": "it lays out SRM neurons, and {chip} has neurons that leak",
    "weight_bits": "weights of {chip} have one width",
    "split_weights": "{chip} has one synapse for a weight",
}


def xylo_setting(chip: XyloChip, values: Mapping[str, Value | None]) -> Setting:
    """Return the setting of a Xylo for values by dial; ``InputError`` where one asks for another."""
    for dial, value in values.items():
        if value is not None and value not in _HELD.get(dial, ()):
            why = _WHY.get(dial, "{chip} has no such choice").format(chip=chip.name)
            raise InputError(dial, why, measured=f"got {value}", fix="Leave it out.")
    return Setting(NATIVE, xylo.WEIGHT_BITS)
