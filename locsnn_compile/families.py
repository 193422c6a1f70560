"""What the compiler does for each family of chips: one row for each.

To add a family, describe its chips (:mod:`hw_model.targets.families`), write how a network is compiled for
them in a room of its own, and add its row here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import hw_model as hw
from hw_model.spinnaker.chips import SpinnakerChip
from hw_model.targets.families import AnyChip
from hw_model.xylo.chips import XyloChip
from locsnn_compile.compiled import Compiled
from locsnn_compile.emitters import check_kinds
from locsnn_compile.mesh.compile import fulfil_for_mesh
from locsnn_compile.request.compile_request import CompileRequest
from locsnn_compile.settings import Setting, Value, setting_for
from locsnn_compile.spinnaker.compile import fulfil_for_spinnaker
from locsnn_compile.spinnaker.compiled import SPINNAKER_KINDS
from locsnn_compile.spinnaker.setting import SPINNAKER_SETTING
from locsnn_compile.xylo.compile import fulfil_for_xylo
from locsnn_compile.xylo.compiled import XYLO_KINDS
from locsnn_compile.xylo.setting import XYLO_SETTING

ChipT = TypeVar("ChipT", bound=AnyChip)


@dataclass(frozen=True)
class Family(Generic[ChipT]):
    """Chips for which networks are compiled alike.

    - ``chips``: the class of their descriptions
    - ``setting``: the setting for values by dial, None for usual ones; ``InputError`` for a value
      that means nothing here
    - ``fulfil``: compiles a network as requested, and checks it against the float reference
    - ``check_kinds``: refuses kinds of ``--emit`` that show what such a chip does not have
    - ``bounds_choose``: bounds on what may be lost choose among several settings
    """

    chips: type[ChipT]
    setting: Callable[[ChipT, Mapping[str, Value | None]], Setting]
    fulfil: Callable[[CompileRequest[ChipT]], Compiled]
    check_kinds: Callable[[ChipT, Sequence[str]], None]
    bounds_choose: bool = False


FAMILIES: tuple[Family[Any], ...] = (
    Family(hw.Chip, setting_for, fulfil_for_mesh, check_kinds, bounds_choose=True),
    Family(XyloChip, XYLO_SETTING.for_dials, fulfil_for_xylo, XYLO_KINDS.check),
    Family(SpinnakerChip, SPINNAKER_SETTING.for_dials, fulfil_for_spinnaker, SPINNAKER_KINDS.check),
)


def family_of(chip: AnyChip) -> Family[Any]:
    """Return the row of a chip."""
    return next(family for family in FAMILIES if isinstance(chip, family.chips))
