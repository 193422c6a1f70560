"""Files of event cameras: those that libraries wrote, and files made here, bit by bit, from the published layouts.

Formats are Prophesee's EVT2, EVT3 and DAT, and AEDAT 2 and 3. An event has a time in microseconds, x, y and a polarity.
"""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from locsnn_compile.cli.main import main
from locsnn_compile.data import camera_words, prophesee_evt3, read_recordings
from locsnn_compile.data.aedat import parse_aedat
from locsnn_compile.data.event_stream import EventStream
from locsnn_compile.data.prophesee import parse_dat, parse_raw
from locsnn_compile.errors import InputError
from tests.support.raw_cameras import EVENTS, FILES, SIZE

HERE = Path(__file__).parent


def rows_of(stream: EventStream) -> list[tuple[int, ...]]:
    """Return the events as rows of microseconds, x, y and polarity."""
    assert stream.y is not None
    assert stream.polarity is not None
    columns = (stream.times, stream.x, stream.y, stream.polarity)
    return [tuple(map(int, event)) for event in zip(*columns, strict=True)]


def parse(name: str) -> EventStream:
    """Return the events of a file of this folder."""
    data = (HERE / name).read_bytes()
    return parse_dat(data, name) if name.endswith(".dat") else parse_raw(data, name)


@pytest.mark.parametrize("name", FILES)
def test_files_of_a_library_have_the_events_that_it_wrote(name: str) -> None:
    stream = parse(name)
    assert rows_of(stream) == list(EVENTS)
    assert stream.columns == SIZE[0]
    assert stream.channels == 2 * SIZE[0] * SIZE[1]
    assert stream.start is None
    assert stream.elsewhere == 0


@pytest.mark.parametrize("words", [1, 2, 3, 7])
def test_evt3_is_the_same_in_chunks_of_any_size(
    words: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prophesee_evt3, "EVT3_CHUNK_WORDS", words)
    assert rows_of(parse("camera-evt3.raw")) == list(EVENTS)


@pytest.mark.parametrize("name", FILES)
def test_camera_files_become_bins_of_the_whole_sensor(name: str) -> None:
    recordings = read_recordings(HERE / name, step_seconds=0.001, steps=3)
    assert recordings.spikes.shape == (1, 3, 2 * 34 * 20)
    # The first event is at x 33, y 19 with polarity 0.
    channel = 2 * (34 * 19 + 33)
    assert recordings.spikes[0, 0, channel] == 1
    assert recordings.spikes[0, 1].nonzero()[0].tolist() == [1, 3]


def evt2(*words: int, header: bytes = b"% evt 2.0\n% end\n") -> bytes:
    """Return a file of EVT2: a header, and words of 32 bits, the low byte first."""
    return header + np.array(words, dtype="<u4").tobytes()


def test_events_before_the_first_time_are_counted_as_dropped(tmp_path: Path) -> None:
    event = 0x1000_0000
    time_high = 0x8000_0002
    (tmp_path / "a.raw").write_bytes(evt2(event, time_high, event))
    binned = read_recordings(tmp_path / "a.raw").binned
    assert binned is not None
    assert binned.words == (
        "1 of 2 events dropped: 0 outside the steps, 0 in bins of at most 0, "
        "1 in further streams or before the first time"
    )


def evt3(*words: int, header: bytes = b"% evt 3.0\n% end\n") -> bytes:
    """Return a file of EVT3: a header, and words of 16 bits, the low byte first."""
    return header + np.array(words, dtype="<u2").tobytes()


def test_evt2_words_follow_the_published_layout() -> None:
    # The kind of a word is in its highest four bits. A time_high gives the upper bits of the times that follow, in units
    # of 64 microseconds; an event the lower six bits, then x and y.
    time_high = 0x8000_0002
    brighter = 0x1FC0_2805
    trigger = 0xA000_0000
    stream = parse_raw(evt2(brighter, time_high, trigger, brighter), "a.raw")
    assert rows_of(stream) == [(2 * 64 + 63, 5, 5, 1)]
    assert stream.elsewhere == 1
    assert stream.columns is None


def test_evt3_words_follow_the_published_layout() -> None:
    words = (
        0x2800,  # an event before any time and row is left out
        *(0x8001, 0x6FFF, 0x0003),  # time 4096 + 4095, row 3
        *(0x2805, 0x2006),  # x 5 brighter, x 6 darker
        *(0x3000 | 0x800 | 10, 0x4801, 0x5081),  # vector at 10: bits 0, 11, then 22 and 29
        *(0x8001, 0x2007),  # the same high part again changes no time
        *(0x8002, 0x2008),  # another high part begins at low 0
    )
    stream = parse_raw(evt3(*words), "a.raw")
    assert rows_of(stream) == [
        *((8191, 5, 3, 1), (8191, 6, 3, 0)),
        *((8191, x, 3, 1) for x in (10, 21, 22, 29)),
        *((8191, 7, 3, 0), (8192, 8, 3, 0)),
    ]
    assert stream.elsewhere == 1


