"""``locsnn events``: show what recordings contain, or write them in another format.

Show what recordings contain: rates, silence, polarity, busy and dead channels, and a raster of one. --to writes them in
the format that the name ends in.

example:
  locsnn events examples/recordings/touches.npz --to touches.zip --members bs1

A folder or .zip gets a file for each recording, of the kind of --members: npy, events (arrays with the fields t, x, p,
as in Tonic), bs1, bs2 or tact. If a format cannot hold something, the options that restore it on reading are printed.
No option restores the names of classes: a line says that they are left out.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from hw_model.io.files import replace_file
from locsnn_compile.cli.options import recording_of
from locsnn_compile.cli.places import check_places
from locsnn_compile.cli.shell import say
from locsnn_compile.cli.step_options import asked_reading, asked_sensor, assumption_lines
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import SensorLayout
from locsnn_compile.data.statistics import event_statistics
from locsnn_compile.data.write import write_recordings
from locsnn_compile.errors import InputError
from locsnn_compile.report.format import known, plural
from locsnn_compile.report.pictures.recording import raster_svg, text_raster
from locsnn_compile.report.words import facts, sentence

_SHOWN_LABELS, _SHOWN_DEAD = 12, 24


def run(args: argparse.Namespace) -> int:
    """Print the figures, and write the files asked for."""
    _check_options(args)
    given = (("-o", args.output), ("--to", args.to))
    writes = [(f"{option} {str(path)!r}", path) for option, path in given if path is not None]
    # A folder is written only if it is new or empty.
    check_places({"FILE": args.file}, [place for place in writes if place[1].suffix])
    recordings = read_recordings(args.file, split=args.part, **asked_reading(args))
    number = recording_of(args.recording, recordings)
    sensor = _laid_out(args)
    found = event_statistics(recordings, sensor)
    written = _write(args, recordings, number, sensor)
    said = statistics_lines(found, recordings.binned.words if recordings.binned else None)
    said += assumption_lines(recordings)
    found = {**found, "assumptions": list(recordings.assumed)}
    say(args, found, [*said, *_raster(recordings, number), *written])
    return 0


def _laid_out(args: argparse.Namespace) -> SensorLayout | None:
    """Return the sensor that the options describe, as it is after merging; None for a mere number of channels."""
    sensor = asked_sensor(args)
    if sensor is None or not sensor.laid_out:
        return None
    return replace(sensor, polarities=1) if args.merge_polarities else sensor


def statistics_lines(found: Mapping[str, Any], binning: str | None) -> list[str]:
    """Return the figures as lines; ``binning`` says what was left out on reading."""
    width, steps, polarity, rate = (
        found[key] for key in ("step_seconds", "steps", "polarity", "rate_hz_per_channel")
    )
    seconds = "" if width is None else f" of {width:g} s ({steps * width:g} s)"
    rows = [(one["channel"], one["place"], one["events"]) for one in found["busiest_channels"]]
    busiest = [f"{channel}{place and f' ({place})'} {count}" for channel, place, count in rows]
    dead = [*map(str, found["dead_channels"][:_SHOWN_DEAD])] or ["none"]
    more = len(found["dead_channels"]) - _SHOWN_DEAD
    given = {
        "labels": _labels(found["labels"]),
        "binning": binning,
        "rate": known(
            rate, lambda hz: f"{hz:.3g} Hz per channel, {hz * found['channels']:.4g} Hz in all", ""
        ),
        "polarity": polarity and sentence("polarity", **polarity),
        "busiest": ", ".join(busiest) or "none",
        "dead": ", ".join(dead) + (f", and {more} more" if more > 0 else ""),
    }
    lines = (
        f"{fact.label:<17} {fact.value}" for fact in facts("events", **{**found, **given}).facts
    )
    return [sentence("recordings", of_seconds=seconds, **found), *lines]


def _labels(labels: dict[int, int] | None) -> str:
    if labels is None:
        return "none"
    least, most = min(labels.values()), max(labels.values())
    if least == most:
        return f"{plural(len(labels), 'class', 'classes')}, {plural(least, 'recording')} each"
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
