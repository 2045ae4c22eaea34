"""The start of every benchmark's command line."""

import argparse


def start_parser(words: str) -> argparse.ArgumentParser:
    """Parser whose help begins with a module's own words, as they are laid out there."""
    return argparse.ArgumentParser(description=words, formatter_class=argparse.RawDescriptionHelpFormatter)
