"""Read an AEDAT4 file on behalf of another process, which lives on when the library panics.

The library ``aedat`` aborts its process on some damaged files. Run as a script with the path of the
file and the number of events at which to stop reading. It writes to standard output:

1. a line ``width height elsewhere``: the size in pixels of the first stream of events, and how many
   events the other streams of events have;
2. the events of the first stream as a ``.npy`` array with the fields t (microseconds), x, y and p.

It imports nothing of this project, so that it starts at once. It ends with code 1 for a file that
it cannot read, as any script does after an exception.
"""

import sys

MAX_ADDRESS_BYTES = 2 << 30
"""Limit on the address space of this process, 2 GiB."""
CPU_SECONDS = 10
"""Limit on the processor time of this process."""
DAMAGED_FILE = 1
"""The exit code for a file that cannot be read, the same as after an uncaught exception."""
OUT_OF_MEMORY = 3
"""The exit code where an inherited limit leaves too little memory: that is no fault of the file."""
LIBRARY_FIELDS = {"t": "t", "x": "x", "y": "y", "p": "on"}
"""Field that is written -> what the library calls it."""

try:
    if sys.platform != "win32":
        import resource

    import aedat
    import numpy as np
except (ImportError, MemoryError, OSError):
    if __name__ != "__main__":
        raise
    # The parent could import them, so it is too little memory that keeps them from loading here.
    sys.exit(OUT_OF_MEMORY)


def lower(kind: int, limit: int) -> bool:
    """Lower a limit of this process, and return whether it is now ``limit``.

    If the process inherited a lower one, that stays, because a limit cannot be raised.
    """
    inherited = [bound for bound in resource.getrlimit(kind) if bound != resource.RLIM_INFINITY]
    lowest = min([limit, *inherited])
    resource.setrlimit(kind, (lowest, lowest))
    return lowest == limit


def read(path: str, most: int) -> None:
    """Write what the file holds to standard output.

    Events are kept until they are more than ``most``: the parent process then sees that the file has
    too many, and refuses it.
    """
    decoder = aedat.Decoder(path)
    # Sorted, because the library lists the streams in another order each time.
    streams = sorted(decoder.id_to_stream().items())
    event_streams = {number: stream for number, stream in streams if stream["type"] == "events"}
    first_number, first_stream = next(iter(event_streams.items()))
    packets = []
    events_read = 0
    events_elsewhere = 0
    for packet in decoder:
        number = packet["stream_id"]
        if number == first_number:
            if events_read <= most:
                packets.append(packet["events"])
                events_read += len(packet["events"])
        elif number in event_streams:
            events_elsewhere += len(packet["events"])
    library_events = np.concatenate(packets)
    events = np.empty(events_read, dtype=[(name, "<i8") for name in LIBRARY_FIELDS])
    for name, library_name in LIBRARY_FIELDS.items():
        events[name] = library_events[library_name]
    head = f"{first_stream['width']} {first_stream['height']} {events_elsewhere}\n"
    sys.stdout.buffer.write(head.encode())
    np.save(sys.stdout.buffer, events, allow_pickle=False)


if __name__ == "__main__":
    is_our_limit = True
    if sys.platform != "win32":
        is_our_limit = lower(resource.RLIMIT_AS, MAX_ADDRESS_BYTES)
        lower(resource.RLIMIT_CPU, CPU_SECONDS)
    try:
        read(sys.argv[1], int(sys.argv[2]))
    except MemoryError:
        # A file that needs more than our own limit counts as damaged.
        sys.exit(DAMAGED_FILE if is_our_limit else OUT_OF_MEMORY)
