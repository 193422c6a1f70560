"""The batches of a training epoch: the order of recordings, and their augmentation.

Augmentation changes recordings at random, so that a network does not learn single recordings by heart. A taxel is one
touch-sensitive point of the sensor, with one or two polarities; a channel is one polarity of one taxel. For every
recording anew, these may happen, in this order: taxels are taken from another recording of the class; events are added;
events, channels and taxels are dropped; time is stretched; the end is cut; single taxels, and then the whole recording,
move in time. How often or how far is itself drawn for each recording, from 0 to the ``largest`` of the configuration.

All functions take and return spikes (batch, steps, channels), float32, 0 or 1. Every draw comes from a generator of
(seed, purpose, epoch), so an epoch needs no state except its number, and a run that is resumed draws the same. An
augmentation that is off draws nothing, so it does not affect the others.
"""

from collections.abc import Iterator

import numpy as np

from hw_model.values import BoolArray, ByteArray, Float32Array, IntArray
from locsnn_compile.data.sensor import POLARITIES
from locsnn_compile.training.config import TrainingConfig


def epoch_generator(seed: int, *purpose: int) -> np.random.Generator:
    """Return the generator for one purpose of a run, such as (phase, epoch).

    Equal numbers give equal draws on every machine. PCG64 is named because numpy may change its default generator.
    """
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed, *purpose])))


def batches(
    spikes: ByteArray,
    labels: IntArray,
    config: TrainingConfig,
    rng: np.random.Generator,
    polarities: int = POLARITIES,
) -> Iterator[tuple[Float32Array, IntArray]]:
    """Yield (spikes (batch, steps, channels), labels (batch,)) of one epoch, in which every recording occurs once."""
    order = rng.permutation(len(labels))
    for start in range(0, len(order), config.batch_size):
        rows = order[start : start + config.batch_size]
        batch = spikes[rows].astype(np.float32)
        if config.mixing:
            # For each recording any of its class; it may be itself, which then stays as it is.
            same_class = [np.flatnonzero(labels == label) for label in labels[rows]]
            partners = spikes[[rng.choice(candidates) for candidates in same_class]]
            batch = mix_taxels(batch, partners.astype(np.float32), config.mixing, rng, polarities)
        yield augmented(batch, config, rng, polarities), labels[rows]


Spikes = Float32Array
"""(batch, steps, channels) of 0 and 1."""


def augmented(
    spikes: Spikes, config: TrainingConfig, rng: np.random.Generator, polarities: int = POLARITIES
) -> Spikes:
    """Return spikes with all augmentations that the configuration asks for, except mixing.

    The order and the number of draws must not change: equal seeds would give other networks.
    """
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
    """Replace taxels, with all their polarities, by those of ``others``, (batch, steps, channels).

    The probability for a taxel is drawn for each recording, from 0 to ``largest``.
    """
    taxels = spikes.shape[2] // polarities
    return np.where(_draw_kept(spikes, largest, rng, taxels), spikes, others)


def add_events(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Add events in bins without one, each with a probability drawn for its recording, from 0 to ``largest``."""
    if largest == 0:
        return spikes
    # Where the draw says "lost", there is an event afterwards, whatever was there.
    return np.where(_draw_kept(spikes, largest, rng), spikes, np.float32(1))


def drop(
    spikes: Spikes, largest: float, rng: np.random.Generator, parts: int | None = None
) -> Spikes:
    """Drop events, each with a probability drawn for its recording, from 0 to ``largest``.

    With ``parts``, the channels are divided into so many equal groups of neighbours, and a group loses all its events
    together. A group is a channel if there are as many parts as channels, and a taxel with its polarities if there are
    as many as taxels.
    """
    if largest == 0:
        return spikes
    return spikes * _draw_kept(spikes, largest, rng, parts)


def _draw_kept(
    spikes: Spikes, largest: float, rng: np.random.Generator, parts: int | None = None
) -> BoolArray:
    """Draw a mask of what is kept: (batch, steps, channels), or with ``parts`` (batch, 1, channels).

    The probability of being lost is drawn for each recording, from 0 to ``largest``.
    """
    batch, _, channels = spikes.shape
    # float32 halves the time and the memory of the draws.
    probability = rng.random((batch, 1, 1), dtype=np.float32) * np.float32(largest)
    if parts is None:
        return rng.random(spikes.shape, dtype=np.float32) >= probability
    parts_kept = rng.random((batch, 1, parts), dtype=np.float32) >= probability
    return parts_kept.repeat(channels // parts, axis=2)


def cut_end(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Silence the end of each recording: a share of its steps, drawn from 0 to ``largest``."""
    if largest == 0:
        return spikes
    share_left = 1.0 - rng.random((len(spikes), 1, 1), dtype=np.float32) * np.float32(largest)
    steps = spikes.shape[1]
    step = np.arange(steps)[np.newaxis, :, np.newaxis]
    return np.where(step < np.ceil(share_left * steps), spikes, np.float32(0))


def stretch_time(spikes: Spikes, largest: float, rng: np.random.Generator) -> Spikes:
    """Slow each recording down or speed it up: multiply its times by a factor from 1 - ``largest`` to 1 + ``largest``.

    Events that leave the recording are lost, and events that fall into the same step become one.
    """
    if largest == 0:
        return spikes
    rate = 1.0 + largest * rng.uniform(-1.0, 1.0, len(spikes))
    sample, step, channel = np.nonzero(spikes)
    # The middle of a step is moved, so that a rate near 1 changes as few steps downwards as upwards.
    new_step = np.floor((step + 0.5) * rate[sample]).astype(np.int64)
    stays = new_step < spikes.shape[1]
    stretched = np.zeros_like(spikes)
    stretched[sample[stays], new_step[stays], channel[stays]] = 1
    return stretched


def shift_in_time(spikes: Spikes, largest: int, rng: np.random.Generator, parts: int = 1) -> Spikes:
    """Move each of ``parts`` equal groups of channels of each recording by up to ``largest`` steps to either side.

    With 1 part, the whole recording moves; with as many as taxels, each taxel moves by itself. Events that leave the
    recording are lost, and silence fills the gap.
    """
    if largest == 0:
        return spikes
    batch, steps, channels = spikes.shape
    shift_of_part = rng.integers(-largest, largest, size=(batch, parts), endpoint=True)
    # The place of an event in the flat array of all recordings, steps and channels. Moving only the
    # events is faster than moving arrays, because most bins are 0.
    place = np.flatnonzero(spikes != 0)
    recording = place // (steps * channels)
    channel = place % channels
    part = channel * parts // channels
    shift = shift_of_part[recording, part]
    new_step = place // channels % steps + shift
    stays = (new_step >= 0) & (new_step < steps)
    new_place = place + shift * channels
    shifted = np.zeros_like(spikes)
    shifted.reshape(-1)[new_place[stays]] = 1
    return shifted
