"""Arrays of numbers as recordings for ``locsnn events --encode``, and what the spikes lose of the numbers."""

import argparse

from hw_model.values import Frozen
from locsnn_compile.cli.options import given
from locsnn_compile.cli.step_options import FILE_OPTIONS
from locsnn_compile.data.encoders import Encoded, latency_spikes, level_spikes, rate_spikes
from locsnn_compile.data.real_values import RealValues, read_real_values
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError

RATE = "rate"
LATENCY = "latency"
LEVELS = "levels"
ENCODERS = (RATE, LATENCY, LEVELS)
OF_ENCODERS = ("--seed", "--level")
_DESCRIBES_EVENTS = (*FILE_OPTIONS, "--threshold", "--part", "--split", "--fold")
_TAKES = {RATE: ("--steps", "--seed"), LATENCY: ("--steps",), LEVELS: ("--level",)}
"""The options of each encoder; all but the seed are needed."""


class EncodedValues(Frozen, eq=False):
    """Recordings of encoded numbers; ``encoder`` is its name, and the errors are in the unit of the numbers."""

    recordings: Recordings
    encoder: str
    rms_error: float
    largest_error: float

    @property
    def line(self) -> str:
        """What the spikes lose of the numbers, as a line."""
        return (
            f"encoded by {self.encoder}: decoded numbers are off by {self.rms_error:.3g} (root mean "
            f"square) and {self.largest_error:.3g} at most"
        )

    @property
    def document(self) -> dict[str, str | float]:
        """The same for JSON."""
        errors = {"rms_error": self.rms_error, "largest_error": self.largest_error}
        return {"encoder": self.encoder, **errors}


def check_encoder_options(args: argparse.Namespace) -> None:
    """Refuse options that the encoder does not take, those of events, and the lack of one that it needs."""
    if args.encode is None:
        for option in given(args, OF_ENCODERS):
            raise InputError(
                option, "no numbers are encoded", fix="Add --encode with a FILE of numbers."
            )
        return
    for option in given(args, _DESCRIBES_EVENTS):
        what = "it describes recordings of events, and --encode takes arrays of numbers"
        raise InputError(option, what, fix="Leave it out.")
    takes = _TAKES[args.encode]
    typed = given(args, ("--steps", *OF_ENCODERS))
    for option in typed:
        if option not in takes:
            raise InputError(option, f"the encoder {args.encode} has none", fix="Leave it out.")
    for option in takes:
        if option != "--seed" and option not in typed:
            raise InputError(f"--encode {args.encode}", f"it needs {option}", fix=f"Add {option}.")


def encoded_values(args: argparse.Namespace) -> EncodedValues:
    """Return the numbers of a file as spikes, as the options ask."""
    numbers = read_real_values(args.file)
    encoded = _encoded(numbers, args)
    step_seconds = numbers.step_seconds if args.step_seconds is None else args.step_seconds
    recordings = encoded.recordings(
        labels=numbers.labels, step_seconds=step_seconds, source=numbers.source
    )
    return EncodedValues(recordings, args.encode, encoded.rms_error, encoded.largest_error)


def _encoded(numbers: RealValues, args: argparse.Namespace) -> Encoded:
    """Return numbers (samples, ...) by rate or latency, and signals (samples, steps, ...) by levels."""
    values = numbers.values
    if args.encode == LEVELS:
        if values.ndim < 3:
            measured = f"shape {values.shape}"
            fix = "Give (samples, steps, signals)."
            raise InputError(
                numbers.where, "they have no axis of steps", measured=measured, fix=fix
            )
        return level_spikes(values.reshape(*values.shape[:2], -1), args.level)
    flat = values.reshape(len(values), -1)
    if args.encode == LATENCY:
        return latency_spikes(flat, args.steps)
    return rate_spikes(flat, args.steps, seed=args.seed or 0)
