"""Options for turning recordings into steps and channels, where neither the recordings nor the model say how.

``declarations/shared.py`` declares these options. This module turns them into arguments of
``read_recordings``, reads recordings for a program or a network, and refuses those that do not fit
its channels and steps. What a program or network *expects* is an ``Expected``: the steps, channels,
classes and numbering that it states, each None if it does not state it.
"""

import argparse
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import hw_model as hw
from hw_model.values import ByteArray, IntArray, picked
from locsnn_compile.cli.options import given_options
from locsnn_compile.data.channels import flat_channels, parse_numbering
from locsnn_compile.data.read import read_in_chunks, read_recordings
from locsnn_compile.data.recordings import BATCH, EventTimes, Expected, Recordings, batches
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
"""The options that say how files of events are read."""
STEP_OPTIONS = ("--step-seconds", "--steps")
"""The options that a command needs as well if it reads a copy of the recordings, which holds bins."""
_READING_OPTIONS = (*STEP_OPTIONS, "--threshold", *FILE_OPTIONS)
"""All options that determine what is read from a file."""


def reading_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return all options on reading and on dividing recordings, as arguments of ``read_recordings``."""
    return undivided_reading_options(args) | picked(args, "fold") | {"test_share": args.split}


def undivided_reading_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options on reading, without those that divide recordings, in the same form."""
    return picked(args, "step_seconds", "steps", "threshold") | file_reading_options(args)


def reading_arguments(
    args: argparse.Namespace, options: Iterable[str] = _READING_OPTIONS
) -> tuple[str, ...]:
    """Return those of the ``options`` that were given, as words of a command line."""
    arguments: list[str] = []
    for option, value in given_options(args, options).items():
        arguments.append(option)
        if value is not True:  # a flag has no value
            arguments.append(str(value))
    return tuple(arguments)


def file_reading_options(args: argparse.Namespace) -> dict[str, Any]:
    """Return the options on files and on the sensor, as arguments of ``read_recordings``."""
    options = picked(args, "start", "time_unit", "max_steps", "classes", "axes", *SELECTING)
    sensor = described_sensor(args)
    if sensor is not None:
        # The sensor has its polarities and columns.
        return options | {"sensor": sensor}
    return options | picked(args, "polarities", "columns")


def described_sensor(args: argparse.Namespace) -> SensorLayout | None:
    """Return the sensor that ``--grid``, ``--layout`` or ``--channels`` describes; None without any.

    Options that merge the two polarities, or pick one, imply that the sensor has two.
    """
    polarities = args.polarities
    uses_polarities = args.merge_polarities or args.only_polarity is not None
    if polarities is None and uses_polarities:
        polarities = POLARITIES
    if args.grid is None and args.layout is None and args.channels is None:
        return None
    return asked_layout(args.grid, polarities, args.channels, args.layout, args.columns)


def read_for_program(
    args: argparse.Namespace, path: str, program: hw.ChipProgram, split: str | None = None
) -> Recordings:
    """Read the recordings at ``path`` for a program, and refuse them if they do not fit it.

    The steps are those that the program states, otherwise those of the options. ``split`` is the
    part, ``train`` or ``test``, of divided recordings.
    """
    expected = _with_channel_order(args, expected_by(program))
    recordings = read_recordings(path, split=split, model=expected, **reading_options(args))
    _check_fit(program, recordings)
    return recordings


def chunks_for_program(args: argparse.Namespace, program: hw.ChipProgram) -> Iterator[Recordings]:
    """Yield the recordings of ``--events``, read and checked in the same way, a few at a time.

    If the format of the file does not allow reading a part of it, all come at once.
    """
    expected = _with_channel_order(args, expected_by(program))
    for chunk in read_in_chunks(args.events, BATCH, model=expected, **reading_options(args)):
        _check_fit(program, chunk)
        yield chunk


def chunks_expected(args: argparse.Namespace, expected: Expected) -> Iterator[Recordings]:
    """Yield the recordings of ``--events``, a few at a time, for a program that expects these."""
    model = _with_channel_order(args, expected)
    for chunk in read_in_chunks(args.events, BATCH, model=model, **reading_options(args)):
        _check_channels(chunk, expected.channels)
        _check_steps(chunk, expected.steps)
        yield chunk


def batches_with_labels(recordings: Recordings) -> Iterator[tuple[ByteArray, IntArray | None]]:
    """Yield the spikes of a few recordings at a time, (batch, steps, channels), with their labels.

    Labels are (batch,), or None if the recordings have none.
    """
    for batch in batches(len(recordings)):
        labels = None if recordings.labels is None else recordings.labels[batch]
        yield recordings.spikes[batch], labels


def assumption_lines(recordings: Recordings) -> list[str]:
    """Return a line for each thing that was assumed, because neither recordings nor program state it."""
    return [f"assumed: {sentence}" for sentence in recordings.assumed]


