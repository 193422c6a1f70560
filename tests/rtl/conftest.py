"""Programs out of the tests of the chip model, and networks that ship, are played here, too."""

import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1] / name) for name in ("hw_model", "hardware")]
