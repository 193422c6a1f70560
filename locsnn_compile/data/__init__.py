"""Touch recordings: their type, their files, the sensor's layout and synthetic ones."""

from locsnn_compile.data.event_formats import from_tonic
from locsnn_compile.data.read import read_recordings, recording_parts
from locsnn_compile.data.recordings import Recordings
from locsnn_compile.data.synthetic import synthetic_touches
from locsnn_compile.data.write import write_recordings

__all__ = [
    "Recordings",
    "from_tonic",
    "read_recordings",
    "recording_parts",
    "synthetic_touches",
    "write_recordings",
]
