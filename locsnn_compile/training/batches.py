"""The batches of a training epoch: the order of recordings, and their augmentation.

Every draw comes from a generator of (seed, purpose, epoch), so an epoch needs no state except its number. Augmentations
take and return spikes (batch, steps, channels), float32, 0 or 1, and draw anew for every recording: taxels come from
another recording of the class, events are added, events, channels and taxels are dropped, time is stretched, ends are
cut, taxels and recordings move in time. An augmentation that is off draws nothing, so it does not affect the others.
"""

from collections.abc import Iterator

import numpy as np

from hw_model.values import BoolArray, ByteArray, Float32Array, IntArray
from locsnn_compile.data.sensor import POLARITIES
from locsnn_compile.training.config import TrainingConfig


def epoch_generator(seed: int, *purpose: int) -> np.random.Generator:
    """Return the generator for one purpose of a run: equal numbers give equal draws on every machine."""
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *purpose])))


def batches(
    spikes: ByteArray,
    labels: IntArray,
    config: TrainingConfig,
    rng: np.random.Generator,
    polarities: int = POLARITIES,
) -> Iterator[tuple[Float32Array, IntArray]]:
    """Yield (spikes (batch, steps, channels), labels (batch,)) of one epoch, every recording once."""
    order = rng.permutation(len(labels))
    for start in range(0, len(order), config.batch_size):
        rows = order[start : start + config.batch_size]
        batch = spikes[rows].astype(np.float32)
        if config.mixing:
            same_class = [np.flatnonzero(labels == label) for label in labels[rows]]
            partners = spikes[[rng.choice(candidates) for candidates in same_class]]
            batch = mix_taxels(batch, partners.astype(np.float32), config.mixing, rng, polarities)
        yield augmented(batch, config, rng, polarities), labels[rows]


Spikes = Float32Array


def augmented(
    spikes: Spikes, config: TrainingConfig, rng: np.random.Generator, polarities: int = POLARITIES
) -> Spikes:
    """Return spikes with all augmentations that the configuration asks for."""
    channels = spikes.shape[2]
    taxels = channels // polarities
    spikes = add_events(spikes, config.event_noise, rng)
    spikes = drop(spikes, config.event_dropout, rng)
    spikes = drop(spikes, config.channel_dropout, rng, channels)
    spikes = drop(spikes, config.taxel_dropout, rng, taxels)
    spikes = stretch_time(spikes, config.time_stretch, rng)
    spikes = cut_end(spikes, config.cut_end, rng)
    spikes = shift_in_time(spikes, config.taxel_shift, rng, taxels)
    return shift_in_time(spikes, config.time_shift, rng)


def mix_taxels(
    spikes: Spikes,
    others: Spikes,
    largest: float,
    rng: np.random.Generator,
    polarities: int = POLARITIES,
) -> Spikes:
    """Take taxels with all polarities from ``others``, with a probability of 0..``largest`` for each recording."""
    return np.where(_kept(spikes, largest, rng, spikes.shape[2] // polarities), spikes, others)


def add_events(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Add events where there are none, with a probability of 0..``largest`` for each recording."""
    return spikes if largest == 0 else np.where(_kept(spikes, largest, rng), spikes, np.float32(1))


def drop(
    spikes: Spikes, largest: float, rng: np.random.Generator, parts: int | None = None
) -> Spikes:
    """Drop events, with a probability of 0..``largest`` for each recording.

    With ``parts``, equal parts of the channels lose all their events, such as a channel, or the polarities of a taxel.
    """
    return spikes if largest == 0 else spikes * _kept(spikes, largest, rng, parts)


def _kept(
    spikes: Spikes, largest: float, rng: np.random.Generator, parts: int | None = None
) -> BoolArray:
    """Draw what is kept, event by event or part by part; each recording loses with a probability of 0..``largest``."""
    batch, _, channels = spikes.shape
    probability = rng.random((batch, 1, 1), dtype=np.float32) * np.float32(largest)
    if parts is None:
        return rng.random(spikes.shape, dtype=np.float32) >= probability
    parts_kept = rng.random((batch, 1, parts), dtype=np.float32) >= probability
    return parts_kept.repeat(channels // parts, axis=2)


def cut_end(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Silence the end of each recording, a share of 0..``largest`` of its steps."""
    if largest == 0:
        return spikes
    share_left = 1.0 - rng.random((len(spikes), 1, 1), dtype=np.float32) * np.float32(largest)
    steps = spikes.shape[1]
    step = np.arange(steps)[np.newaxis, :, np.newaxis]
    return np.where(step < np.ceil(share_left * steps), spikes, np.float32(0))


def stretch_time(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Play each recording slower or faster: its times are multiplied by 1 - ``largest`` to 1 + ``largest``.

    Events that leave the recording are lost, and events that meet become one, as with an inaccurate clock.
    """
    if largest == 0:
        return spikes
    rate = 1.0 + largest * rng.uniform(-1.0, 1.0, len(spikes))
    sample, step, channel = np.nonzero(spikes)
    new_step = np.floor((step + 0.5) * rate[sample]).astype(np.int64)
    stays = new_step < spikes.shape[1]
    stretched = np.zeros_like(spikes)
    stretched[sample[stays], new_step[stays], channel[stays]] = 1
    return stretched


def shift_in_time(spikes: Spikes, largest: int, rng: np.random.Generator, parts: int = 1) -> Spikes:
    """Move each of ``parts`` equal parts of the channels of each recording by up to ``largest`` steps to either side.

    Events that leave the recording are lost, and silence fills the gap.
    """
    if largest == 0:
        return spikes
    batch, steps, channels = spikes.shape
    shift_of_part = rng.integers(-largest, largest, size=(batch, parts), endpoint=True)
    # Events are told by their place in the flat array of all recordings, steps and channels.
    place = np.flatnonzero(spikes != 0)
    recording = place // (steps * channels)
    part = place % channels * parts // channels
    shift = shift_of_part[recording, part]
    new_step = place // channels % steps + shift
    stays = (new_step >= 0) & (new_step < steps)
    new_place = place + shift * channels
    shifted = np.zeros_like(spikes)
    shifted.reshape(-1)[new_place[stays]] = 1
    return shifted
