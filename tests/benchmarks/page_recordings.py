"""The page of real recordings: the test sets, what silence saves, a prediction after every step."""

from __future__ import annotations

from page_figures import Found, made_by, percent, ratio, table, times


def test_set(records: dict[str, Found]) -> str:
    """Return the section on the whole test set: time, memory, start-up."""
    found, start = records["test_set"], records["start_up"]
    rows = [
        [
            f"{m['recordings']:,}",
            f"{m['seconds']:.3f}",
            times(m["seconds"] / m["recordings"]),
            f"{m['peak_mib']:,.0f}",
        ]
        for m in records["stream"]["streams"]
    ]
    return f"""The compiled `objects-hybrid` plays all {
        found["recordings"]
    } test recordings of Ev-Objects in {found["seconds"] * 1e3:.1f} ms (goal: below 100 ms), in one
call and after start-up: {times(found["seconds"] / found["recordings"])} µs per recording, {
        found["synaptic_ops"] / found["seconds"] / 1e9:.2f} billion synaptic operations and {
        found["neuron_updates"]
        / found["seconds"]
        / 1e9:.2f} billion compartment updates per second.

Played again and again as a stream of batches of {found["recordings"]}, in a process of its own:

{table(["recordings", "seconds", "µs per recording", "peak MiB"], rows, left=0)}

Start-up, with the program read from its folder. *Cold* is the first run on a machine, which compiles the engine:

{
        table(
            [
                "cache of compiled code",
                "reading s",
                "first call s",
                "second call s",
                "whole process s",
            ],
            [
                [
                    state,
                    *(
                        f"{start[state][part]:.2f}"
                        for part in ("load", "first_call", "second_call", "all")
                    ),
                ]
                for state in ("cold", "warm")
            ],
        )
    }
"""


def silence(record: Found) -> str:
    """Return the section on what skipping saves on recordings that begin in silence."""
    rows = [
        [
            f"{name} phase", f"{phase['steps']:,}", f"{phase['skipped_steps']:.1f}",
            percent(phase['skipped_steps'] / phase['steps'], 1),
            percent(phase['neuron_updates_skipped'] / phase['neuron_updates'], 1), percent(phase['at_rest'], 1),
        ]
        for name, phase in record["phases"].items()
    ]  # fmt: skip
    saved = 1 - record["seconds"] / record["seconds_without"]
    return f"""The recordings of Ev-Containers begin with {record["silent_rows"]:.0f} silent rows on average, two seconds. The compiled
`containers-hybrid` takes {times(record["seconds"])} µs per recording, and {times(record["seconds_without"])} µs when it has to update everything
(`hw.simulate(..., skip=False)`, the same spikes): skipping saves {percent(saved)} of the time.

{table(["", "steps", "steps skipped", "share", "updates in them", "updates at rest"], rows)}

A silent step has no synaptic operations, so what can be skipped is compartment updates. *At rest* counts compartments
without charge, current or voltage in any step, whether the engine could leave them out or not.
"""


def streaming(record: Found) -> str:
    """Return the section on a prediction after every step: a session against running the location branch anew."""
    anew, pushed = (("anew_at_once", "anew_step_by_step"), ("pushed_at_once", "pushed_row_by_row"))
    rows = [
        [
            label,
            f"{record[new] * 1e3:.2f}",
            f"{record[old] * 1e3:.2f}",
            ratio(record[old] / record[new]),
        ]
        for label, new, old in zip(("at once", "as rows arrive"), pushed, anew, strict=True)
    ]
    head = [
        "a recording",
        "hw.Session, ms",
        "location branch anew, ms",
        "ratio (goal 16 at once, 8 as rows arrive)",
    ]
    return f"""All {record["steps"]} predictions of a recording of Ev-Objects, one after each step. The steps of the location branch are channels,
so a new row of the recording may change any of them. Either `hw.Session` recomputes only what the row's events change, or the
branch runs anew on the rows that are known so far. *At once*: the whole recording is given, and the {record["steps"]} runs anew are one batch; *as rows arrive*: a call for every step. All give the
same scores. Of all steps that a full run would take after every row, a session repeats {percent(record["again"])}, since most rows have an event in one of the channels that come first. Both ways run in turn; times are processor times of
all threads.

{table(head, rows)}
"""


def recordings_in_short(records: dict[str, Found]) -> str:
    """Return the sentences on the time of the test set, and on what a session saves."""
    if "test_set" not in records:
        return ""
    found, stream = records["test_set"], records["streaming"]
    at_once = ratio(stream["anew_at_once"] / stream["pushed_at_once"])
    by_rows = ratio(stream["anew_step_by_step"] / stream["pushed_row_by_row"])
    return (
        f"The {found['recordings']} test recordings of Ev-Objects play in "
        f"{found['seconds'] * 1e3:.1f} ms. A prediction after every step takes a session "
        f"{at_once} times less time than playing anew, and {by_rows} times less as rows arrive."
    )


def recordings(records: dict[str, Found]) -> str:
    """Return the sections on published recordings, or a note if the recordings were not there."""
    if "test_set" not in records:
        return "The recordings were not there.\n"
    return f"""## The published test recordings

{made_by("test_recordings.py")}

{test_set(records)}
## What silence saves

{made_by("test_recordings.py")}

{silence(records["silence"])}
## A prediction after every step

{made_by("test_streaming.py")}

{streaming(records["streaming"])}
"""
