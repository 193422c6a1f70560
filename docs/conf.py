"""How Sphinx builds the documentation: ``make docs``. Nothing of what is built asks the network for anything."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "extensions"))
os.environ["COLUMNS"] = "100"  # of the help texts

project = "locsnn-compile"
extensions = ["myst_parser", "sphinx.ext.autodoc", "command_help"]
exclude_patterns = ["extensions"]
default_role = "literal"
highlight_language = "text"

myst_heading_anchors = 4
myst_links_external_new_tab = True

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 80

html_theme = "furo"
html_title = "locsnn-compile"
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_last_updated_fmt = None
