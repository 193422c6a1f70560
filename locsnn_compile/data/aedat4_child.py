"""Read an AEDAT4 file on behalf of another process, which survives when the library panics on a damaged file.

Run as a script with the path of the file and the number of events at which to stop. It writes the width and height of
the stream of events that comes first in the file, how many events other streams have, and its events as a ``.npy``
array. It imports nothing of this project, so that it starts at once.
"""

import contextlib
import sys

import aedat
import numpy as np

if __name__ == "__main__":
    with contextlib.suppress(ImportError):  # Windows has no limits of this kind
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30))
        resource.setrlimit(resource.RLIMIT_CPU, (10, 10))
    decoder, most = aedat.Decoder(sys.argv[1]), int(sys.argv[2])
    # The library lists the streams in another order each time.
    cameras = {n: s for n, s in sorted(decoder.id_to_stream().items()) if s["type"] == "events"}
    number, stream = next(iter(cameras.items()))
    packets, count, elsewhere = [], 0, 0
    for packet in decoder:
        if packet["stream_id"] == number and count <= most:
            packets.append(packet["events"])
            count += len(packets[-1])
        elif packet["stream_id"] != number and packet["stream_id"] in cameras:
            elsewhere += len(packet["events"])
    found = np.concatenate(packets)
    events = np.empty(count, dtype=[(name, "<i8") for name in "txyp"])
    for name, theirs in zip("txyp", ("t", "x", "y", "on"), strict=True):
        events[name] = found[theirs]
    sys.stdout.buffer.write(f"{stream['width']} {stream['height']} {elsewhere}\n".encode())
    np.save(sys.stdout.buffer, events, allow_pickle=False)
