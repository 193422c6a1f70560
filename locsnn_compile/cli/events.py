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

import argparse
from collections.abc import Mapping, Sequence
from typing import Any

from hw_model.io.files import replace_file
from locsnn_compile.cli.encoded_values import check_encoder_options, encoded_values
from locsnn_compile.cli.options import recording_of
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import say
from locsnn_compile.cli.step_options import asked_reading, asked_sensor, assumption_lines
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

_SHOWN_LABELS, _SHOWN_DEAD = 12, 24


def run(args: argparse.Namespace) -> int:
    """Print the figures, and write the files asked for."""
    _check_options(args)
    outputs = (("-o", args.output), ("--to", args.to))
    writes = [(f"{option} {str(path)!r}", path) for option, path in outputs if path is not None]
    # A folder is written only if it is new or empty.
    check_places({"FILE": args.file}, [place for place in writes if place[1].suffix])
    encoded = None if args.encode is None else encoded_values(args)
    if encoded is not None:
        recordings = encoded.recordings
    else:
        recordings = read_recordings(args.file, split=args.part, **asked_reading(args))
    number = recording_of(args.recording, recordings)
    sensor = _laid_out(args)
    statistics = event_statistics(recordings, sensor)
    written = _write(args, recordings, number, sensor)
    binning = recordings.binned.words if recordings.binned else None
    report_lines = statistics_lines(statistics, binning)
    report_lines += assumption_lines(recordings)
    statistics = {**statistics, "assumptions": list(recordings.assumed)}
    if encoded is not None:
        report_lines.append(encoded.line)
        statistics["encoding"] = encoded.document
    say(args, statistics, [*report_lines, *_raster(recordings, number), *written])
    return 0


def _laid_out(args: argparse.Namespace) -> SensorLayout | None:
    """Return the sensor that the options describe, as it is after merging; None for a mere number of channels."""
    sensor = asked_sensor(args)
    if sensor is None or not sensor.laid_out:
        return None
    return selected_layout(sensor, asked_selection(args))


def statistics_lines(statistics: Mapping[str, Any], binning: str | None) -> list[str]:
    """Return the figures as lines; ``binning`` says what was left out on reading."""
    events, silence = statistics["events"], statistics["silence"]
    facts = {
        "labels": _labels(statistics["labels"]),
        "events": f"{events['per_recording']['mean']:.1f} per recording "
        f"({_ends(events['per_recording'])}), {percent(events['share_of_bins'], 2)} of bins",
        "binning": binning,
        "rate": _rate(statistics),
        "silent at start": f"{silence['start_steps']['mean']:.1f} steps "
        f"({_ends(silence['start_steps'])})",
        "silent at end": f"{silence['end_steps']['mean']:.1f} steps "
        f"({_ends(silence['end_steps'])})",
        "silent steps": f"{percent(silence['share_of_steps'], 1)}, "
        f"{plural(silence['empty_recordings'], 'recording')} without any event",
        "polarity": _polarity(statistics["polarity"]),
        "busiest channels": _busiest(statistics["busiest_channels"]),
        "dead channels": _dead(statistics["dead_channels"]),
    }
    lines = (f"{fact.label:<17} {fact.value}" for fact in Facts.of(facts).facts)
    return [_size(statistics), *lines]


def _size(statistics: Mapping[str, Any]) -> str:
    """Return how many recordings there are, of how many steps and channels."""
    width, steps = statistics["step_seconds"], statistics["steps"]
    seconds = "" if width is None else f" of {width:g} s ({steps * width:g} s)"
    recordings = plural(statistics["recordings"], "recording")
    of_steps = f"{plural(steps, 'step')}{seconds}"
    return f"{statistics['source']}: {recordings}, {of_steps}, {plural(statistics['channels'], 'channel')}"


def _ends(spread: Mapping[str, float]) -> str:
    return f"{spread['least']} to {spread['most']}"


