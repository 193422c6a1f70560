"""Options for turning recordings into steps and channels, where neither the recordings nor the model say how."""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import hw_model as hw
from hw_model.values import picked
from locsnn_compile.cli.options import given
from locsnn_compile.data.channels import Channels, flat_channels, parse_numbering
from locsnn_compile.data.read import read_in_chunks, read_recordings
from locsnn_compile.data.recordings import BATCH, EventTimes, Expected, Recordings
from locsnn_compile.data.selection import SELECTING, asked_selection, selected_layout
from locsnn_compile.data.sensor import POLARITIES, SensorLayout, asked_layout
from locsnn_compile.errors import InputError, check_most, counted

if TYPE_CHECKING:
    # For types alone: importing networks would take a third of the time of locsnn run, which plays programs.
    from locsnn_compile.network.network import Network

FILE_OPTIONS = (
    "--start",
    "--time-unit",
    "--max-steps",
    "--classes",
    "--axes",
    "--grid",
    "--layout",
    "--channels",
    "--polarities",
    "--columns",
    "--merge-polarities",
    "--only-taxels",
    "--only-polarity",
    "--merge-channels",
)
"""The options that say how files are read."""
STEP_OPTIONS = ("--step-seconds", "--steps")
"""The options that mean the same of recordings that were read, and written again in bins."""
_READING_OPTIONS = (*STEP_OPTIONS, "--threshold", *FILE_OPTIONS)


def asked_reading(args: argparse.Namespace) -> dict[str, Any]:
    """Return these options as arguments of ``read_recordings``."""
    return undivided_reading(args) | picked(args, "fold") | {"test_share": args.split}


