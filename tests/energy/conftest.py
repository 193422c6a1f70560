"""Find the modules of the study of energy, which lie next to its page."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "docs/research/energy-130nm"))
