"""What a report rests on besides the model file: the length of a step, and everything that was assumed."""

from collections.abc import Collection, Iterable, Iterator

from hw_model.description.chip import Registers
from hw_model.values import FloatArray, Frozen
from locsnn_compile.data.recordings import Binned, Origin, Recordings, same
from locsnn_compile.errors import counted, listed
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedPopulation


class Grounds(Frozen):
    """The length of a time step, None if it is not known; the origin of the recordings; and what was assumed.

    ``assumptions`` are sentences in the order in which they were made: by the frontend, then on the registers, the
    recordings and the step, then on what weights were rounded for. ``binned`` says what was left out on reading the
    recordings.
    """

    step_seconds: float | None
    events_origin: Origin
    assumptions: tuple[str, ...]
    binned: Binned | None = None


def grounds_of(
    network: Network,
    recordings: Recordings,
    calibration: Recordings,
    registers: Registers | None,
    *,
    chosen: bool = False,
    rounded: Collection[QuantizedPopulation] = (),
) -> Grounds:
    """Return the grounds of a check of ``network`` on ``recordings``, its weights rounded on ``calibration``.

    ``registers`` are those of the chip, None where the reference does not compute in registers.
    ``chosen``: settings were chosen on ``calibration`` as well. ``rounded``: the populations in integers.
    """
    # The bins of made-up recordings say nothing about a sensor.
    of_bins = None if recordings.origin == "made up" else recordings.step_seconds
    known = network.stated_step_seconds if of_bins is None else of_bins
    rest = (
        *(() if registers is None else _of_registers(network, registers)),
        *_of_floors(rounded),
        *_of_recordings(network, recordings),
        *_of_step(network, recordings, known),
    )
    last: tuple[str, ...] = ()
    if chosen or _is_rounded_for_recordings(network, rounded):
        last = tuple(_of_calibration(recordings, calibration))
    return Grounds(
        known, recordings.origin, (*network.assumptions, *rest, *last), recordings.binned
    )


def _is_rounded_for_recordings(network: Network, rounded: Collection[QuantizedPopulation]) -> bool:
    """Tell whether other recordings could give other weights.

    Those of neurons that no strategy lowers, and those of strategy ``reset``, round one by one.
    """
    strategies = {each.strategy for each in rounded if each.population.neuron.by_strategy}
    return network.by_strategy and strategies != {"reset"}


def _of_registers(network: Network, registers: Registers) -> Iterator[str]:
    """The reference wraps and clips like the chip of the program, which may not be that of the training."""
    bits_here = (registers.charge_bits, registers.current_bits, registers.voltage_bits)
    for chip, bits in network.trained_on.items():
        if bits != bits_here:
            yield (
                f"The network was trained in the integers of {chip}, whose registers of charge, "
                f"current and voltage have {listed([*map(str, bits)])} bits. Those of this chip have "
                f"{listed([*map(str, bits_here)])}: what is called as trained wraps and clips like them, "
                "not as in the training."
            )


def _of_floors(rounded: Iterable[QuantizedPopulation]) -> Iterator[str]:
    """Say where floors of potentials are, and where the chip's registers have them."""
    names: dict[tuple[str, str], list[str]] = {}
    for q in rounded:
        wanted: FloatArray | None = getattr(q.population.neuron, "floor", None)
        vmin = q.neuron.limits.get("vmin")
        if wanted is not None and vmin is not None:
            pair = _numbers(wanted), _numbers(vmin / q.scale)
            names.setdefault(pair, []).append(repr(q.population.name))
    for (wanted_text, held_text), of_pair in names.items():
        yield (
            f"Potentials of {listed(of_pair)} stop falling at {wanted_text} from where they start "
            f"(--floor), on the chip at {held_text}: a core's voltage ends below at 1 - 2^k. What "
            "stops there is counted among the clips."
        )


def _numbers(values: FloatArray) -> str:
    """Return the one number of equal ones, or the least and the largest."""
    low = f"{values.min() + 0.0:.7g}"
    high = f"{values.max() + 0.0:.7g}"
    return low if low == high else f"{low} to {high}"


def _of_recordings(network: Network, recordings: Recordings) -> Iterator[str]:
    if recordings.origin == "made up":
        yield (
            f"The check plays made-up recordings ({recordings.source}): accuracy is not known, and "
            "agreement, energy and time will differ on real ones."
        )
    if recordings.origin == "trained on":
        yield (
            "The check plays recordings that the network was trained on, which the model carries: "
            "its accuracy on others may be lower."
        )
    yield from recordings.assumed
    if recordings.threshold is not None and network.event_threshold is None:
        events = counted(recordings.threshold, "event")
        yield (
            f"A bin of more than {events} is 1, the default, because the model does not say "
            "(--threshold)."
        )
    steps = recordings.spikes.shape[1]
    if not network.any_length and steps < network.steps:
        yield (
            f"The recordings have {counted(steps, 'step')}; silence follows, up to the "
            f"{network.steps} of the model."
        )


def _of_step(network: Network, recordings: Recordings, known: float | None) -> Iterator[str]:
    """Say where the length of a step comes from, unless both sides or the user state it."""
    stated = network.usual_step_seconds or network.step_seconds
    if known is None:
        yield (
            "How long a step lasts is not known, because neither the model nor the recordings say it "
            "(--step-seconds): there is no comparison with the pace of a sensor."
        )
    elif recordings.binned is not None and recordings.binned.step_is_default:
        yield (
            f"A step lasts {known:g} s, the default, because neither the model nor the recordings say "
            "(--step-seconds)."
        )
    elif stated is None:
        yield (
            f"A step lasts {known:g} s, like the bins of the recordings, because the model does not "
            "say."
        )
    elif not same(known, stated):
        yield (
            f"A step lasts {known:g} s, like the bins of the recordings; the model states "
            f"{stated:g} s."
        )
    elif network.usual_step_seconds is not None:
        yield (
            f"A step lasts {known:g} s, as the model states it, unless --step-seconds gives another."
        )


def _of_calibration(recordings: Recordings, calibration: Recordings) -> Iterator[str]:
    if calibration.origin != "given" or calibration is recordings:
        on = f"{counted(len(calibration), 'recording')} that the model carries"
        if calibration is recordings:
            on = "the recordings of the check itself"
        elif calibration.origin == "made up":
            on = f"{counted(len(calibration), 'made-up recording')} ({calibration.source})"
        yield (
            f"The program was calibrated on {on}: its weights and settings suit these. "
            "Give others with --calibration."
        )
