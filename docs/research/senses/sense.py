"""How recordings of the four sets are read, and divided to choose and to report networks.

To choose, only the train part is used: it is divided into four folds, a network learns from three
of them and is measured on the fourth. Networks of large sets learn from a share of these
recordings, equally many of each class. To report, a network learns from the whole train part and is
measured on the test part.
"""

from pathlib import Path

import numpy as np

import locsnn_compile as lc
from hw_model.values import Frozen
from locsnn_compile.data.read import Division
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.sensor import SensorLayout, asked_layout
from locsnn_compile.training.window_choice import balanced_rows

FOLD_SHARE = 0.25
"""Share of the train part that a fold holds out."""


class Parts(Frozen):
    """Recordings to learn from, and recordings to measure on."""

    learned: Recordings
    measured: Recordings


class Sense(Frozen):
    """A set of recordings.

    - ``file``, ``layout``: below the folder of all sets; without a layout, the sensor is a ``grid``
    - ``step_seconds``: width of a bin, where the file does not say it
    - ``tie``: the class that is predicted if no output spikes, or None
    - ``test_share``: the share of every class that a round tests on, if no split is published
    - ``most_to_choose``: the largest number of recordings that a network learns from when networks
      are chosen, and ``most_to_measure`` the largest number that it is measured on
    """

    name: str
    file: str
    layout: str | None = None
    grid: str | None = None
    step_seconds: float | None = None
    tie: str | None = None
    test_share: float | None = None
    most_to_choose: int = 1_000
    most_to_measure: int = 500

    def sensor(self, data: Path) -> SensorLayout | None:
        """Return the layout of the sensor."""
        layout = None if self.layout is None else str(data / self.layout)
        return asked_layout(self.grid, polarities=None, channels=None, layout=layout)

    def sensor_options(self, data: Path) -> dict[str, object]:
        """Return the training options that describe the sensor."""
        if self.layout is None:
            return {"grid": self.grid}
        return {"layout": str(data / self.layout)}

    def to_report(self, data: Path, round_number: int) -> Parts:
        """Return the train and the test part; without published parts, those of a round from 1."""
        return Parts(
            self._read(data, "train", round_number), self._read(data, "test", round_number)
        )

    def to_choose(self, data: Path, round_number: int, fold: int) -> Parts:
        """Return what a network learns from and is measured on, to choose it.

        ``fold``: the fold of the train part that is held out, from 1.
        """
        train_part = self._read(data, "train", round_number)
        division = Division(FOLD_SHARE, fold)
        source = Path(train_part.source)
        learned = division.part(train_part, source, "train")
        held_out = division.part(train_part, source, "test")
        return Parts(
            balanced(learned, self.most_to_choose), balanced(held_out, self.most_to_measure)
        )

    def _read(self, data: Path, part: str, round_number: int) -> Recordings:
        division: dict[str, object] = {}
        if self.test_share is not None:
            division = {"test_share": self.test_share, "fold": round_number}
        return lc.read_recordings(
            data / self.file,
            split=part,
            sensor=self.sensor(data),
            step_seconds=self.step_seconds,
            **division,
        )


def balanced(recordings: Recordings, most: int) -> Recordings:
    """Return at most ``most`` recordings, drawn evenly from the classes."""
    labels = recordings.needed_labels("divide them by")
    return recordings.subset(np.asarray(balanced_rows(labels, most, seed=0)))
