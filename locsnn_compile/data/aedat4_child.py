"""Read an AEDAT4 file on behalf of another process, which survives when the library panics on a damaged file.

Run as a script with the path of the file and the number of events at which to stop. It writes the width and height of
the stream of events that comes first in the file, how many events other streams have, and its events as a ``.npy``
array. It imports nothing of this project, so that it starts at once.
"""

import sys

MOST_ADDRESSES, CPU_SECONDS = 2 << 30, 10
OUT_OF_MEMORY = 3
"""The exit code where an inherited limit leaves too little memory: that is no fault of the file."""

try:
    import aedat
    import numpy as np
except (ImportError, MemoryError, OSError):
    if __name__ != "__main__":
        raise
    sys.exit(OUT_OF_MEMORY)  # the parent could import both


def lower(kind: int, limit: int) -> bool:
    """Lower a limit of this process; tell whether it is the one asked for: an inherited lower one stays."""
    inherited = resource.getrlimit(kind)
    most = min([limit, *(bound for bound in inherited if bound != resource.RLIM_INFINITY)])
    resource.setrlimit(kind, (most, most))
    return most == limit


def read(path: str, most: int) -> None:
    """Write what the file holds to standard output, with ``most`` events and those of their packet at most."""
    decoder = aedat.Decoder(path)
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


if __name__ == "__main__":
    is_our_limit = True
    if sys.platform != "win32":
        import resource

        is_our_limit = lower(resource.RLIMIT_AS, MOST_ADDRESSES)
        lower(resource.RLIMIT_CPU, CPU_SECONDS)
    try:
        read(sys.argv[1], int(sys.argv[2]))
    except MemoryError:
        sys.exit(1 if is_our_limit else OUT_OF_MEMORY)
