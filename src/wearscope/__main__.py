"""`python -m wearscope`."""

from wearscope.cli.main import main

main()
