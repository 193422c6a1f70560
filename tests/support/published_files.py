"""Write folders as the VT_SNN data set is published, with made-up events.

VT_SNN has raw recordings of slips (text files of events with their times), and preprocessed recordings in ``tact.pt``
with five rounds of cross-validation. Two fingertips of 39 taxels with two polarities each make 156 channels.
"""

from pathlib import Path

import numpy as np
import torch

from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.tact import SLIP_CLASSES, tact_text

START = 1_584_000_000
"""Seconds of a clock when the robot began to move."""
REACHING = START + 2.25
"""When it reached out: the part of a raw recording that is used begins here and lasts 0.15 s."""


def slip_spikes(each: int) -> dict[str, np.ndarray]:
    """Return the bins (150, 156) of ``each`` slips of each of the two classes, by their names."""
    touches = synthetic_touches(
        2 * each, steps=150, fingertips=2, classes=2, seed=5, step_seconds=0.001
    )
    return {
        f"{SLIP_CLASSES[i % 2]}_{1 + i // 2:02}": spikes for i, spikes in enumerate(touches.spikes)
    }


def write_slip(folder: Path, each: int = 4, *, nanoseconds: bool = True) -> dict[str, np.ndarray]:
    """Write the raw slips into ``aces_recordings`` and their times into ``traj_start_ends``; return their bins.

    Every file also has an event before and one after the 0.15 s that are used. Times are written as the published files
    have them: with ``nanoseconds`` as two integers, seconds and nanoseconds, else as seconds with a fraction.
    """
    bins = slip_spikes(each)
    for part in ("aces_recordings", "traj_start_ends"):
        (folder / part).mkdir(parents=True)
    for name, spikes in bins.items():
        events = [("1", "1", REACHING - 1), ("0", "2", REACHING + 0.1505)]
        for line in tact_text(spikes, 0.001).decode().splitlines():
            polarity, cell, seconds = line.split()
            # The text has the start of a bin; the middle of the bin stays in it whatever the clock rounds.
            bin_number = int(1000 * float(seconds) + 0.25)
            events.append((polarity, cell, REACHING + (bin_number + 0.5) / 1000))
        lines = [f"{polarity} {cell} {seconds:.9f}" for polarity, cell, seconds in events]
        if nanoseconds:
            lines = [line.replace(".", " ") for line in lines]
        (folder / "aces_recordings" / f"{name}.tact").write_text("\n".join(lines) + "\n")
        times = f"{START} {REACHING} {REACHING + 0.2} {REACHING + 0.4}"
        (folder / "traj_start_ends" / f"{name}.startend").write_text(times)
    return bins


def write_preprocessed(
    folder: Path, samples: int = 20, classes: int = 2, rounds: int = 5
) -> np.ndarray:
    """Write ``tact.pt`` (samples, 78, 2, 150) and the rows of its rounds; return its bins (samples, 150, 156)."""
    folder.mkdir(parents=True, exist_ok=True)
    touches = synthetic_touches(
        samples, steps=150, fingertips=2, classes=classes, seed=6, step_seconds=0.001
    )
    assert touches.labels is not None
    # Class by class, as published.
    spikes = touches.spikes[np.argsort(touches.labels, kind="stable")]
    tensor = torch.tensor(spikes).permute(0, 2, 1).reshape(samples, 78, 2, 150).float()
    torch.save(tensor, folder / "tact.pt")
    rows = np.stack([np.arange(samples), np.sort(np.arange(samples) % classes)], axis=1)
    for k in range(1, rounds + 1):
        is_test = np.arange(samples) % rounds == k - 1
        for part, chosen in (("train", ~is_test), ("test", is_test)):
            np.savetxt(folder / f"{part}_80_20_{k}.txt", rows[chosen], fmt="%d", delimiter="\t")
    return spikes
