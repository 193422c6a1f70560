"""What a report rests on besides the model file: the length of a step, and everything that was assumed."""

from collections.abc import Iterator

from hw_model.values import Frozen
from locsnn_compile.data.recordings import Binned, Origin, Recordings
from locsnn_compile.errors import counted
from locsnn_compile.network.network import Network


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
    if recordings.origin == "made up":
        yield (
            f"The check plays made-up recordings ({recordings.source}): accuracy is not known, and agreement, energy "
            "and time will differ on real ones."
        )
    if recordings.origin == "trained on":
        yield (
            "The check plays recordings that the network was trained on, which the model carries: its accuracy on "
            "others may be lower."
        )
    if recordings.threshold is not None and network.event_threshold is None:
        bins = f"A bin of more than {counted(recordings.threshold, 'event')} is 1, the default"
        yield f"{bins}, because the model does not say (--threshold)."
    steps = recordings.spikes.shape[1]
    if not network.any_length and steps < network.steps:
        yield f"The recordings have {counted(steps, 'step')}; silence follows, up to the {network.steps} of the model."


def _of_step(network: Network, known: float | None) -> Iterator[str]:
    if known is None:
        yield (
            "How long a step lasts is not known, because neither the model nor the recordings say it "
            "(--step-seconds, or --dt of a NIR graph): there is no comparison with the pace of a sensor."
        )
    elif network.step_seconds is None:
        yield f"A step lasts {known:g} s, like the bins of the recordings, because the model does not say."


def _of_calibration(network: Network, recordings: Recordings, calibration: Recordings) -> Iterator[str]:
    if not network.has_float_weights:
        return
    on = f"{counted(len(calibration), 'recording')} that the model carries"
    if calibration is recordings:
        on = "the recordings of the check itself"
    elif calibration.origin == "made up":
        on = f"{counted(len(calibration), 'made-up recording')} ({calibration.source})"
    elif calibration.origin == "given":
        return
    yield f"The program was calibrated on {on}: its weights and settings suit these. Give others with --calibration."
