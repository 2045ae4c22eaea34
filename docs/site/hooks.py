"""Hooks of MkDocs: pages and pictures made from the code, pages from files outside of docs/, MathML."""

import html
import os
import re
import sys
from pathlib import Path
from typing import Any

import latex2mathml.converter
from markdown import Extension, Markdown
from markdown.preprocessors import Preprocessor
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

sys.path.insert(0, str(Path(__file__).parent))
import generated
import measured
import pictures
import torque_pictures

ROOT = Path(__file__).parents[2]
#: Page by the file of the repository that it shows.
SHOWN = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "results/README.md": "results.md",
}
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s]+)\)")
_MATH = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)


class DocstringMath(Preprocessor):
    """Mathematics as docstrings write it (reStructuredText) in the form that Markdown's extension reads."""

    def run(self, lines: list[str]) -> list[str]:
        """Translate the lines of a text."""
        return translate_math("\n".join(lines)).split("\n")


class DocstringMathExtension(Extension):
    """`DocstringMath` for Python-Markdown."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Register it before any other preprocessor."""
        md.preprocessors.register(DocstringMath(md), "docstring_math", 200)


def translate_math(text: str) -> str:
    """``.. math::`` and ``:math:`` as ``$$`` and ``$``."""

    def block(match: re.Match) -> str:
        indent = match[1]
        body = " ".join(line.strip() for line in match[2].splitlines())
        return f"{indent}$${body.strip()}$$\n"

    text = re.sub(r"^([ \t]*)\.\. math::[ \t]*((?:.+\n?(?!\1\S))*.*)$", block, text, flags=re.MULTILINE)
    return re.sub(r":math:`([^`]+)`", lambda match: f"${match[1]}$", text)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Read mathematics in docstrings as in pages."""
    config.markdown_extensions.append(DocstringMathExtension())  # type: ignore[arg-type]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and pictures that are made."""
    pages = generated.make_pages(ROOT)
    for source, page in SHOWN.items():
        if (ROOT / source).is_file():
            pages[page] = move_links((ROOT / source).read_text(encoding="utf-8"), Path(source))
    made: dict[str, str | bytes] = {**pictures.make_pictures(), **torque_pictures.make_pictures(), **pages}
    for name, content in made.items():
        if (written := files.get_file_from_path(name)) is not None:  # without the pictures that are made here
            files.remove(written)
        files.append(File.generated(config, name, content=content))
    return files


def on_page_markdown(text: str, **_: Any) -> str:
    """Tables that a page asks for."""
    return measured.fill_places(text)


def on_page_content(text: str, **_: Any) -> str:
    """Mathematics as MathML, which browsers show by themselves."""

    def convert(match: re.Match) -> str:
        display = "block" if match[1] == "div" else "inline"
        return latex2mathml.converter.convert(html.unescape(match[2]).strip(), display=display)

    return _MATH.sub(convert, text)


def move_links(text: str, source: Path) -> str:
    """Links of a file of the repository as seen from the top of the site; those to no page as plain text."""

    def move(match: re.Match) -> str:
        image, label, target = match.groups()
        if re.match(r"[a-z]+:|#", target):
            return match[0]
        path, _, anchor = target.partition("#")
        place = Path(os.path.normpath(source.parent / path)).as_posix()
        page = SHOWN.get(place) or (place.removeprefix("docs/") if place.startswith("docs/") else None)
        if page is None:
            return label
        return f"{image}[{label}]({page}{'#' + anchor if anchor else ''})"

    return _LINK.sub(move, text)
