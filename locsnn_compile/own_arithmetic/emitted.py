"""The kinds of ``--emit`` of families of chips with an arithmetic of their own, as Xylo and SpiNNaker.

A build of such a family writes its files itself, and only the kinds that show what its chips have.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Generic, TypeVar

import numpy as np

from hw_model.errors import InputError, listed
from hw_model.targets.families import AnyChip
from hw_model.values import AnyArray, Frozen
from locsnn_compile.compiled import Compiled
from locsnn_compile.emitters import Files, ShownRecording
from locsnn_compile.network.network import Network
from locsnn_compile.network.text import network_text

BuildT = TypeVar("BuildT", contravariant=True)


class EmittedKinds(Generic[BuildT], Frozen, eq=False):
    """By kind of ``--emit``, what writes its files for a build; every other kind is refused.

    ``lacking`` says what the other kinds show, and chips of the family do not have.
    """

    writers: Mapping[str, Callable[[BuildT, ShownRecording | None], Files]]
    lacking: str

    def check(self, chip: AnyChip, kinds: Sequence[str]) -> None:
        """Refuse kinds that show what the chip does not have."""
        for kind in kinds:
            if kind not in self.writers:
                what = f"it shows {self.lacking}, and {chip.name} has none of them"
                known = listed([f"--emit {name}" for name in self.writers], "or")
                raise InputError(f"--emit {kind}", what, fix=f"Use {known}.")

    def files(
        self, build: BuildT, chip: AnyChip, kinds: Sequence[str], shown: ShownRecording | None
    ) -> Files:
        """Return the files of some kinds; ``shown`` is the recording that some of them need."""
        self.check(chip, kinds)
        files: Files = {}
        for kind, write in self.writers.items():
            if kind in kinds:
                files |= write(build, shown)
        return files


def text_file(name: str, text: str) -> Files:
    """Return a file of text; characters that UTF-8 cannot hold, as names may have, are escaped."""
    return {name: text.encode(errors="backslashreplace")}


def network_file(compiled: Compiled, shown: ShownRecording | None) -> Files:
    """Return ``network.txt``, the trained network as stable text; a writer of it needs no recording."""
    return text_file("network.txt", network_text(compiled.network))


def recording_to_show(network: Network, shown: ShownRecording | None) -> AnyArray:
    """Return the shown recording, (steps, channels) of a network; ``InputError`` where none is given."""
    if shown is None:
        raise InputError("emit", "it shows a recording, and none is given", fix="Give one.")
    batch_of_one = np.asarray(shown.spikes)[np.newaxis]
    recording: AnyArray = network.fit(batch_of_one, shown.title)[0]
    return recording
