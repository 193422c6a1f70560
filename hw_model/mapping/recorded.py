"""What a program reads of a sensor that has more channels than the program has inputs."""

from dataclasses import asdict
from typing import Annotated, Any

from hw_model.errors import InputError
from hw_model.io.records import Checked, RecordReader, between

MOST_TAXELS = 32_768
"""Of a sensor: those of an event camera of 128 x 128 pixels and two polarities."""
Taxels = Annotated[int, between(1, MOST_TAXELS)]


class ChannelSelection(Checked):
    """Which channels of a sensor are read, and which of them become one channel.

    - ``only_taxels``: numbers of taxels from 1 on, such as ``13-24`` or ``1,5,9``; None: all
    - ``only_polarity``: 0 (rising) or 1 (falling); None: all
    - ``merge_polarities``: both polarities of a taxel become one channel
    - ``merge_channels``: so many channels of neighbouring taxels; None: each taxel by itself

    A merged channel is 1 in the steps in which any of its channels is.
    """

    only_taxels: str | None = None
    only_polarity: Annotated[int | None, between(0, 1)] = None
    merge_polarities: bool = False
    merge_channels: Annotated[int | None, between(1, MOST_TAXELS)] = None

    called = "selection"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.only_polarity is not None and self.merge_polarities:
            what = "with one polarity there is nothing to merge"
            fix = "Leave one of both out."
            raise InputError("only_polarity", what, fix=fix)

    @property
    def merges_polarities_at_most(self) -> bool:
        """Whether each taxel is read, and stays a channel of its own."""
        return self in (ChannelSelection(), ChannelSelection(merge_polarities=True))

    @property
    def options(self) -> str:
        """The options of the command line that ask for it."""
        words = []
        if self.only_taxels is not None:
            words.append(f"--only-taxels {self.only_taxels}")
        if self.only_polarity is not None:
            words.append(f"--only-polarity {self.only_polarity}")
        if self.merge_polarities:
            words.append("--merge-polarities")
        if self.merge_channels is not None:
            words.append(f"--merge-channels {self.merge_channels}")
        return " ".join(words)


class RecordedChannels(Checked):
    """A sensor of ``columns`` x ``rows`` taxels, with ``polarities`` each, and what is read of it."""

    columns: Taxels
    rows: Taxels
    polarities: Annotated[int, between(1, 2)]
    selection: ChannelSelection

    called = "recorded"

    @property
    def count(self) -> int:
        """Channels of the sensor."""
        return self.columns * self.rows * self.polarities

    def document(self) -> dict[str, Any]:
        """Return it as plain values, without those that were not asked for."""
        entries = asdict(self)
        # A polarity of 0 was asked for, so not everything that counts as false is left out.
        entries["selection"] = {
            name: value
            for name, value in entries["selection"].items()
            if not (value is None or value is False)
        }
        return entries


def recorded_of(where: str, document: object) -> RecordedChannels | None:
    """Return what plain values hold, which may be missing; ``InputError`` for anything else."""
    if document is None:
        return None
    return RecordReader(where, fix="Compile again.").record(RecordedChannels, document, "recorded")
