"""Check the options that say how to read a NIR graph, and read the metadata that our own files add.

NIR (neuromorphic intermediate representation) files hold equations in continuous time. The options choose what a
file leaves open: the time step ``dt``, how equations are discretised, how a spike resets, and a lowest potential
(``floor``).
"""

import math
from typing import cast, get_args

from locsnn_compile.data.recordings import STEP_SECONDS
from locsnn_compile.errors import InputError, check_known
from locsnn_compile.frontends.nir.graph import NirGraph
from locsnn_compile.frontends.nir.neurons import DT_SECONDS, Discretisation, Reading, Reset


def checked_reading(
    known_dt: float | None, reset: str | None, discretisation: str | None, floor: float | None
) -> Reading:
    """Return how a graph is read: by the options, or by convention if they are None.

    ``known_dt`` is what :func:`checked_dt` returns: seconds above 0, or None if neither an option nor the file has
    them. Raises ``InputError`` for an unknown word, and for a floor that is not finite.
    """
    discretisation = discretisation or "euler"
    place = f"discretisation {discretisation!r}"
    check_known(place, "is not known", discretisation, get_args(Discretisation))
    reset = reset or "zero"
    check_known(f"reset {reset!r}", "is not known", reset, get_args(Reset))
    if floor is not None and not math.isfinite(floor):
        what = "the floor must be a finite number"
        raise InputError("floor", what, measured=f"{floor}", fix="Give the lowest potential.")
    return Reading(
        dt=DT_SECONDS if known_dt is None else known_dt,
        discretisation=cast(Discretisation, discretisation),
        reset=cast(Reset, reset),
        floor=floor,
    )


def checked_dt(dt: float | None, graph: NirGraph) -> float | None:
    """Return the seconds per step, from the option, or from a file that we wrote; None if neither has them."""
    if dt is None:
        return metadata_seconds(graph, "dt")
    return _checked_seconds(dt, "dt")


def metadata_seconds(graph: NirGraph, name: str) -> float | None:
    """Return the seconds in an entry of the metadata, which files that we wrote have; None without such an entry.

    Any tool may write metadata. An entry of this name that is not a single number is therefore not ours, and ignored.
    """
    entry = graph.metadata.get(name)
    if entry is None or isinstance(entry, str) or entry.size != 1:
        return None
    return _checked_seconds(float(entry.reshape(-1)[0]), name)


def _checked_seconds(seconds: float, name: str) -> float:
    """Return the seconds; raise ``InputError`` if no step can last as long."""
    # The words of the error are those of ``STEP_SECONDS``.
    if not STEP_SECONDS.holds(seconds):
        what = "a step must last more than 0 s and at most 1e+06 s"
        raise InputError(name, what, measured=f"{seconds:g}", fix="Give the seconds per step.")
    return seconds
