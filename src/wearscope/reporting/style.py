"""One look for every figure, and figure files whose bytes depend on their content only."""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from matplotlib import style
from matplotlib.figure import Figure
from matplotlib.text import Text

from wearscope.storage import tables

#: Okabe and Ito (2008), colours that people with colour-blindness tell apart; yellow, too faint, left out,
#: and the second blue last.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#000000", "#E69F00", "#56B4E9")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
WARNING = "#B3261E"

_SHEET = Path(__file__).with_name("wearscope.mplstyle")
_METADATA = {"Date": None, "Creator": None, "Format": None, "Type": None}


@contextmanager
def figure_style() -> Iterator[None]:
    """Draw within the project's style, whatever the caller's settings are."""
    with style.context(["default", str(_SHEET)], after_reset=True):
        yield


def colours(names: Sequence[str]) -> dict[str, str]:
    """Colour by name, the same for the same list."""
    return {name: PALETTE[k % len(PALETTE)] for k, name in enumerate(names)}


def new_figure(width: float, height: float) -> Figure:
    """Empty figure of a size [inch] that opens no window."""
    return Figure(figsize=(width, height))


def figure_bytes(figure: Figure, kind: str = "svg") -> bytes:
    """Figure as SVG or PNG; equal figures give equal bytes.

    Parameters
    ----------
    figure : Figure
    kind : {"svg", "png"}
    """
    for text in figure.findobj(Text):  # a '$' of a name or description begins no formula
        text.set_parse_math("mathdefault" in text.get_text())  # type: ignore[attr-defined]
    target = io.BytesIO()
    metadata: Mapping[str, str | None] = _METADATA if kind == "svg" else {"Software": None}
    with figure_style():
        figure.savefig(target, format=kind, metadata=dict(metadata))
    return target.getvalue()


def save_figure(figure: Figure, *paths: str | Path) -> None:
    """Write a figure whole or not at all, as SVG or PNG by the name's ending, with one layout for all."""
    for path in paths:
        content = figure_bytes(figure, Path(path).suffix.lstrip("."))
        figure.set_layout_engine("none")

        def write(name: str, content: bytes = content) -> None:
            Path(name).write_bytes(content)

        tables.write_whole(path, write)
