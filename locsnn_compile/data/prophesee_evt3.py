"""Words of EVT3, in which Prophesee's cameras write ``.raw`` files.

Layout: Prophesee's page on "EVT 3.0" (docs.prophesee.ai). Words have 16 bits, the kind in 15..12 and a
payload below:

- 0 sets the row: y in bits 10..0
- 2 is an event: x in 10..0, polarity in 11
- 3 begins a vector: the x of its first pixel in 10..0, the polarity of all its events in 11
- 4 and 5 are the next 12 or 8 pixels of the vector, the first in bit 0; a set bit is an event
- 6 and 8 set the low and the high 12 bits of the time, in microseconds, which wraps after 16.8 s

Words of all other kinds, such as trigger signals, are skipped. What a word sets holds for the words
behind it, until another word sets it again. Long files are decoded chunk by chunk, each as whole
arrays, and :class:`_Evt3State` is what one chunk leaves set for the next.
"""

from collections.abc import Iterator

import numpy as np

from hw_model.values import Frozen, IntArray
from locsnn_compile.data.camera_words import (
    CameraEvents,
    check_event_count,
    latest_set,
    records,
    unwrapped,
)

EVT3_CHUNK_WORDS = 1 << 18
"""Words per chunk, which bounds the memory that decoding takes. Chosen by hand."""

_SETS_Y = 0
_EVENT = 2
_BEGINS_VECTOR = 3
_NEXT_12_PIXELS = 4
_NEXT_8_PIXELS = 5
_SETS_TIME_LOW = 6
_SETS_TIME_HIGH = 8
_PAYLOAD_BITS = 12
_TIME_PART_BITS = _PAYLOAD_BITS
"""Bits of the low part of the time, and of the high part: a word holds one of them."""
_TIME_PART_MASK = (1 << _TIME_PART_BITS) - 1
_PAYLOAD_MASK = (1 << _PAYLOAD_BITS) - 1
_COORDINATE_MASK = (1 << 11) - 1
_POLARITY_BIT = 11
_UNSET = -(1 << 40)
"""Stands for a column, row or time before any word has set it: stays below 0 whatever is added to it."""


class _Evt3Words(Frozen, eq=False):
    """Words taken apart, each array (words,)."""

    kind: IntArray
    payload: IntArray

    @property
    def coordinate(self) -> IntArray:
        """The x or y of words that have one."""
        return self.payload & _COORDINATE_MASK

    @property
    def polarity(self) -> IntArray:
        """The polarity of words that have one."""
        return self.payload >> _POLARITY_BIT


class _Evt3State(Frozen):
    """What the words of earlier chunks have set.

    ``time_high`` is in units of 4096 microseconds, without its wraps. ``vector_x`` is the column of
    the next pixel of the vector.
    """

    time_high: int = _UNSET
    time_low: int = 0
    y: int = _UNSET
    vector_x: int = _UNSET
    vector_polarity: int = 0


class _Vectors(Frozen, eq=False):
    """The vector that is in force at each word of a chunk, each array (words,).

    A vector is a row of neighbouring pixels: it begins with a word of kind 3, and words of kinds 4 and 5
    continue it.

    - ``pixels``: the number of pixels in the word itself; 0 for words that hold no pixels of a vector
    - ``x``: the column of the word's first pixel
    - ``polarity``: the polarity of all events of the vector
    """

    pixels: IntArray
    x: IntArray
    polarity: IntArray


class _PixelEvents(Frozen, eq=False):
    """Events before they get time and row, each array (events,).

    ``word`` is the index in the chunk of the word that the event is in.
    """

    word: IntArray
    x: IntArray
    polarity: IntArray


def evt3_events(body: bytes, where: str) -> CameraEvents:
    """Return the events in the words of a file; ``InputError`` if they are too many, or cut."""
    words = records(body, "<u2", where)
    chunks: list[CameraEvents] = []
    events = 0
    for chunk in _decoded_chunks(words):
        chunks.append(chunk)
        events += len(chunk.times)
        check_event_count(events, where)
    return CameraEvents(
        times=_joined([chunk.times for chunk in chunks]),
        x=_joined([chunk.x for chunk in chunks]),
        y=_joined([chunk.y for chunk in chunks]),
        polarity=_joined([chunk.polarity for chunk in chunks]),
        unplaced=sum(chunk.unplaced for chunk in chunks),
    )


def _joined(parts: list[IntArray]) -> IntArray:
    """Return the parts one after the other; an empty array if there are none."""
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def _decoded_chunks(words: IntArray) -> Iterator[CameraEvents]:
    """Yield the events of each chunk in turn."""
    state = _Evt3State()
    for begin in range(0, len(words), EVT3_CHUNK_WORDS):
        chunk = words[begin : begin + EVT3_CHUNK_WORDS].astype(np.int64)
        events, state = _decoded_chunk(chunk, state)
        yield events


