"""The one setting of the compiler for a family of chips that leaves nothing to choose."""

from collections.abc import Mapping

from hw_model.errors import InputError
from hw_model.targets.families import AnyChip
from hw_model.values import Frozen
from locsnn_compile.settings import AUTO, Setting, Value

_NO_CHOICE = "{chip} has no such choice"
_LEAVE_OUT = "Leave it out."


class OnlySetting(Frozen, eq=False):
    """How all networks are compiled for a family, and why no value of a dial could change it.

    - ``setting``: what is done
    - ``reasons``: by dial, why another value means nothing; ``{chip}`` stands for the chip's name
    - ``fixes``: by dial, what to do instead, if it is more than to leave the value out
    """

    setting: Setting
    reasons: Mapping[str, str]
    fixes: Mapping[str, str]

    @property
    def accepted(self) -> dict[str, tuple[Value, ...]]:
        """By dial, the values that mean what is done."""
        done: dict[str, tuple[Value, ...]] = {
            dial.name: (value,) for dial, value in self.setting.by_dial
        }
        return {**done, "strategy": (AUTO, self.setting.strategy)}

    def for_dials(self, chip: AnyChip, values: Mapping[str, Value | None]) -> Setting:
        """Return the setting for values by dial; ``InputError`` where one asks for another."""
        for dial, value in values.items():
            if value is not None and value not in self.accepted.get(dial, ()):
                reason = self.reasons.get(dial, _NO_CHOICE).format(chip=chip.name)
                fix = self.fixes.get(dial, _LEAVE_OUT)
                raise InputError(dial, reason, measured=f"got {value}", fix=fix)
        return self.setting
