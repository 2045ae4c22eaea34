"""``python -m wearscope.attribution_board``."""

import sys

from wearscope.attribution_board.runner import main

if __name__ == "__main__":
    sys.exit(main())
