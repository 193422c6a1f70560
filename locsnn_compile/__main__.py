"""``python -m locsnn_compile``: the same as ``locsnn``."""

import sys

from locsnn_compile.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
