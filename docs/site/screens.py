"""Pictures of the documentation that take long, of the gallery, the example and pages; outputs of notebooks.

    wearscope run quick && python docs/site/screens.py

needs Debian's chromium for the last ones, which are left as they are without it. MkDocs does not call this.
"""

import os
import runpy
import shutil
import subprocess
import tempfile
from pathlib import Path

import matplotlib as mpl
import nbformat
import pandas as pd
from matplotlib import pyplot as plt
from nbclient import NotebookClient
from PIL import Image

from wearscope import example_dataset
from wearscope.closed_loop.run import close_loop
from wearscope.reporting.closed_loop_page import write_closed_loop_page
from wearscope.reporting.style import PALETTE, figure_style, new_figure

ROOT = Path(__file__).parents[2]
FIGURES = ROOT / "docs" / "figures"
BROWSER = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--no-first-run", "--hide-scrollbars",
)  # fmt: skip


def run_notebooks() -> None:
    """Run each notebook in an empty folder, and keep what its cells show; the command is on the path."""
    for file in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        notebook = nbformat.read(file, as_version=4)
        described = notebook.metadata.copy()
        with tempfile.TemporaryDirectory() as folder:
            options = {"record_timing": False, "coalesce_streams": True, "timeout": 1800}
            NotebookClient(notebook, resources={"metadata": {"path": folder}}, **options).execute()
        for cell in notebook.cells:
            if cell.cell_type == "code":  # what is said of progress holds times
                cell.outputs = [one for one in cell.outputs if one.get("name") != "stderr"]
        notebook.metadata = described
        nbformat.write(notebook, file)


def draw_gallery() -> None:
    """Run each example of the gallery, and keep its figure."""
    (FIGURES / "gallery").mkdir(exist_ok=True)
    for file in sorted((ROOT / "docs" / "gallery").glob("*.py")):
        with tempfile.TemporaryDirectory() as folder, mpl.rc_context({"figure.figsize": (6.0, 3.2)}):
            (Path(folder) / "results").symlink_to(ROOT / "results")
            os.chdir(folder)
            runpy.run_path(str(file))["figure"].savefig(FIGURES / "gallery" / f"{file.stem}.png", dpi=110)
            os.chdir(ROOT)
        plt.close("all")


def draw_example(outcome: Path) -> None:
    """Error of the example's second joint over time, and of all joints before and after."""
    residual = pd.read_parquet(outcome / "residual.parquet").query("counts")
    tested = residual[residual.run.str.contains("sweeps")]
    rows = tested[tested.joint == "axis_2"]
    with figure_style():
        figure = new_figure(6.4, 2.8)
        ax = figure.add_subplot()
        for name, colour in (("before", PALETTE[1]), ("after", PALETTE[0])):
            ax.plot(rows.t, rows[f"residual_{name}"], ".", color=colour, markersize=3, label=name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("measured minus predicted [N m]")
        ax.legend()
        figure.savefig(FIGURES / "verdict_example.png", dpi=120)
        squares = tested[["residual_before", "residual_after"]].pow(2).groupby(tested.joint).mean()
        figure = new_figure(6.4, 2.6)
        ax = figure.add_subplot()
        for k, (name, colour) in enumerate((("before", PALETTE[1]), ("after", PALETTE[0]))):
            places = [place + 0.35 * k for place in range(len(squares))]
            ax.bar(places, squares[f"residual_{name}"] ** 0.5, width=0.33, color=colour, label=name)
        ax.set_xticks([place + 0.175 for place in range(len(squares))], list(squares.index))
        ax.set_yscale("log")
        ax.set_ylabel("error on the test run [N m]")
        ax.legend()
        figure.savefig(FIGURES / "method_errors.png", dpi=120)


def picture_page(page: Path, picture: Path, width: int = 1280, height: int = 860) -> None:
    """The top of a page as a browser shows it."""
    browser = shutil.which("chromium")
    if browser is None:
        return
    with tempfile.TemporaryDirectory() as profile:
        command = [browser, *BROWSER, f"--user-data-dir={profile}", f"--window-size={width},{height}"]
        command += ["--virtual-time-budget=8000", f"--screenshot={picture}", page.resolve().as_uri()]
        subprocess.run(command, check=True, capture_output=True, timeout=180)
    with Image.open(picture) as opened:
        opened.convert("RGB").quantize(256, Image.Quantize.FASTOCTREE).save(picture, optimize=True)


if __name__ == "__main__":
    run_notebooks()
    draw_gallery()
    with tempfile.TemporaryDirectory() as place:
        close_loop(example_dataset(), Path(place))
        write_closed_loop_page(Path(place), example_dataset() / "robot.urdf")
        draw_example(Path(place))
        picture_page(Path(place) / "report.html", FIGURES / "page_loop.png")
    picture_page(ROOT / "results" / "quick" / "report.html", FIGURES / "page_study.png")
