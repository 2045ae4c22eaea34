"""Words, sentence lengths and size of what users read; part of `make lint`.

    python tools/lint_words.py

Plain field English: see `WORDS` for what is not used here, and what is said instead.
"""

import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Words and constructions that are not used, and what is said instead.
WORDS = {
    r"\bbesides?\b": "next to, conditional on, in addition",
    r"\basked anew\b|\basks? of\b": "tested again, asks",
    r"\bmend(?:ed|s|ing)?\b": "corrected",
    r"\bforetold\b|\bforetells?\b": "predicted",
    r"\b(?:stands?|stood|standing) (?:in )?for (?!(?:it|a|the)self)": "represents, is a surrogate for",
    r"\bruns? away\b": "diverges",
    r"\bg(?:ive|ives|ave) way\b": "is superseded by",
    r"\bname goes\b": "is dropped",
    r"\bchance removes\b": "is not due to chance",
    r"\bfeigned\b": "simulated",
    r"\bof which there\b": "that exists",
    r"\bremembers? itself\b": "is autocorrelated",
    r"\bbut for\b": "except",
    r"\bwhat (?:it|they) (?:bears?)\b": "tolerates",
    r"\b(?=[0-9a-f]*\d)(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b": "no commit hashes",
    r"\bcommits? [0-9a-f]{6,}": "no commit hashes",
    r"(?<!-)\bseeds? \d+": "no seed numbers",
}
MEAN, LONGEST = 20.0, 45
README_WORDS, DOCS_WORDS = 500, 25_000


def find_sentences(text: str) -> list[str]:
    """Sentences of a page in Markdown, without code, tables, headings and formulas."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^---\n.*?^---\n|\$\$.*?\$\$|<!--.*?-->", "", text, flags=re.MULTILINE | re.DOTALL)
    lines = []
    for line in text.splitlines():
        kept = not re.match(r"\s*(\||#|!\[|\[\[|    )", line)
        start = re.match(r"\s*([-*+]|\d+\.) ", line)
        lines.append(("\n" if start else "") + (line[start.end() :] if start else line) if kept else "\n")
    blocks = re.split(r"\n\s*\n|\n\n", "\n".join(lines))
    found = []
    for block in blocks:
        for item in re.split(r"\n(?=\n)", block):
            plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", " ".join(item.split()))
            plain = re.sub(r"`[^`]*`", "code", plain)
            found += [one for one in re.split(r"(?<=[.!?])[*\"')]*\s+(?=[A-Z*\"'(`\[]|code|$)", plain)]
    return [one for one in found if len(one.split()) > 2]


def check_words(path: Path) -> list[str]:
    """Words of a file that are not used here."""
    name, wrong = path.relative_to(ROOT).as_posix(), []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        for pattern, instead in WORDS.items():
            if found := re.search(pattern, line, re.IGNORECASE):
                wrong.append(f"{name}:{number}: '{found[0]}' is not used here; say: {instead}.")
    return wrong


def check_page(path: Path) -> list[str]:
    """What is wrong with one page."""
    name, text, wrong = path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8"), check_words(path)
    lengths = {one: len(one.split()) for one in find_sentences(text)}
    wrong += [
        f"{name}: a sentence of {length} words, at most {LONGEST}: {one[:70]}..."
        for one, length in lengths.items()
        if length > LONGEST
    ]
    if lengths and (mean := sum(lengths.values()) / len(lengths)) > MEAN:
        wrong.append(f"{name}: the mean sentence has {mean:.1f} words, at most {MEAN:g}.")
    return wrong


def check_sizes() -> list[str]:
    """Whether README and documentation keep to their number of words."""
    pages = (ROOT / "docs").rglob("*.md")
    counts = {
        "README.md": (len((ROOT / "README.md").read_text(encoding="utf-8").split()), README_WORDS),
        "docs": (sum(len(path.read_text(encoding="utf-8").split()) for path in pages), DOCS_WORDS),
    }
    return [
        f"{name}: {count} words, at most {most}." for name, (count, most) in counts.items() if count > most
    ]


def list_sources() -> list[Path]:
    """Files of the rooms that write what people read."""
    rooms = (ROOT / "src" / "wearscope" / room for room in ("reporting", "cli"))
    return sorted(file for room in rooms for kind in ("*.py", "*.html") for file in room.rglob(kind))


def list_pages() -> list[Path]:
    """Pages that are checked."""
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


if __name__ == "__main__":
    found = [line for path in list_pages() for line in check_page(path)]
    found += [line for path in list_sources() for line in check_words(path)] + check_sizes()
    print("\n".join(found) or "Words and sentences: nothing to correct.")
    sys.exit(bool(found))