def _rate(statistics: Mapping[str, Any]) -> str | None:
    hz = statistics["rate_hz_per_channel"]
    if hz is None:
        return None
    return f"{hz:.3g} Hz per channel, {hz * statistics['channels']:.4g} Hz in all"


def _polarity(polarity: Mapping[str, float] | None) -> str | None:
    if polarity is None:
        return None
    return f"{percent(polarity['rising'], 1)} rising, {percent(polarity['falling'], 1)} falling"


def _busiest(channels: Sequence[Mapping[str, Any]]) -> str:
    busiest = []
    for row in channels:
        place = f" ({row['place']})" if row["place"] else ""
        busiest.append(f"{row['channel']}{place} {row['events']}")
    return ", ".join(busiest) or "none"


def _dead(channels: Sequence[int]) -> str:
    shown = ", ".join(map(str, channels[:_SHOWN_DEAD])) or "none"
    more = len(channels) - _SHOWN_DEAD
    return f"{shown}, and {more} more" if more > 0 else shown


def _labels(labels: dict[int, int] | None) -> str:
    if labels is None:
        return "none"
    smallest, largest = min(labels.values()), max(labels.values())
    if smallest == largest:
        return f"{plural(len(labels), 'class', 'classes')}, {plural(smallest, 'recording')} each"
    shown = ", ".join(f"{label}: {count}" for label, count in list(labels.items())[:_SHOWN_LABELS])
    return f"{plural(len(labels), 'class', 'classes')} ({shown}{', ...' if len(labels) > _SHOWN_LABELS else ''})"


def _raster(recordings: Recordings, index: int) -> Sequence[str]:
    label = "" if recordings.labels is None else f", {recordings.called(recordings.labels[index])}"
    return [
        f"recording {index}{label}:",
        *(f"|{line}|" for line in text_raster(recordings.spikes[index])),
    ]


def _write(args: argparse.Namespace, recordings: Recordings, number: int, sensor: Any) -> list[str]:
    """Write the files asked for; return a line for each, and the options that restore what a format cannot hold."""
    lines = []
    if args.output is not None:
        title = f"{recordings.source}, recording {number}"
        picture = raster_svg(recordings.spikes[number], title, recordings.step_seconds)
        replace_file(args.output, picture, f"file {args.output.name!r}")
        lines.append(f"wrote {args.output}")
    if args.to is not None:
        how = {"members": args.members, "structured": args.structured, "sensor": sensor}
        left = write_recordings(args.to, recordings, **how).options
        lines.append(f"wrote {args.to}")
        if (
            args.part is None
            and len(parts := recording_parts(args.file, test_share=args.split)) > 1
        ):
            lines.append(f"it holds the {parts[-1]} part alone: --part {parts[0]} gives the other")
        if recordings.class_names is not None and args.to.suffix not in (".npz", ".pt"):
            lines.append("names of classes are left out: only .npz and .pt files hold them")
        if left:
            options = " ".join(
                f"--{name.replace('_', '-')} {value!r}" for name, value in left.items()
            )
            lines.append(f"read it with {options}: the format does not say so")
    return lines


def _check_options(args: argparse.Namespace) -> None:
    """Refuse options that would change nothing."""
    check_encoder_options(args)
    if args.output is not None and args.output.suffix != ".svg":
        raise InputError(
            f"-o {args.output.name!r}", "rasters are written as .svg", fix="End the name in .svg."
        )
    if args.recording is not None and args.json and args.output is None:
        raise InputError(
            "--recording", "no raster is shown or written", fix="Leave out --json, or add -o."
        )
    if args.members != "npy" and (args.to is None or args.to.suffix not in ("", ".zip")):
        raise InputError(
            "--members", "no folder or .zip is written", fix="Add --to with a folder or .zip."
        )
    if args.structured and (args.to is None or args.to.suffix not in (".npy", ".npz")):
        raise InputError(
            "--structured", "no .npy or .npz is written", fix="Add --to with such a file."
        )
