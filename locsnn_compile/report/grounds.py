"""What a report rests on besides the model file: the length of a step, and everything that was assumed."""

from collections.abc import Iterator

from hw_model.values import Frozen
from locsnn_compile.data.recordings import Binned, Origin, Recordings
from locsnn_compile.errors import counted
from locsnn_compile.network.network import Network
from locsnn_compile.report.words import sentence


class Grounds(Frozen):
    """The length of a time step, None if it is not known; the origin of the recordings; and what was assumed.

    ``assumptions`` are sentences in the order in which they were made: by the frontend, then on the recordings and the
    step, then on what weights were rounded for. ``binned`` says what was left out on reading the recordings.
    """

    step_seconds: float | None
    events_origin: Origin
    assumptions: tuple[str, ...]
    binned: Binned | None = None


def grounds_of(network: Network, recordings: Recordings, calibration: Recordings) -> Grounds:
    """Return the grounds of a check of ``network`` on ``recordings``, its weights rounded on ``calibration``."""
    # The bins of made-up recordings say nothing about a sensor.
    of_bins = None if recordings.origin == "made up" else recordings.step_seconds
    known = of_bins if network.step_seconds is None else network.step_seconds
    rest = (*_of_recordings(network, recordings), *_of_step(network, known))
    last = tuple(_of_calibration(network, recordings, calibration))
    return Grounds(known, recordings.origin, (*network.assumptions, *rest, *last), recordings.binned)


def _of_recordings(network: Network, recordings: Recordings) -> Iterator[str]:
    if recordings.origin in ("made up", "trained on"):
        yield sentence(recordings.origin, source=recordings.source)
    if recordings.threshold is not None and network.event_threshold is None:
        yield sentence("default threshold", events=counted(recordings.threshold, "event"))
    steps = recordings.spikes.shape[1]
    if not network.any_length and steps < network.steps:
        yield sentence("silence follows", steps=counted(steps, "step"), all_steps=network.steps)


def _of_step(network: Network, known: float | None) -> Iterator[str]:
    if known is None:
        yield sentence("no step")
    elif network.step_seconds is None:
        yield sentence("step of the bins", seconds=known)


def _of_calibration(network: Network, recordings: Recordings, calibration: Recordings) -> Iterator[str]:
    given = calibration.origin == "given" and calibration is not recordings
    # The weights of other neurons round alike for any recordings.
    if network.by_strategy and not given:
        on = f"{counted(len(calibration), 'recording')} that the model carries"
        if calibration is recordings:
            on = "the recordings of the check itself"
        elif calibration.origin == "made up":
            on = f"{counted(len(calibration), 'made-up recording')} ({calibration.source})"
        yield sentence("calibrated", on=on)
