"""Which channels of a sensor a program reads, if the sensor has more channels than the program has inputs.

Training may use some taxels of a sensor only, or merge channels. The program remembers this, so that recordings of the
whole sensor are reduced the same way before they are played.
"""

from dataclasses import asdict
from typing import Annotated, Any

from hw_model.errors import InputError
from hw_model.io.records import Checked, RecordReader, between

MOST_TAXELS = 32_768
"""The most taxels of a sensor along a side, or to merge: the channels of an event camera of 128 x 128 pixels with two
polarities."""
Taxels = Annotated[int, between(1, MOST_TAXELS)]


class ChannelSelection(Checked):
    """Which channels of a sensor are read, and which of them are merged into one channel.

    - ``only_taxels``: numbers of taxels from 1 on, such as ``13-24`` or ``1,5,9``; None: all
    - ``only_polarity``: 0 (rising) or 1 (falling); None: all
    - ``merge_polarities``: both polarities of a taxel become one channel
    - ``merge_channels``: how many neighbouring taxels become one channel; None: each taxel stays by itself

    A merged channel is 1 in the steps in which any of its channels is 1.
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
        """Whether every taxel is read and stays a channel of its own, with its polarities merged or not."""
        return self in (ChannelSelection(), ChannelSelection(merge_polarities=True))

    @property
    def options(self) -> str:
        """The options of the command line that make this selection."""
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
    """A sensor of ``columns`` x ``rows`` taxels with ``polarities`` channels each, and the selection that is read."""

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
        """Return plain values for ``program.yaml``, without the settings of the selection that are off."""
        entries = asdict(self)
        # Polarity 0 is a setting, so the test is for None and False, not for all that counts as false.
        entries["selection"] = {
            name: value
            for name, value in entries["selection"].items()
            if not (value is None or value is False)
        }
        return entries


def recorded_of(where: str, document: object) -> RecordedChannels | None:
    """Return the record that :meth:`RecordedChannels.document` wrote, or None if the entry is missing.

    Raises ``InputError`` for anything else.
    """
    if document is None:
        return None
    return RecordReader(where, fix="Compile again.").record(RecordedChannels, document, "recorded")
