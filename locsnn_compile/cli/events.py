"""``locsnn events``: show what recordings contain, or write them in another format.

Show what recordings contain: rates, silence, polarity, busy and dead channels, and a raster of one. --to writes them in
the format that the name ends in.

example:
  locsnn events examples/recordings/touches.npz --to touches.zip --members bs1

A folder or .zip gets a file for each recording, of the kind of --members: npy, events (arrays with the fields t, x, p,
as in Tonic), bs1, bs2 or tact. If a format cannot hold something, the options that restore it on reading are printed.
No option restores the names of classes: a line says that they are left out.

--encode turns an array of numbers in a .npy or .npz file into spikes first, and prints what is lost: by rate (numbers
from 0 to 1, the chance of a spike), by latency (from 0 to 1, the larger the earlier), or where signals cross levels.
"""

# The docstring above is the help of the command, so it stays in these words.

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

from hw_model.io.files import replace_file
from locsnn_compile.cli.encoded_values import check_encoder_options, encoded_values
from locsnn_compile.cli.options import recording_number
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import print_result
from locsnn_compile.cli.step_options import assumption_lines, described_sensor, reading_options
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.selection import asked_selection, selected_layout
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.data.statistics import event_statistics
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.report.content import Facts
from locsnn_compile.report.format import percent, plural
from locsnn_compile.report.pictures.recording import raster_svg, text_raster

# How many classes and dead channels a line names before it says that there are more: chosen by
# hand, so that lines of usual data sets fit a terminal.
_MAX_CLASSES_SHOWN = 12
_MAX_DEAD_CHANNELS_SHOWN = 24
_WITH_CLASS_NAMES = (".npz", ".pt")
"""Endings of the formats that hold the names of classes."""


def run(args: argparse.Namespace) -> int:
    """Print figures and a raster of recordings; write the raster and the recordings if asked to."""
    _check_options(args)
    outputs = (("-o", args.output), ("--to", args.to))
    places = [(f"{option} {str(path)!r}", path) for option, path in outputs if path is not None]
    # A name without an ending is a folder, which write_recordings refuses unless it is new or empty.
    check_places({"FILE": args.file}, [place for place in places if place[1].suffix])
    encoded = None if args.encode is None else encoded_values(args)
    if encoded is not None:
        recordings = encoded.recordings
    else:
        recordings = read_recordings(args.file, split=args.part, **reading_options(args))
    number = recording_number(args.recording, recordings)
    sensor = _sensor_after_selection(args)
    statistics = event_statistics(recordings, sensor)
    # Before printing: if a file cannot be written, the error is all that is printed.
    written_lines = _write_picture(args, recordings, number)
    written_lines += _write_recordings(args, recordings, sensor)
    binning = recordings.binned.words if recordings.binned else None
    lines = statistics_lines(statistics, binning)
    lines += assumption_lines(recordings)
    document = {**statistics, "assumptions": list(recordings.assumed)}
    if encoded is not None:
        lines.append(encoded.line)
        document["encoding"] = encoded.document
    lines += _raster_lines(recordings, number)
    print_result(args, document, [*lines, *written_lines])
    return 0


def _sensor_after_selection(args: argparse.Namespace) -> SensorLayout | None:
    """Return the sensor that the options describe, with only the channels that are left.

    ``--only-taxels``, ``--merge-polarities`` and the like select and merge channels. Returns None
    if the options give no positions, but at most a number of channels.
    """
    sensor = described_sensor(args)
    if sensor is None or not sensor.laid_out:
        return None
    return selected_layout(sensor, asked_selection(args))


def statistics_lines(statistics: Mapping[str, Any], binning: str | None) -> list[str]:
    """Return the figures of ``event_statistics`` as lines.

    ``binning`` says which events were left out when they were put into bins; None if none were.
    """
    events = statistics["events"]
    silence = statistics["silence"]
    # Facts.of leaves out the rows whose value is None.
    facts = Facts.of(
        {
            "labels": _labels_text(statistics["labels"]),
            "events": (
                f"{_mean_text(events['per_recording'])} per recording "
                f"({_range_text(events['per_recording'])}), "
                f"{percent(events['share_of_bins'], 2)} of bins"
            ),
            "binning": binning,
            "rate": _rate_text(statistics),
            "silent at start": _steps_text(silence["start_steps"]),
            "silent at end": _steps_text(silence["end_steps"]),
            "silent steps": (
                f"{percent(silence['share_of_steps'], 1)}, "
                f"{plural(silence['empty_recordings'], 'recording')} without any event"
            ),
            "polarity": _polarity_text(statistics["polarity"]),
            "busiest channels": _busiest_text(statistics["busiest_channels"]),
            "dead channels": _dead_text(statistics["dead_channels"]),
        }
    )
    # 17 columns hold the longest label, "busiest channels", and a blank.
    return [_size_line(statistics), *(f"{fact.label:<17} {fact.value}" for fact in facts.facts)]


def _size_line(statistics: Mapping[str, Any]) -> str:
    """Return how many recordings there are, of how many steps and channels."""
    steps = statistics["steps"]
    step_seconds = statistics["step_seconds"]
    duration = ""
    if step_seconds is not None:
        duration = f" of {step_seconds:g} s ({steps * step_seconds:g} s)"
    recordings = plural(statistics["recordings"], "recording")
    channels = plural(statistics["channels"], "channel")
    return f"{statistics['source']}: {recordings}, {plural(steps, 'step')}{duration}, {channels}"


