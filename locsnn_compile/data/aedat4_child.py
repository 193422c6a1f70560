"""Read an AEDAT4 file for another process, which may outlive this one: the library panics on some damage.

Run as a script with the path of the file and the number of events after which it stops; writes the width and the height
of the first stream that has events, and these as a ``.npy`` array. Imports nothing of this project, so that it starts
at once.
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
    number, stream = next((n, s) for n, s in decoder.id_to_stream().items() if s["type"] == "events")
    packets, count = [], 0
    for packet in decoder:
        if packet["stream_id"] == number and count <= most:
            packets.append(packet["events"])
            count += len(packets[-1])
    found = np.concatenate(packets)
    events = np.empty(count, dtype=[(name, "<i8") for name in "txyp"])
    for name, theirs in zip("txyp", ("t", "x", "y", "on"), strict=True):
        events[name] = found[theirs]
    sys.stdout.buffer.write(f"{stream['width']} {stream['height']}\n".encode())
    np.save(sys.stdout.buffer, events, allow_pickle=False)
