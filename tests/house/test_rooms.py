"""Lines of code, imports between folders and import cycles of a small made-up package are counted right."""

from rooms import code_lines, table

HOUSE = {  # the source of each module, by its path
    "hw_model/__init__": '"""Doc."""\n',
    "hw_model/chip": '"""Doc.\n\nMore.\n"""\n\nx = 1  # why\n\n# a comment\n',
    "locsnn_compile/passes/lower": (
        "from typing import TYPE_CHECKING\n"
        "from hw_model.chip import x\n"
        "if TYPE_CHECKING:\n    from locsnn_compile.cli import main\n"
        "def f():\n    from locsnn_compile.report.write import y\n"
    ),
    "locsnn_compile/passes/other": "from hw_model import chip\n",
    "locsnn_compile/report/write": "import hw_model.chip\nfrom locsnn_compile.passes import lower, other\n",
    "locsnn_compile/cli/main": "import os\n",
}

TABLE = """\
folder                 lines
hw_model                   1
locsnn_compile/cli         1
locsnn_compile/passes      7
locsnn_compile/report      2
all                       11

arrows between rooms: 4
floors: 2
arrows that run back: 1
  locsnn_compile/passes -> locsnn_compile/report (1)
circles of rooms: 1
  locsnn_compile/passes, locsnn_compile/report
circles of folders in a room: 0
circles of files: 1
  locsnn_compile/passes/lower, locsnn_compile/report/write"""


def test_a_small_package_is_measured_as_by_hand():
    assert table(HOUSE) == TABLE


def test_imports_for_types_count_only_on_request():
    assert "arrows between rooms: 5" in table(HOUSE, types=True)


def test_strings_that_are_values_are_code():
    # All but the docstring: the line of the function, and three of the string that it returns.
    assert code_lines('def f():\n    """Doc."""\n    return """\n    text\n    """\n') == 4
