"""Words of pages and of the package's code, sentence lengths and size of pages; part of `make lint`.

    python tools/lint_words.py

Plain field English: see `WORDS` for what is not used here, and what is said instead.
"""

import io
import re
import sys
import tokenize
from collections.abc import Iterator
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
#: Tokens of a module that hold words; f-strings are tokens of their own from Python 3.12 on.
_TEXTS = (tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", tokenize.STRING))


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


def read_words(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a file with their numbers; of a module its comments, strings and names."""
    text = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield from enumerate(text.splitlines(), 1)
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NAME:
            yield token.start[0], token.string.replace("_", " ")
        elif token.type in _TEXTS:
            yield from enumerate(token.string.splitlines(), token.start[0])


def check_words(path: Path) -> list[str]:
    """Words of a file that are not used here."""
    return [
        f"{path.relative_to(ROOT).as_posix()}:{number}: '{found[0]}' is not used here; say: {instead}."
        for number, line in read_words(path)
        for pattern, instead in WORDS.items()
        if (found := re.search(pattern, line, re.IGNORECASE))
    ]


def check_page(path: Path) -> list[str]:
    """What is wrong with one page."""
    name, text, wrong = path.relative_to(ROOT).as_posix(), read_own(path), check_words(path)
    lengths = {one: len(one.split()) for one in find_sentences(text)}
    wrong += [
        f"{name}: a sentence of {length} words, at most {LONGEST}: {one[:70]}..."
        for one, length in lengths.items()
        if length > LONGEST
    ]
    wrong += [
        f"{name}:{number}: a table's cell of {count} words, at most {LONGEST}; say it below the table."
        for number, line in enumerate(text.splitlines(), 1)
        if line.startswith("|") and (count := max(len(cell.split()) for cell in line.split("|"))) > LONGEST
    ]
    if lengths and (mean := sum(lengths.values()) / len(lengths)) > MEAN:
        wrong.append(f"{name}: the mean sentence has {mean:.1f} words, at most {MEAN:g}.")
    return wrong


def check_sizes() -> list[str]:
    """Whether README and documentation keep to their number of words."""
    pages = list_pages()[2:]
    counts = {
        "README.md": (len((ROOT / "README.md").read_text(encoding="utf-8").split()), README_WORDS),
        "docs": (sum(len(read_own(path).split()) for path in pages), DOCS_WORDS),
    }
    return [
        f"{name}: {count} words, at most {most}." for name, (count, most) in counts.items() if count > most
    ]


def list_sources() -> list[Path]:
    """Modules and templates of the package."""
    return sorted(file for kind in ("*.py", "*.html") for file in (ROOT / "src").rglob(kind))


def list_pages() -> list[Path]:
    """Pages that are checked."""
    pages = sorted((ROOT / "docs").rglob("*.md"))
    return [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(page for page in pages if read_own(page))]


def read_own(path: Path) -> str:
    """Text of a page without what `docs/site/written.py` writes into it; empty where that is all of it."""
    text = path.read_text(encoding="utf-8")
    if text.startswith("<!-- Written by"):
        return ""
    written = r"<!-- (?:table|value): \w+ -->.*?<!-- end -->"
    return re.sub(written, lambda match: "\n" * match[0].count("\n"), text, flags=re.DOTALL)


if __name__ == "__main__":
    found = [line for path in list_pages() for line in check_page(path)]
    found += [line for path in list_sources() for line in check_words(path)] + check_sizes()
    print("\n".join(found) or "Words and sentences: nothing to correct.")
    sys.exit(bool(found))
