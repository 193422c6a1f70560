"""Collect the grounds of a report: what its figures rest on besides the model file.

These are the length of a time step, the origin of the recordings that were played in the check, and
one sentence for every assumption made on the way, such as a default that no file states. The report
shows the sentences above all else that limits its figures.
"""

from collections.abc import Collection, Iterable, Iterator

from hw_model.description.chip import Registers
from hw_model.values import FloatArray, Frozen
from locsnn_compile.data.recordings import Binned, Origin, Recordings, same_within_rounding
from locsnn_compile.errors import counted, listed
from locsnn_compile.network.network import Network
from locsnn_compile.network.quantized import QuantizedPopulation


class Grounds(Frozen):
    """What the figures of a report rest on besides the model file.

    - ``step_seconds``: the length of a time step in seconds, of the recordings' bins or else as the model states it;
      None if unknown
    - ``events_origin``: where the recordings of the check come from
    - ``assumptions``: sentences, in the order in which the assumptions were made: by the frontend, then
      on the registers, the recordings and the step, then on the recordings that weights were rounded for
    - ``binned``: what was left out when events were sorted into time steps, None if nothing was sorted
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
    ``chosen``: settings were chosen on ``calibration`` as well. ``rounded``: the populations in integers; empty for
    chips on which neither strategies nor floors exist.
    """
    # The bins of made-up recordings say nothing about a sensor.
    bin_seconds = None if recordings.origin == "made up" else recordings.step_seconds
    step_seconds = network.stated_step_seconds if bin_seconds is None else bin_seconds
    assumptions = list(network.assumptions)
    if registers is not None:
        assumptions += _on_registers(network, registers)
    assumptions += _on_floors(rounded)
    assumptions += _on_recordings(network, recordings)
    assumptions += _on_step(network, recordings, step_seconds)
    if chosen or _is_rounded_for_recordings(network, rounded):
        assumptions += _on_calibration(recordings, calibration)
    return Grounds(step_seconds, recordings.origin, tuple(assumptions), recordings.binned)


def _is_rounded_for_recordings(network: Network, rounded: Collection[QuantizedPopulation]) -> bool:
    """Whether other recordings could give other weights.

    Most strategies (ways to lay out a neuron in compartments) round the weights of a neuron together,
    so that their errors cancel on the calibration recordings. Strategy ``reset``, and neurons that
    need no strategy, round each weight to the nearest value of the grid, whatever the recordings.
    """
    if not network.by_strategy:
        return False
    # Only spike response neurons have a strategy of their own (``by_strategy``). If the strategies are unknown, because
    # ``rounded`` is empty, the assumption is stated rather than left out.
    strategies = {
        population.strategy for population in rounded if population.population.neuron.by_strategy
    }
    return strategies != {"reset"}


def _on_registers(network: Network, registers: Registers) -> Iterator[str]:
    """Say for which chip the network was trained if this chip's registers have other widths.

    The reference computes with the registers of this chip, so it wraps and clips where this chip does,
    which need not be where the training did. Reports call the reference the network "as trained", which
    is then not quite true.
    """
    bits_here = (registers.charge_bits, registers.current_bits, registers.voltage_bits)
    for chip, bits in network.trained_on.items():
        if bits != bits_here:
            yield (
                f"The network was trained in the integers of {chip}, whose registers of charge, "
                f"current and voltage have {listed([*map(str, bits)])} bits. Those of this chip have "
                f"{listed([*map(str, bits_here)])}: what is called as trained wraps and clips like them, "
                "not as in the training."
            )


def _on_floors(rounded: Iterable[QuantizedPopulation]) -> Iterator[str]:
    """Say at which floor potentials stop falling in the network, and at which floor on the chip.

    The option ``--floor`` gives the floor of the network. On the chip, the lowest voltage of a core can only be
    ``1 - 2^k`` for a whole number k, so the two differ. Populations with the same two floors share a sentence.
    """
    names_by_floors: dict[tuple[str, str], list[str]] = {}
    for q in rounded:
        network_floor: FloatArray | None = getattr(q.population.neuron, "floor", None)
        vmin = q.neuron.limits.get("vmin")
        if network_floor is not None and vmin is not None:
            # The scale is in units of the register per unit of the network's potential.
            chip_floor = vmin / q.scale
            floors = _range_text(network_floor), _range_text(chip_floor)
            names_by_floors.setdefault(floors, []).append(repr(q.population.name))
    for (network_text, chip_text), names in names_by_floors.items():
        yield (
            f"Potentials of {listed(names)} stop falling at {network_text} from where they start "
            f"(--floor), on the chip at {chip_text}: a core's voltage ends below at 1 - 2^k. What "
            "stops there is counted among the clips."
        )


def _range_text(values: FloatArray) -> str:
    """Return the least and the largest value as text, or a single number if they look the same."""
    # Adding 0.0 turns -0.0 into 0.0, which prints without a sign.
    low = f"{values.min() + 0.0:.7g}"
    high = f"{values.max() + 0.0:.7g}"
    return low if low == high else f"{low} to {high}"


def _on_recordings(network: Network, recordings: Recordings) -> Iterator[str]:
    """Say what was assumed about the recordings: their origin, the threshold of their bins, their length."""
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


def _on_step(network: Network, recordings: Recordings, step_seconds: float | None) -> Iterator[str]:
    """Say where the length of a step comes from, unless the model and the recordings agree or the user states it.

    ``step_seconds`` is the length that the report uses. A model file may state a length that recordings override
    (``usual_step_seconds``), or one that they have to keep (``network.step_seconds``).
    """
    # The usual length first: ``network.step_seconds`` may by now be that of the recordings instead.
    stated = network.usual_step_seconds or network.step_seconds
    if step_seconds is None:
        yield (
            "How long a step lasts is not known, because neither the model nor the recordings say it "
            "(--step-seconds): there is no comparison with the pace of a sensor."
        )
    elif recordings.binned is not None and recordings.binned.step_is_default:
        yield (
            f"A step lasts {step_seconds:g} s, the default, because neither the model nor the recordings say "
            "(--step-seconds)."
        )
    elif stated is None:
        yield (
            f"A step lasts {step_seconds:g} s, like the bins of the recordings, because the model does not "
            "say."
        )
    elif not same_within_rounding(step_seconds, stated):
        yield (
            f"A step lasts {step_seconds:g} s, like the bins of the recordings; the model states "
            f"{stated:g} s."
        )
    elif network.usual_step_seconds is not None:
        yield (
            f"A step lasts {step_seconds:g} s, as the model states it, unless --step-seconds gives another."
        )


def _on_calibration(recordings: Recordings, calibration: Recordings) -> Iterator[str]:
    """Say what the program was calibrated on, unless the user chose recordings for it."""
    if calibration is recordings:
        calibrated_on = "the recordings of the check itself"
    elif calibration.origin == "given":
        return
    elif calibration.origin == "made up":
        number = counted(len(calibration), "made-up recording")
        calibrated_on = f"{number} ({calibration.source})"
    else:
        calibrated_on = f"{counted(len(calibration), 'recording')} that the model carries"
    yield (
        f"The program was calibrated on {calibrated_on}: its weights and settings suit these. "
        "Give others with --calibration."
    )
