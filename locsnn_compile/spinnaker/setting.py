"""The one setting of the compiler for SpiNNaker, and why there is no other."""

from collections.abc import Mapping

from hw_model.errors import InputError
from hw_model.spinnaker.chips import SpinnakerChip
from locsnn_compile.settings import AUTO, Setting, Value

SETTING = Setting(strategy="reset", weight_bits=8)
"""How networks are rounded for SpiNNaker: each of its neurons is a single compartment."""
_HELD: Mapping[str, tuple[Value, ...]] = {
    "strategy": (AUTO, SETTING.strategy),
    "weight_bits": (SETTING.weight_bits,),
}
"""By dial: the values that mean what is done for SpiNNaker."""
_WHY: Mapping[str, str] = {
    "strategy": "it joins compartments, and a neuron of {chip} is a single one",
    "weight_bits": "weights for {chip} are rounded to one width",
    "split_weights": "weights for {chip} are rounded once",
}


def spinnaker_setting(chip: SpinnakerChip, values: Mapping[str, Value | None]) -> Setting:
    """Return the setting of SpiNNaker for values by dial; ``InputError`` where one asks for another."""
    for dial, value in values.items():
        if value is not None and value not in _HELD.get(dial, ()):
            why = _WHY.get(dial, "{chip} has no such choice").format(chip=chip.name)
            fix = "Use strategy reset." if dial == "strategy" else "Leave it out."
            raise InputError(dial, why, measured=f"got {value}", fix=fix)
    return SETTING