def undivided_reading(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options of commands that do not divide recordings as arguments of ``read_recordings``."""
    return picked(args, "step_seconds", "steps", "threshold") | file_reading(args)


def reading_arguments(
    args: argparse.Namespace, options: Iterable[str] = _READING_OPTIONS
) -> tuple[str, ...]:
    """Return those of the options that say how recordings are read, as they are typed."""
    arguments: list[str] = []
    for option, value in given(args, options).items():
        arguments.append(option)
        if value is not True:
            arguments.append(str(value))
    return tuple(arguments)


def file_reading(args: argparse.Namespace) -> dict[str, Any]:
    """Return what the options say of files and the sensor, as arguments of ``read_recordings``."""
    of_events = picked(args, "start", "time_unit", "max_steps", "classes")
    reading = of_events | picked(args, "axes", *SELECTING)
    sensor = asked_sensor(args)
    if sensor is not None:
        return reading | {"sensor": sensor}
    return reading | picked(args, "polarities", "columns")


def asked_sensor(args: argparse.Namespace) -> SensorLayout | None:
    """Return the sensor that the options describe, None if they do not.

    Where polarities are merged, or one is picked, there are two, unless the options say otherwise.
    """
    polarities = args.polarities
    if polarities is None and (args.merge_polarities or args.only_polarity is not None):
        polarities = POLARITIES
    if args.grid is None and args.layout is None and args.channels is None:
        return None
    return asked_layout(args.grid, polarities, args.channels, args.layout, args.columns)


def read_for_program(
    args: argparse.Namespace, path: str, program: hw.ChipProgram, split: str | None = None
) -> Recordings:
    """Return recordings in the steps of a program, or as the options ask where the program does not say."""
    return _fitting(
        program,
        read_recordings(path, split=split, model=_expected(args, program), **asked_reading(args)),
    )


def chunks_for_program(args: argparse.Namespace, program: hw.ChipProgram) -> Iterator[Recordings]:
    """Yield the recordings of ``--events`` in the same way, a few at a time if the file allows it."""
    model = _expected(args, program)
    chunks = read_in_chunks(args.events, BATCH, model=model, **asked_reading(args))
    return (_fitting(program, part) for part in chunks)


def chunks_expected(args: argparse.Namespace, expected: Expected) -> Iterator[Recordings]:
    """Yield the recordings of ``--events``, a few at a time, for a program that expects these."""
    model = _numbered(args, expected)
    for part in read_in_chunks(args.events, BATCH, model=model, **asked_reading(args)):
        _check_channels(part, expected.channels)
        _check_steps(part, expected.steps)
        yield part


def assumption_lines(recordings: Recordings) -> list[str]:
    """Return what was taken where neither the recordings nor the program said it, a line for each sentence."""
    return [f"assumed: {sentence}" for sentence in recordings.assumed]


def _fitting(program: hw.ChipProgram, recordings: Recordings) -> Recordings:
    """Return the recordings; ``InputError`` if they last longer, are of another sensor, or one stream of several.

    A program that begins with the first touch ends by itself, however long a recording is.
    """
    wanted, *others = program.streams.values()
    if others:
        where = f"events {recordings.source!r}"
        what = "the program has several inputs, and a file holds one"
        fix = "Play it in Python, by hw.simulate."
        raise InputError(where, what, measured=", ".join(program.streams)[:80], fix=fix)
    _check_channels(recordings, wanted)
    if all(phase.align_events is None for phase in program.phases):
        _check_steps(recordings, expected_by(program).steps)
    return recordings


def _check_channels(recordings: Recordings, wanted: int | None) -> None:
    channels = recordings.spikes.shape[2]
    if channels != wanted:
        where = f"events {recordings.source!r}"
        what = "the channel count differs from the program's"
        measured = f"{counted(channels, 'channel')} against {wanted}"
        fix = f"Give recordings of {wanted} channels."
        raise InputError(where, what, measured=measured, fix=fix)


def _check_steps(recordings: Recordings, program_steps: int | None) -> None:
    """Refuse recordings that are longer than a program that has a length."""
    if program_steps is not None:
        where = f"events {recordings.source!r}"
        what = "the recordings are longer than the program"
        fix = f"Cut them with --steps {program_steps}."
        check_most(recordings.spikes.shape[1], program_steps, where, what, unit="steps", fix=fix)


def _expected(args: argparse.Namespace, program: hw.ChipProgram) -> Expected:
    """Return the recordings that a program expects, numbered as the options say if it does not."""
    return _numbered(args, expected_by(program))


def _numbered(args: argparse.Namespace, expected: Expected) -> Expected:
    """Return what is expected, its channels numbered as the options say if it does not say so."""
    if args.channel_order is None:
        return expected
    own = expected.inputs.numbering if expected.inputs else expected.numbering
    if own not in (None, args.channel_order):
        what, measured = f"{expected.whose} has another", f"got {args.channel_order} against {own}"
        raise InputError("--channel-order", what, measured=measured, fix="Leave it out.")
    return replace(expected, numbering=parse_numbering(args.channel_order))


def expected_by(program: hw.ChipProgram) -> Expected:
    """Return the recordings that a program expects."""
    fixed = [
        phase.steps for phase in program.phases if phase.axis == "time" and phase.steps is not None
    ]
    turned = (item for item in program.inputs if item.positions is not None)
    fixed += [
        item.size - (0 if item.first_lines is None else int(item.first_lines.max()))
        for item in turned
    ]
    return Expected(
        f"program {program.name!r}",
        program.step_seconds,
        program.event_threshold,
        min(fixed, default=None),
        max(program.streams.values(), default=None),
        program.class_names,
        _inputs_of(program),
        parse_numbering(program.channel_order),
        event_times=EventTimes(program.start, program.time_unit),
        recorded=program.recorded,
    )


def _inputs_of(program: hw.ChipProgram) -> Channels | None:
    """Return the pixels that the channels of a program are; None if it does not say so, as earlier versions did."""
    channels = max(program.streams.values(), default=0)
    where = f"program {program.name!r}"
    numbering = parse_numbering(program.channel_order)
    return flat_channels(channels, program.polarities, program.columns, numbering, where)


def with_steps(network: "Network", args: argparse.Namespace) -> "Network":
    """Return the network with the steps asked for; ``InputError`` if its file says otherwise."""
    agreed = network.expected.agreed(**picked(args, "step_seconds", "steps", "threshold"))
    network = replace(
        network, step_seconds=agreed["step_seconds"], event_threshold=agreed["threshold"]
    )
    if args.step_seconds is not None:
        network = _with_made_up_steps(network, args.step_seconds)
    if args.steps is None or not network.any_length:
        return network
    carried = network.recordings and network.recordings.with_steps(args.steps)
    return replace(network, steps=args.steps, any_length=False, recordings=carried)


def _with_made_up_steps(network: "Network", step_seconds: float) -> "Network":
    """Return the network of a step that the user gives, which made-up recordings then have as well.

    What was assumed in its place is assumed no more: such a sentence names the option.
    """
    carried = network.recordings
    if carried is not None and network.usual_step_seconds is not None:
        carried = replace(carried, step_seconds=step_seconds)
    assumptions = tuple(
        sentence for sentence in network.assumptions if "(--step-seconds)" not in sentence
    )
    return replace(network, usual_step_seconds=None, recordings=carried, assumptions=assumptions)


def on_sensor(network: "Network", args: argparse.Namespace) -> "Network":
    """Return the network with the grid of its inputs, if the options give both their order and the sensor."""
    sensor = asked_sensor(args)
    if sensor is None or sensor.inputs is None or network.channel_order is None:
        return network
    inputs = selected_layout(sensor, asked_selection(args)).inputs
    assert inputs is not None  # its channels are known before some of them are selected
    inputs = replace(inputs, numbering=network.channel_order)
    return replace(network, inputs=inputs) if inputs.count == network.channels else network