def _mean_text(distribution: Mapping[str, float]) -> str:
    return f"{distribution['mean']:.1f}"


def _range_text(distribution: Mapping[str, float]) -> str:
    return f"{distribution['least']} to {distribution['most']}"


def _steps_text(distribution: Mapping[str, float]) -> str:
    return f"{_mean_text(distribution)} steps ({_range_text(distribution)})"


def _rate_text(statistics: Mapping[str, Any]) -> str | None:
    hz_per_channel = statistics["rate_hz_per_channel"]
    if hz_per_channel is None:
        return None
    hz = hz_per_channel * statistics["channels"]
    return f"{hz_per_channel:.3g} Hz per channel, {hz:.4g} Hz in all"


def _polarity_text(polarity: Mapping[str, float] | None) -> str | None:
    if polarity is None:
        return None
    return f"{percent(polarity['rising'], 1)} rising, {percent(polarity['falling'], 1)} falling"


def _busiest_text(channels: Sequence[Mapping[str, Any]]) -> str:
    if not channels:
        return "none"
    texts = []
    for row in channels:
        place = f" ({row['place']})" if row["place"] else ""
        texts.append(f"{row['channel']}{place} {row['events']}")
    return ", ".join(texts)


def _dead_text(channels: Sequence[int]) -> str:
    if not channels:
        return "none"
    shown = ", ".join(map(str, channels[:_MAX_DEAD_CHANNELS_SHOWN]))
    more = len(channels) - _MAX_DEAD_CHANNELS_SHOWN
    return f"{shown}, and {more} more" if more > 0 else shown


def _labels_text(labels: dict[int, int] | None) -> str:
    """Return how many recordings each class has; ``labels`` has the number by class."""
    if labels is None:
        return "none"
    classes = plural(len(labels), "class", "classes")
    smallest = min(labels.values())
    if smallest == max(labels.values()):
        return f"{classes}, {plural(smallest, 'recording')} each"
    counts = [f"{label}: {count}" for label, count in labels.items()]
    if len(counts) > _MAX_CLASSES_SHOWN:
        counts = [*counts[:_MAX_CLASSES_SHOWN], "..."]
    return f"{classes} ({', '.join(counts)})"


def _raster_lines(recordings: Recordings, number: int) -> list[str]:
    """Return a recording as text: a heading, and lines of characters between two bars."""
    label = ""
    if recordings.labels is not None:
        label = f", {recordings.called(recordings.labels[number])}"
    raster = [f"|{line}|" for line in text_raster(recordings.spikes[number])]
    return [f"recording {number}{label}:", *raster]


def _write_picture(args: argparse.Namespace, recordings: Recordings, number: int) -> list[str]:
    """Write the raster of ``-o``, if asked to; return the line that says so."""
    if args.output is None:
        return []
    title = f"{recordings.source}, recording {number}"
    picture = raster_svg(recordings.spikes[number], title, recordings.step_seconds)
    replace_file(args.output, picture, f"file {args.output.name!r}")
    return [f"wrote {args.output}"]


def _write_recordings(
    args: argparse.Namespace, recordings: Recordings, sensor: SensorLayout | None
) -> list[str]:
    """Write the recordings to ``--to``, if asked to.

    Returns a line for the file, and lines on what it does not hold: the other part of a divided
    archive, the names of classes, and what the options restore that these lines name.
    """
    if args.to is None:
        return []
    restoring_options = write_recordings(
        args.to, recordings, members=args.members, structured=args.structured, sensor=sensor
    ).options
    lines = [f"wrote {args.to}"]
    if args.part is None:
        # Without --part the last part was read, which is the test part if there are two.
        parts = recording_parts(args.file, test_share=args.split)
        if len(parts) > 1:
            lines.append(f"it holds the {parts[-1]} part alone: --part {parts[0]} gives the other")
    if recordings.class_names is not None and args.to.suffix not in _WITH_CLASS_NAMES:
        lines.append("names of classes are left out: only .npz and .pt files hold them")
    if restoring_options:
        options = " ".join(
            f"--{name.replace('_', '-')} {value!r}" for name, value in restoring_options.items()
        )
        lines.append(f"read it with {options}: the format does not say so")
    return lines


def _check_options(args: argparse.Namespace) -> None:
    """Refuse options that would change nothing."""
    check_encoder_options(args)
    to_suffix = None if args.to is None else args.to.suffix
    if args.output is not None and args.output.suffix != ".svg":
        raise InputError(
            f"-o {args.output.name!r}", "rasters are written as .svg", fix="End the name in .svg."
        )
    if args.recording is not None and args.json and args.output is None:
        raise InputError(
            "--recording", "no raster is shown or written", fix="Leave out --json, or add -o."
        )
    # A folder has no suffix. The default "npy" changes nothing elsewhere, so it is not refused.
    if args.members != "npy" and to_suffix not in ("", ".zip"):
        raise InputError(
            "--members", "no folder or .zip is written", fix="Add --to with a folder or .zip."
        )
    if args.structured and to_suffix not in (".npy", ".npz"):
        raise InputError(
            "--structured", "no .npy or .npz is written", fix="Add --to with such a file."
        )
