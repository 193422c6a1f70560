"""Programs out of the tests of the chip model are played here, too."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "hw_model"))
