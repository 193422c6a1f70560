"""Which files ``--emit`` can write for chips with an arithmetic of their own, such as Xylo and SpiNNaker.

``--emit`` has many kinds of files; most show things that these chips do not have, such as cores of a mesh. Each family
has a table of the kinds that it can write, and refuses all others.
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
    """The kinds of ``--emit`` that a family can write, each with the function that writes its files for a build.

    ``lacking`` completes the error for every other kind: it names what those show and the family's chips do not have.
    """

    writers: Mapping[str, Callable[[BuildT, ShownRecording | None], Files]]
    lacking: str

    def check(self, chip: AnyChip, kinds: Sequence[str]) -> None:
        """Raise InputError for a kind that shows what the chip does not have."""
        for kind in kinds:
            if kind not in self.writers:
                what = f"it shows {self.lacking}, and {chip.name} has none of them"
                known = listed([f"--emit {name}" for name in self.writers], "or")
                raise InputError(f"--emit {kind}", what, fix=f"Use {known}.")

    def files(
        self, build: BuildT, chip: AnyChip, kinds: Sequence[str], shown: ShownRecording | None
    ) -> Files:
        """Return the files of the given kinds; ``shown`` is the recording that some kinds need."""
        self.check(chip, kinds)
        files: Files = {}
        for kind, write in self.writers.items():
            if kind in kinds:
                files |= write(build, shown)
        return files


def text_file(name: str, text: str) -> Files:
    """Return a text as a file. Characters that UTF-8 cannot hold are escaped; names of a network may contain such."""
    return {name: text.encode(errors="backslashreplace")}


def network_file(compiled: Compiled, shown: ShownRecording | None) -> Files:
    """Return ``network.txt``, the trained network as stable text. It needs no recording, unlike other writers."""
    return text_file("network.txt", network_text(compiled.network))


def recording_to_show(network: Network, shown: ShownRecording | None) -> AnyArray:
    """Return the recording to show, with the network's steps and channels; raise ``InputError`` if none is given."""
    if shown is None:
        raise InputError("emit", "it shows a recording, and none is given", fix="Give one.")
    batch_of_one = np.asarray(shown.spikes)[np.newaxis]
    recording: AnyArray = network.fit(batch_of_one, shown.title)[0]
    return recording
