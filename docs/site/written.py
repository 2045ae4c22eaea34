"""Writes into ``docs/`` what the site makes from code and measurements, so that a code host shows it too.

    python docs/site/written.py

A table is put into a page as ``[[table: NAME]]``; this writes it between ``<!-- table: NAME -->`` and
``<!-- end -->``. Pages of effects, detectors, tables, examples and result files are written without the
pictures that only the site draws. A test compares.
"""

import re
import sys
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
import generated
import hooks
import measured
import torque_pictures

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
_NOTE = "<!-- Written by docs/site/written.py -->\n"
_PICTURE = re.compile(r"^!\[[^\]]*\]\(pictures/[^)]*\)\n+", re.MULTILINE)


def list_pages() -> Iterator[tuple[Path, str]]:
    """Each page with the text that it should have."""
    made = {
        "effects.md": generated.effects_page,
        "built-in-detectors.md": generated.detectors_page,
        "tables.md": generated.tables_page,
        "gallery.md": lambda: generated.gallery_page(DOCS / "gallery"),
        "results.md": lambda: hooks.move_links(
            (ROOT / "results" / "README.md").read_text(encoding="utf-8"), Path("results/README.md")
        ),
    }
    for name, make in made.items():
        yield DOCS / name, _NOTE + _PICTURE.sub("", make())
    for page in sorted([*DOCS.glob("*.md"), *DOCS.glob("how-to/*.md")]):
        if page.name not in made:
            text = page.read_text(encoding="utf-8")
            yield page, measured.fill_places(text)


def main() -> None:
    """Write what differs."""
    for page, text in list_pages():
        if not page.is_file() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")
            print(page.relative_to(ROOT))
    for name, picture in torque_pictures.make_pictures().items():
        (DOCS / name).parent.mkdir(parents=True, exist_ok=True)
        (DOCS / name).write_bytes(picture)


if __name__ == "__main__":
    main()
