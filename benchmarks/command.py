"""What the benchmarks' command lines share: their start, and the rows of the tables that they print."""

import argparse


def start_parser(words: str) -> argparse.ArgumentParser:
    """Parser whose help begins with a module's own words, as they are laid out there."""
    return argparse.ArgumentParser(description=words, formatter_class=argparse.RawDescriptionHelpFormatter)


def write_row(*cells: object) -> str:
    """Row of a table in Markdown."""
    return f"| {' | '.join(map(str, cells))} |"


def write_heads(*names: str) -> str:
    """The first two rows of a table."""
    return f"{write_row(*names)}\n|{len(names) * '---|'}"