def _check_fit(program: hw.ChipProgram, recordings: Recordings) -> None:
    """Refuse recordings that a program cannot play.

    They are of another number of channels or of more steps, or the program has several input streams,
    of which a file holds only one.
    """
    channels, *channels_of_others = program.streams.values()
    if channels_of_others:
        where = f"events {recordings.source!r}"
        what = "the program has several inputs, and a file holds one"
        fix = "Play it in Python, by hw.simulate."
        raise InputError(where, what, measured=", ".join(program.streams)[:80], fix=fix)
    _check_channels(recordings, channels)
    # A program with a phase that begins at the first touch ends by itself, however long a recording is.
    if all(phase.align_events is None for phase in program.phases):
        _check_steps(recordings, expected_by(program).steps)


def _check_channels(recordings: Recordings, program_channels: int | None) -> None:
    """Refuse recordings of another number of channels than the program has."""
    channels = recordings.spikes.shape[2]
    if channels != program_channels:
        where = f"events {recordings.source!r}"
        what = "the channel count differs from the program's"
        measured = f"{counted(channels, 'channel')} against {program_channels}"
        fix = f"Give recordings of {program_channels} channels."
        raise InputError(where, what, measured=measured, fix=fix)


def _check_steps(recordings: Recordings, program_steps: int | None) -> None:
    """Refuse recordings that are longer than the program; one that states no steps takes any length."""
    if program_steps is not None:
        where = f"events {recordings.source!r}"
        what = "the recordings are longer than the program"
        fix = f"Cut them with --steps {program_steps}."
        check_most(recordings.spikes.shape[1], program_steps, where, what, unit="steps", fix=fix)


def _with_channel_order(args: argparse.Namespace, expected: Expected) -> Expected:
    """Return what is expected, with its channels numbered as ``--channel-order`` says.

    Raises ``InputError`` if the program states another numbering.
    """
    if args.channel_order is None:
        return expected
    stated = expected.inputs.numbering if expected.inputs else expected.numbering
    if stated not in (None, args.channel_order):
        what = f"{expected.whose} has another"
        measured = f"got {args.channel_order} against {stated}"
        raise InputError("--channel-order", what, measured=measured, fix="Leave it out.")
    return replace(expected, numbering=parse_numbering(args.channel_order))


def expected_by(program: hw.ChipProgram) -> Expected:
    """Return the recordings that a program for a mesh or the open core expects.

    Two things limit their steps: the steps of a time phase, and the rows of the transpose buffer,
    from which location neurons read the events of a recording channel by channel (an input with
    ``positions``).
    """
    step_limits: list[int] = []
    for phase in program.phases:
        if phase.axis == "time" and phase.steps is not None:
            step_limits.append(phase.steps)
    for item in program.inputs:
        if item.positions is not None:
            step_limits.append(item.rows)
    channels = max(program.streams.values(), default=None)
    whose = f"program {program.name!r}"
    numbering = parse_numbering(program.channel_order)
    return Expected(
        whose,
        step_seconds=program.step_seconds,
        threshold=program.event_threshold,
        steps=min(step_limits, default=None),
        channels=channels,
        class_names=program.class_names,
        # None for a program that does not say which pixels its channels are: not every file does.
        inputs=flat_channels(channels or 0, program.polarities, program.columns, numbering, whose),
        numbering=numbering,
        event_times=EventTimes(program.start, program.time_unit),
        recorded=program.recorded,
    )


def with_steps(network: "Network", args: argparse.Namespace) -> "Network":
    """Return the network with the steps that the options give.

    Raises ``InputError`` if the file of the model states other steps.
    """
    agreed = network.expected.agreed(**picked(args, "step_seconds", "steps", "threshold"))
    network = replace(
        network, step_seconds=agreed["step_seconds"], event_threshold=agreed["threshold"]
    )
    if args.step_seconds is not None:
        network = _with_given_step_seconds(network, args.step_seconds)
    # A network that states its steps has agreed with the option, so there is nothing to change.
    if args.steps is None or not network.any_length:
        return network
    carried = network.recordings and network.recordings.with_steps(args.steps)
    return replace(network, steps=args.steps, any_length=False, recordings=carried)


def _with_given_step_seconds(network: "Network", step_seconds: float) -> "Network":
    """Return the network with the user's width of a step instead of the one that was assumed.

    Made-up recordings that the network carries get the same width. The sentence about the width
    that was assumed goes: it is the one that names the option.
    """
    carried = network.recordings
    # Networks with a usual width come from files of other tools, which carry no recordings: those
    # here were made up with that width when the file was read.
    if carried is not None and network.usual_step_seconds is not None:
        carried = replace(carried, step_seconds=step_seconds)
    assumptions = tuple(
        sentence for sentence in network.assumptions if "(--step-seconds)" not in sentence
    )
    return replace(network, usual_step_seconds=None, recordings=carried, assumptions=assumptions)


def on_sensor(network: "Network", args: argparse.Namespace) -> "Network":
    """Return the network with its input channels placed on the sensor that the options describe.

    Nothing changes if the options describe no sensor, the numbering of the inputs is unknown, or the
    sensor has another number of channels.
    """
    sensor = described_sensor(args)
    if sensor is None or sensor.inputs is None or network.channel_order is None:
        return network
    inputs = selected_layout(sensor, asked_selection(args)).inputs
    assert inputs is not None  # selecting channels of a sensor keeps their places
    inputs = replace(inputs, numbering=network.channel_order)
    return replace(network, inputs=inputs) if inputs.count == network.channels else network
