"""How the compiler treats each family of chips: a table with one row for each.

A family is a group of chips that compute in the same way: meshes of cores (and the open core), Xylo,
SpiNNaker. To add one, describe its chips (:mod:`hw_model.targets.families`), write how a network is
compiled for them in a folder of its own, and add its row here.
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
from locsnn_compile.network.network import Network
from locsnn_compile.request.compile_request import CompileRequest
from locsnn_compile.settings import Setting, Value, setting_for
from locsnn_compile.spinnaker.compile import fulfil_for_spinnaker
from locsnn_compile.spinnaker.compiled import SPINNAKER_KINDS
from locsnn_compile.spinnaker.fits import check_fits_spinnaker
from locsnn_compile.spinnaker.setting import SPINNAKER_SETTING
from locsnn_compile.xylo.compile import fulfil_for_xylo
from locsnn_compile.xylo.compiled import XYLO_KINDS
from locsnn_compile.xylo.parts import check_fits_xylo
from locsnn_compile.xylo.setting import XYLO_SETTING

ChipT = TypeVar("ChipT", bound=AnyChip)


@dataclass(frozen=True)
class Family(Generic[ChipT]):
    """Chips for which networks are compiled in the same way.

    - ``chips``: the class of their descriptions
    - ``setting``: makes a setting of values by dial, where None stands for the usual value;
      ``InputError`` for a value that means nothing here
    - ``fulfil``: compiles a network as requested, and checks it against the float reference
    - ``check_network``: raises ``TargetError`` for a network that no setting could compile
    - ``check_kinds``: refuses kinds of ``--emit`` that show what such a chip does not have
    - ``bounds_choose``: there are several settings, among which bounds on the losses choose
    """

    chips: type[ChipT]
    setting: Callable[[ChipT, Mapping[str, Value | None]], Setting]
    fulfil: Callable[[CompileRequest[ChipT]], Compiled]
    check_network: Callable[[ChipT, Network], None]
    check_kinds: Callable[[ChipT, Sequence[str]], None]
    bounds_choose: bool = False


def _refuse_nothing(chip: hw.Chip, network: Network) -> None:
    """Do nothing: whether a mesh can hold a network is known only after its neurons are lowered."""


FAMILIES: tuple[Family[Any], ...] = (
    Family(
        chips=hw.Chip,
        setting=setting_for,
        fulfil=fulfil_for_mesh,
        check_network=_refuse_nothing,
        check_kinds=check_kinds,
        bounds_choose=True,
    ),
    Family(
        chips=XyloChip,
        setting=XYLO_SETTING.for_dials,
        fulfil=fulfil_for_xylo,
        check_network=check_fits_xylo,
        check_kinds=XYLO_KINDS.check,
    ),
    Family(
        chips=SpinnakerChip,
        setting=SPINNAKER_SETTING.for_dials,
        fulfil=fulfil_for_spinnaker,
        check_network=check_fits_spinnaker,
        check_kinds=SPINNAKER_KINDS.check,
    ),
)


def family_of(chip: AnyChip) -> Family[Any]:
    """Return the family of a chip."""
    return next(family for family in FAMILIES if isinstance(chip, family.chips))


def setting_of(chip: AnyChip, network: Network, values: Mapping[str, Value | None]) -> Setting:
    """Return the setting that ``values`` by dial stand for; None stands for the usual value.

    Raises ``TargetError`` for a network that the chip cannot hold by any setting, and ``InputError``
    for a value that means nothing for the chip. The network is checked first: users should not
    correct a value only to learn afterwards that the network does not fit.
    """
    family = family_of(chip)
    family.check_network(chip, network)
    setting: Setting = family.setting(chip, values)
    return setting
