"""`python -m wearscope`."""

import sys

# Python looks for modules in the working directory first. It may be a data set from an unknown source, so
# nothing may be imported from there.
if not sys.flags.safe_path:
    del sys.path[0]

from wearscope.cli.main import main

main()
