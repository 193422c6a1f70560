"""How ``locsnn run`` and ``locsnn diff`` play programs: one row for each kind of program.

There are programs for meshes of cores (and the open core), for Xylo and for SpiNNaker. The modules
that play a kind are imported only when such a program is played: each takes time to import.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import hw_model as hw
from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.targets.programs import AnyProgram
from hw_model.xylo.program import XyloProgram
from locsnn_compile.cli import step_options
from locsnn_compile.data.recordings import Expected

if TYPE_CHECKING:
    from locsnn_compile.cli.run_whole import WholeProgram


class ProgramPlayer(NamedTuple):
    """How commands play one kind of program.

    - ``expected_by``: returns which recordings a program takes: their steps, channels and numbering
    - ``whole``: prepares a program that can only be played in whole recordings; None for programs
      that can also be played step by step, priced, and stopped early
    """

    expected_by: Callable[[Any], Expected]
    whole: "Callable[[Any], WholeProgram] | None" = None


def _expected_by_xylo(program: XyloProgram) -> Expected:
    from locsnn_compile.cli import run_xylo

    return run_xylo.expected_by(program)


def _whole_xylo(program: XyloProgram) -> "WholeProgram":
    from locsnn_compile.cli.run_xylo import whole_xylo

    return whole_xylo(program)


def _expected_by_spinnaker(program: SpinnakerProgram) -> Expected:
    from locsnn_compile.cli import run_spinnaker

    return run_spinnaker.expected_by(program)


def _whole_spinnaker(program: SpinnakerProgram) -> "WholeProgram":
    from locsnn_compile.cli.run_spinnaker import whole_spinnaker

    return whole_spinnaker(program)


PLAYERS: Mapping[type, ProgramPlayer] = {
    hw.ChipProgram: ProgramPlayer(step_options.expected_by),
    XyloProgram: ProgramPlayer(_expected_by_xylo, _whole_xylo),
    SpinnakerProgram: ProgramPlayer(_expected_by_spinnaker, _whole_spinnaker),
}
"""The rows, by the class of a program."""


def player_of(program: AnyProgram) -> ProgramPlayer:
    """Return the row of a program."""
    return PLAYERS[type(program)]


def expected_by(program: AnyProgram) -> Expected:
    """Return which recordings a program takes."""
    return player_of(program).expected_by(program)
