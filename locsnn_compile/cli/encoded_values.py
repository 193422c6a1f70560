"""``locsnn events --encode``: arrays of numbers as recordings, and what the spikes lose of the numbers.

An encoder turns numbers into spikes: by *rate* (a number from 0 to 1 is the chance of a spike in
each step), by *latency* (the larger the number, the earlier its one spike), or by *levels* (a signal
spikes whenever it has moved by a given amount).
"""

import argparse

from hw_model.values import Frozen
from locsnn_compile.cli.options import given_options
from locsnn_compile.cli.step_options import FILE_OPTIONS
from locsnn_compile.data.encoders import Encoded, latency_spikes, level_spikes, rate_spikes
from locsnn_compile.data.real_values import RealValues, read_real_values
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.errors import InputError

RATE = "rate"
LATENCY = "latency"
LEVELS = "levels"
_ENCODER_OPTIONS = ("--seed", "--level")
"""Options that only encoders take; ``--steps`` also has a meaning for recordings of events."""
_EVENT_OPTIONS = (*FILE_OPTIONS, "--threshold", "--part", "--split", "--fold")
"""Options that describe events, of which a file of numbers has none."""
_OPTIONS_OF_ENCODER = {
    RATE: ("--steps", "--seed"),
    LATENCY: ("--steps",),
    LEVELS: ("--level",),
}
"""All but the seed, which has a default, are required."""


class EncodedValues(Frozen, eq=False):
    """Recordings that encode numbers, and how well the numbers can be decoded from them.

    ``encoder`` is the name of the encoder. The errors, of decoded numbers against the original ones,
    are in the unit of the numbers.
    """

    recordings: Recordings
    encoder: str
    rms_error: float
    largest_error: float

    @property
    def line(self) -> str:
        """What the spikes lose of the numbers, as a line of text."""
        return (
            f"encoded by {self.encoder}: decoded numbers are off by {self.rms_error:.3g} (root mean "
            f"square) and {self.largest_error:.3g} at most"
        )

    @property
    def document(self) -> dict[str, str | float]:
        """What the spikes lose of the numbers, as values for JSON."""
        return {
            "encoder": self.encoder,
            "rms_error": self.rms_error,
            "largest_error": self.largest_error,
        }


def check_encoder_options(args: argparse.Namespace) -> None:
    """Refuse options that the encoder has no use for, and an encoder without an option it requires."""
    if args.encode is None:
        for option in given_options(args, _ENCODER_OPTIONS):
            raise InputError(
                option, "no numbers are encoded", fix="Add --encode with a FILE of numbers."
            )
        return
    for option in given_options(args, _EVENT_OPTIONS):
        what = "it describes recordings of events, and --encode takes arrays of numbers"
        raise InputError(option, what, fix="Leave it out.")
    encoder_options = _OPTIONS_OF_ENCODER[args.encode]
    options = given_options(args, ("--steps", *_ENCODER_OPTIONS))
    for option in options:
        if option not in encoder_options:
            raise InputError(option, f"the encoder {args.encode} has none", fix="Leave it out.")
    for option in encoder_options:
        if option != "--seed" and option not in options:
            raise InputError(f"--encode {args.encode}", f"it needs {option}", fix=f"Add {option}.")


def encoded_values(args: argparse.Namespace) -> EncodedValues:
    """Read the numbers of ``FILE`` and encode them as the options ask."""
    numbers = read_real_values(args.file)
    encoded = _encode(numbers, args)
    step_seconds = numbers.step_seconds if args.step_seconds is None else args.step_seconds
    recordings = encoded.recordings(
        labels=numbers.labels, step_seconds=step_seconds, source=numbers.source
    )
    return EncodedValues(recordings, args.encode, encoded.rms_error, encoded.largest_error)


def _encode(numbers: RealValues, args: argparse.Namespace) -> Encoded:
    """Encode numbers (samples, ...) by rate or latency, or signals (samples, steps, ...) by levels.

    Every number of a sample becomes a channel; for levels, every signal does.
    """
    values = numbers.values
    if args.encode == LEVELS:
        if values.ndim < 3:
            measured = f"shape {values.shape}"
            fix = "Give (samples, steps, signals)."
            raise InputError(
                numbers.where, "they have no axis of steps", measured=measured, fix=fix
            )
        samples, steps = values.shape[:2]
        return level_spikes(values.reshape(samples, steps, -1), args.level)
    by_sample = values.reshape(len(values), -1)
    if args.encode == LATENCY:
        return latency_spikes(by_sample, args.steps)
    seed = 0 if args.seed is None else args.seed
    return rate_spikes(by_sample, args.steps, seed=seed)