def test_vectors_of_eight_pixels_ignore_the_bits_above() -> None:
    stream = parse_raw(evt3(0x8000, 0x6001, 0x0000, 0x3000, 0x5F00 | 1, 0x4001), "a.raw")
    assert rows_of(stream) == [(1, 0, 0, 0), (1, 8, 0, 0)]


def aedat2(addresses: Sequence[int], times: Sequence[int], chip: str) -> bytes:
    """Return a file of AEDAT 2: addresses and times of 32 bits, the high byte first, of a camera's chip."""
    pairs = b"".join(struct.pack(">II", *pair) for pair in zip(addresses, times, strict=True))
    return f"#!AER-DAT2.0\r\n# AEChip: {chip}\r\n".encode() + pairs


def packet(
    events: Sequence[tuple[int, ...]], kind: int = 1, source: int = 1, wraps: int = 0
) -> bytes:
    """Return a packet of AEDAT 3.1 with valid events (microseconds, x, y, polarity)."""
    count = len(events)
    head = struct.pack("<HHIIIIII", kind, source, 8, 4, wraps, count, count, count)
    pairs = (struct.pack("<II", x << 17 | y << 2 | p << 1 | 1, t) for t, x, y, p in events)
    return head + b"".join(pairs)


AEDAT3 = b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DVS128\r\n#!END-HEADER\r\n"
PIXELS = [(10, 5, 7, 1), (20, 127, 0, 0), (30, 0, 127, 1)]


def test_aedat_2_of_a_dvs128_follows_the_published_layout() -> None:
    addresses = [y << 8 | x << 1 | p for _, x, y, p in PIXELS] + [1 << 15]
    stream = parse_aedat(aedat2(addresses, [10, 20, 30, 40], "ch.unizh.ini.DVS128"), "a.aedat")
    assert rows_of(stream) == PIXELS
    assert stream.columns == 128
    assert stream.channels == 2 * 128 * 128


def test_aedat_2_of_a_davis_leaves_out_images_and_inputs() -> None:
    events = [(10, 345, 259, 1), (20, 0, 0, 0)]
    addresses = [y << 22 | x << 12 | p << 11 for _, x, y, p in events]
    data = aedat2([*addresses, 1 << 31, 1 << 10], [10, 20, 30, 40], "chips.davis.DAVIS346B")
    stream = parse_aedat(data, "a.aedat")
    assert rows_of(stream) == events
    assert stream.columns == 346
    assert stream.channels == 2 * 346 * 260


def test_aedat_3_joins_packets_of_the_first_camera() -> None:
    other = packet([(5, 1, 1, 1)], source=2)
    late = packet([(5, 1, 2, 0)], wraps=1)
    stream = parse_aedat(AEDAT3 + packet(PIXELS) + packet([], kind=0) + other + late, "a.aedat")
    assert rows_of(stream) == [*PIXELS, (5 + (1 << 31), 1, 2, 0)]
    assert stream.elsewhere == 1
    assert stream.columns == 128


def test_aedat_3_leaves_out_events_that_are_not_valid() -> None:
    data = bytearray(AEDAT3 + packet(PIXELS))
    data[len(AEDAT3) + 28] &= 0xFE
    assert rows_of(parse_aedat(bytes(data), "a.aedat")) == PIXELS[1:]


@pytest.mark.parametrize("version", ["2.0", "3.1"])
def test_tonic_s_reader_of_aedat_gives_the_same_numbers(version: str, tmp_path: Path) -> None:
    io = pytest.importorskip("tonic.io")
    addresses = [y << 8 | x << 1 | p for _, x, y, p in PIXELS]
    data = aedat2(addresses, [10, 20, 30], "DVS128")
    if version == "3.1":
        data = AEDAT3 + packet(PIXELS)
    path = tmp_path / "a.aedat"
    path.write_bytes(data)
    begin = data.index(b"DVS128\r\n") + 8
    if version == "3.1":
        begin = len(AEDAT3)
    theirs = io.get_aer_events_from_file(str(path), float(version), begin)
    ours = rows_of(parse_aedat(data, "a.aedat"))
    assert theirs["timeStamp"].tolist() == [time for time, *_ in ours]
    if version == "2.0":
        expected = addresses
    else:
        expected = [x << 17 | y << 2 | p << 1 | 1 for _, x, y, p in ours]
    assert theirs["address"].tolist() == expected


