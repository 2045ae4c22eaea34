"""`python -m wearscope`."""

import os
import sys

# Python puts the working directory first, which may be a data set: nothing is imported from there.
if sys.path[:1] in ([""], [os.getcwd()]):
    del sys.path[0]

from wearscope.cli.main import main

main()