def _decoded_chunk(chunk: IntArray, state: _Evt3State) -> tuple[CameraEvents, _Evt3State]:
    """Return the events of a chunk (words,), and what it leaves set for the next."""
    words = _Evt3Words(kind=chunk >> _PAYLOAD_BITS, payload=chunk & _PAYLOAD_MASK)
    time_high = _time_high(words, state)
    time_low = _time_low(words, time_high, state)
    y = latest_set(words.coordinate, words.kind == _SETS_Y, state.y)
    vectors = _vectors(words, state)
    pixels = _in_order(_single_events(words), _vector_events(words, vectors))
    events = _placed(
        CameraEvents(
            times=(time_high << _TIME_PART_BITS | time_low)[pixels.word],
            x=pixels.x,
            y=y[pixels.word],
            polarity=pixels.polarity,
        )
    )
    left_set = _Evt3State(
        time_high=int(time_high[-1]),
        time_low=int(time_low[-1]),
        y=int(y[-1]),
        vector_x=int(vectors.x[-1] + vectors.pixels[-1]),
        vector_polarity=int(vectors.polarity[-1]),
    )
    return events, left_set


def _time_high(words: _Evt3Words, state: _Evt3State) -> IntArray:
    """Return the high part of the time at each word, continued beyond the wraps of its 12 bits, (words,)."""
    sets_high = words.kind == _SETS_TIME_HIGH
    counter = words.payload[sets_high]
    if state.time_high >= 0:
        # The last counter of the previous chunk goes in front, so that a wrap between both is seen.
        last_counter = state.time_high & _TIME_PART_MASK
        earlier_wraps = state.time_high - last_counter
        with_last = np.append(last_counter, counter)
        unwrapped_counter = unwrapped(with_last, _TIME_PART_BITS)[1:] + earlier_wraps
    else:
        unwrapped_counter = unwrapped(counter, _TIME_PART_BITS)
    time_high = np.zeros(len(words.kind), dtype=np.int64)
    time_high[sets_high] = unwrapped_counter
    return latest_set(time_high, sets_high, state.time_high)


def _time_low(words: _Evt3Words, time_high: IntArray, state: _Evt3State) -> IntArray:
    """Return the low part of the time at each word, (words,).

    From a new high part on, the low part is 0 until a word sets it. The format does not say so, but
    Prophesee's own decoder (OpenEB) does it: an old low part would put events up to 4 ms too late.
    Cameras repeat a high part that has not changed, which leaves the low part as it is.
    """
    sets_low = words.kind == _SETS_TIME_LOW
    is_new_high = np.diff(time_high, prepend=state.time_high) != 0
    low = np.where(sets_low, words.payload, 0)
    return latest_set(low, sets_low | is_new_high, state.time_low)


def _vectors(words: _Evt3Words, state: _Evt3State) -> _Vectors:
    """Return the vector in force at each word; every word of a vector moves its x on by the pixels of the word."""
    pixels = np.zeros(len(words.kind), dtype=np.int64)
    pixels[words.kind == _NEXT_12_PIXELS] = 12
    pixels[words.kind == _NEXT_8_PIXELS] = 8
    pixels_before = np.cumsum(pixels) - pixels
    begins = words.kind == _BEGINS_VECTOR
    # x of a word = x where its vector began + pixels between that beginning and the word
    #             = (x where it began - pixels of the chunk before the beginning) + pixels before the word.
    # The term in brackets, the origin, is the same for all words of a vector, so no loop is needed.
    origin = latest_set(words.coordinate - pixels_before, begins, state.vector_x)
    polarity = latest_set(words.polarity, begins, state.vector_polarity)
    return _Vectors(pixels, origin + pixels_before, polarity)


def _single_events(words: _Evt3Words) -> _PixelEvents:
    """Return the events that have a word of their own."""
    word = np.flatnonzero(words.kind == _EVENT)
    return _PixelEvents(word, words.coordinate[word], words.polarity[word])


def _vector_events(words: _Evt3Words, vectors: _Vectors) -> _PixelEvents:
    """Return the events of vectors: one for each set bit of a word that is a pixel of it."""
    vector_word = np.flatnonzero(vectors.pixels)
    bits = np.arange(_PAYLOAD_BITS)
    is_set = words.payload[vector_word, None] >> bits & 1 != 0
    # Words of 8 pixels may have other bits above them.
    is_pixel = bits < vectors.pixels[vector_word, None]
    nth_vector_word, bit = np.nonzero(is_set & is_pixel)
    word = vector_word[nth_vector_word]
    return _PixelEvents(word, vectors.x[word] + bit, vectors.polarity[word])


def _in_order(single: _PixelEvents, vector: _PixelEvents) -> _PixelEvents:
    """Return events of both kinds in the order of their words, events of one word from left to right."""
    word = np.concatenate((single.word, vector.word))
    x = np.concatenate((single.x, vector.x))
    polarity = np.concatenate((single.polarity, vector.polarity))
    # Stable, because the events of one word are in order already.
    order = np.argsort(word, kind="stable")
    return _PixelEvents(word[order], x[order], polarity[order])


def _placed(events: CameraEvents) -> CameraEvents:
    """Return the events whose time, column and row are all set, and count the rest."""
    is_placed = (events.times >= 0) & (events.x >= 0) & (events.y >= 0)
    return CameraEvents(
        times=events.times[is_placed],
        x=events.x[is_placed],
        y=events.y[is_placed],
        polarity=events.polarity[is_placed],
        unplaced=int((~is_placed).sum()),
    )