DAT = b"% Version 2\n% Width 4\n% Height 4\n"
REFUSED = [
    pytest.param(
        "a.raw",
        b"hello",
        "it is not a recording in EVT2 or EVT3 (no line '% evt'). "
        "Convert it to EVT3, .dat or HDF5 with Prophesee's tools.",
        id="raw without a format",
    ),
    pytest.param(
        "a.raw",
        evt2(header=b"% evt 2.1\n% end\n"),
        "it is not a recording in EVT2 or EVT3 ('2.1'). "
        "Convert it to EVT3, .dat or HDF5 with Prophesee's tools.",
        id="raw in EVT2.1",
    ),
    pytest.param(
        "a.raw",
        evt2(0x8000_0000)[:-1],
        "it ends within a record (3 bytes behind its header, 4 per record). Give a whole file.",
        id="truncated EVT2",
    ),
    pytest.param(
        "a.raw",
        evt3(0x8000)[:-1],
        "it ends within a record (1 byte behind its header, 2 per record). Give a whole file.",
        id="truncated EVT3",
    ),
    pytest.param(
        "a.raw",
        evt3(0x8000),
        "it has no events. Give a recording with events.",
        id="EVT3 without events",
    ),
    pytest.param(
        "a.raw",
        evt3(),
        "it has no events. Give a recording with events.",
        id="an empty EVT3",
    ),
    pytest.param(
        "a.raw",
        evt2(0x8000_0000, 0x0000_2000, header=b"% evt 2.0\n% geometry 4x4\n% end\n"),
        "an event is outside of its sensor (x 4 of event 0 against 0..3). "
        "Correct the size in its header.",
        id="an event off the sensor",
    ),
    pytest.param(
        "a.raw",
        evt2(0x8000_0000, 0, header=b"% evt 2.0\n% geometry 4x999999999\n% end\n"),
        "its sensor is too large (999999999 pixels against 32768). Correct the size in its header.",
        id="an absurd sensor",
    ),
    pytest.param(
        "a.dat",
        b"% Version 1\n",
        "it is not a DAT file of version 2 (version '1'). Convert it with Prophesee's tools.",
        id="DAT of another version",
    ),
    pytest.param(
        "a.dat",
        DAT + bytes((14, 8)),
        "its events are not those of pixels (kind 14 of 8 bytes). "
        "Give a file of CD events, kind 12 of 8 bytes.",
        id="DAT of triggers",
    ),
    pytest.param(
        "a.dat",
        DAT + bytes((12, 8, 0)),
        "it ends within a record (1 byte behind its header, 8 per record). Give a whole file.",
        id="truncated DAT",
    ),
    pytest.param(
        "a.aedat",
        b"hello",
        "it is not an AEDAT file (its first line is 'hello'). "
        "Give AEDAT 2.0 or 3.1, or AEDAT4 with the ending .aedat4.",
        id="no AEDAT",
    ),
    pytest.param(
        "a.aedat",
        b"#!AER-DAT2.0\r\n" + bytes(8),
        "its header does not name a camera that is known (no line '# AEChip'). "
        "Add '# AEChip: DVS128', or the name of a DAVIS.",
        id="AEDAT 2 without its camera",
    ),
    pytest.param(
        "a.aedat",
        b"#!AER-DAT2.0\r\n# AEChip: DVS128\r\n" + b"# gain 1\r\n" * 110_000 + bytes(8),
        "its header is too long (more than 1048576 bytes). Shorten it.",
        id="AEDAT 2 with a long header, the end of which is not an event",
    ),
    pytest.param(
        "a.aedat",
        AEDAT3.replace(b"RAW", b"Serial-TS"),
        "its events are compressed (format 'Serial-TS'). Record in the format RAW.",
        id="compressed AEDAT 3",
    ),
    pytest.param(
        "a.aedat",
        AEDAT3 + packet(PIXELS)[:-1],
        "it is damaged or truncated (a packet of 3 events of 8 bytes). Give a whole file.",
        id="AEDAT 3 that ends in a packet",
    ),
    pytest.param(
        "a.aedat",
        AEDAT3 + packet([])[:-1],
        "it is damaged or truncated (byte 0 behind its header begins a packet). Give a whole file.",
        id="AEDAT 3 that ends in a head",
    ),
    pytest.param(
        "a.aedat",
        AEDAT3 + struct.pack("<HHIIIIII", 1, 1, 0xFFFF_FFFF, 4, 0, 9, 0xFFFF_FFFF, 9),
        "it is damaged or truncated (a packet of 4294967295 events of 4294967295 bytes). "
        "Give a whole file.",
        id="AEDAT 3 of endless events",
    ),
]


@pytest.mark.parametrize(("name", "data", "message"), REFUSED)
def test_damaged_files_of_cameras_are_refused_in_one_line(
    name: str, data: bytes, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    assert main(["events", str(path)]) == 2
    assert capsys.readouterr() == ("", f"file {str(path)!r}: {message}\n")


def test_vectors_of_too_many_events_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(camera_words, "MAX_EVENTS", 20)
    monkeypatch.setattr(prophesee_evt3, "EVT3_CHUNK_WORDS", 5)
    with pytest.raises(InputError) as caught:
        parse_raw(evt3(0x8000, 0x6000, 0x0000, 0x3000, *[0x4FFF] * 100), "a.raw")
    assert str(caught.value) == "a.raw: it has too many events (72 against 20). Give a part of it."


@pytest.mark.parametrize("name", FILES)
@pytest.mark.parametrize("seed", range(5))
def test_damaged_files_give_events_or_an_error_in_one_line(name: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    data = bytearray((HERE / name).read_bytes())
    for position in rng.integers(0, len(data), 20):
        data[position] = rng.integers(0, 256)
    data = data[: rng.integers(0, len(data))]
    read = parse_dat if name.endswith(".dat") else parse_raw
    message = ""
    try:
        events = read(bytes(data), name).times
    except InputError as error:
        message = str(error)
    else:
        assert len(events) > 0
    assert "\n" not in message
