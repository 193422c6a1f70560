"""The recordings that a program of any arithmetic expects."""

from hw_model.spinnaker.program import SpinnakerProgram
from hw_model.targets.saved import AnyProgram
from hw_model.xylo.program import XyloProgram
from locsnn_compile.cli import run_spinnaker, run_xylo, step_options
from locsnn_compile.data.recordings import Expected


def expected_by_any(program: AnyProgram) -> Expected:
    """Return what a program says of its recordings."""
    if isinstance(program, SpinnakerProgram):
        return run_spinnaker.expected_by(program)
    if isinstance(program, XyloProgram):
        return run_xylo.expected_by(program)
    return step_options.expected_by(program)
