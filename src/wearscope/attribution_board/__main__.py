"""``python -m wearscope.attribution_board``."""

import sys

from wearscope.attribution_board.board import main

if __name__ == "__main__":
    sys.exit(main())
