"""What ``locsnn run`` says of recordings, whatever the program is for."""

from typing import Any

from hw_model.values import IntArray
from locsnn_compile.errors import check_most
from locsnn_compile.report.format import plural


def check_classes(labels: IntArray, classes: int) -> None:
    """Refuse labels that are not among the classes of a program."""
    where = "labels of --events"
    fix = "Check that the recordings belong to this program."
    check_most(int(labels.max()), classes - 1, where, "no class has this number", fix=fix)


def recording_line(row: dict[str, Any]) -> str:
    """Return the outcome of a recording as one line."""
    label = "" if row["label"] is None else f"  label {row['label']}"
    predicted = "all classes tie" if row["tied"] else f"class {row['prediction']}"
    spikes = plural(row["spikes"], "spike")
    return f"recording {row['recording']}: {predicted}{label}  {spikes}"


def accuracy_lines(right: int, labelled: int) -> list[str]:
    """Return a line on how many of the labelled recordings are right; none without labels."""
    if not labelled:
        return []
    return [f"accuracy {right / labelled:.3f} on {plural(labelled, 'recording')}"]
