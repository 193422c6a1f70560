from .event_formats import from_tonic as from_tonic
from .read import read_recordings as read_recordings
from .read import recording_parts as recording_parts
from .recordings import Recordings as Recordings
from .synthetic import synthetic_touches as synthetic_touches
from .write import write_recordings as write_recordings
