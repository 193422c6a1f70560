"""The setting of the compiler for a family of chips that leaves nothing to choose.

A *dial* is an option of the compiler such as the strategy or the weight bits; a *setting* has a value for every dial.
For these families there is only one setting. A dial may be given its value; any other value is an error with a reason.
"""

from collections.abc import Mapping

from hw_model.errors import InputError
from hw_model.targets.families import AnyChip
from hw_model.values import Frozen
from locsnn_compile.settings import AUTO, Setting, Value

_NO_CHOICE = "{chip} has no such choice"
_LEAVE_OUT = "Leave it out."


class OnlySetting(Frozen, eq=False):
    """The setting with which all networks are compiled for a family.

    - ``setting``: the setting
    - ``reasons``: by dial, why another value has no meaning; ``{chip}`` is replaced by the chip's name
    - ``fixes``: by dial, what a user can do instead, if that is not just to leave the value out
    """

    setting: Setting
    reasons: Mapping[str, str]
    fixes: Mapping[str, str]

    @property
    def accepted(self) -> dict[str, tuple[Value, ...]]:
        """By dial, the values that are accepted: that of the setting, and also ``auto`` for the strategy."""
        of_setting: dict[str, tuple[Value, ...]] = {
            dial.name: (value,) for dial, value in self.setting.by_dial
        }
        return {**of_setting, "strategy": (AUTO, self.setting.strategy)}

    def for_dials(self, chip: AnyChip, values: Mapping[str, Value | None]) -> Setting:
        """Return the setting; raise ``InputError`` if a value of a dial asks for another. None: no value is given."""
        for dial, value in values.items():
            if value is not None and value not in self.accepted.get(dial, ()):
                reason = self.reasons.get(dial, _NO_CHOICE).format(chip=chip.name)
                fix = self.fixes.get(dial, _LEAVE_OUT)
                raise InputError(dial, reason, measured=f"got {value}", fix=fix)
        return self.setting
