"""`python -m wearscope`."""

import sys

# Python puts the working directory first, which may be a data set: nothing is imported from there.
if not sys.flags.safe_path:
    del sys.path[0]

from wearscope.cli.main import main

main()
