"""What compiles the loops of the fast engine in processes of their own; it needs nothing that takes long to import."""

from hw_model.engine.ahead import compile_ahead, start_ahead_where_nothing_is_compiled

AHEAD_OF_TILES = (
    "hw_model.engine.ahead_of_tiles",
    ("hw_model.engine.tiles", "hw_model.engine.fast"),
)
AHEAD_OF_SESSIONS = (
    "hw_model.streaming.ahead",
    ("hw_model.streaming.time_phase", "hw_model.streaming.location_phase"),
)
"""Modules that compile loops in a process of their own, and the modules of these loops. Nothing here imports them."""


def compile_loops_ahead(*, sessions: bool) -> None:
    """Let other processes compile the loops of a check, as soon as one turns out not to be compiled.

    With ``sessions``, also those of predictions after each step.
    """
    compile_ahead(*AHEAD_OF_TILES)
    if sessions:
        compile_ahead(*AHEAD_OF_SESSIONS)


def compile_loops_at_once() -> None:
    """Start these processes where nothing was ever compiled: they work while this one still imports what it needs."""
    compile_loops_ahead(sessions=True)
    start_ahead_where_nothing_is_compiled()
