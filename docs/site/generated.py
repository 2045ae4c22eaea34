"""Pages made from the code: effects, detectors, tables, the reference, how to cite."""

import inspect
import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import yaml
from dictionary import columns_of, read_dictionary, split_meaning
from measured import write_table

from wearscope import plugins
from wearscope.detectors.base import name_knowledge
from wearscope.effects.base import Effect, Parameter, load_effect

#: Modules of the reference by heading.
REFERENCE = {
    "In a notebook": [
        "wearscope.notebook.study", "wearscope.notebook.calls", "wearscope.notebook.one_run",
        "wearscope.closed_loop.diagnosis", "wearscope.home",
    ],
    "Designs": ["wearscope.designs.factors", "wearscope.designs.kinds", "wearscope.designs.bases"],
    "Robots": ["wearscope.robots.model", "wearscope.robots.dynamics", "wearscope.robots.friction"],
    "Effects": [
        "wearscope.effects.base", "wearscope.effects.effect", "wearscope.effects.kinds",
        "wearscope.effects.parameter",
    ],
    "Test-cycles": ["wearscope.cycles.base"],
    "Simulation": ["wearscope.simulation.study", "wearscope.simulation.recording"],
    "Detectors": ["wearscope.detectors.base"],
    "Surrogates": [
        "wearscope.surrogates.fitting", "wearscope.surrogates.kinds.base", "wearscope.surrogates.validation",
    ],
    "Evaluation": [
        "wearscope.evaluation.sensitivity", "wearscope.evaluation.snr", "wearscope.evaluation.ranking",
        "wearscope.evaluation.scope", "wearscope.evaluation.sampled_scope", "wearscope.evaluation.scope_kde",
    ],
    "Tables and errors": ["wearscope.storage.tables", "wearscope.errors"],
}  # fmt: skip


def make_pages(root: Path) -> dict[str, str]:
    """Text of every page by its name."""
    return {
        "effects.md": effects_page(),
        "built-in-detectors.md": detectors_page(),
        "tables.md": tables_page(),
        "reference.md": reference_page(),
        "cite.md": cite_page(root / "CITATION.cff"),
        "gallery.md": gallery_page(root / "docs" / "gallery"),
        **{
            f"notebooks/{file.stem}.md": notebook_page(file)
            for file in sorted((root / "docs" / "notebooks").glob("*.ipynb"))
        },
    }


def notebook_page(file: Path) -> str:
    """A notebook as a page: its text and its code; tests/notebooks runs it."""
    parts = [f"[This page as a notebook]({file.name})"]
    for cell in json.loads(file.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        else:
            shell, code = source.startswith("%%bash"), source.removeprefix("%%bash\n")
            parts.append(f"```{'sh' if shell else 'python'}\n{code}\n```")
    head, *rest = parts[1:]
    return "\n\n".join([head, parts[0], *rest]) + "\n"


def gallery_page(folder: Path) -> str:
    """Each example: its text, picture and code; `pages.py` runs it."""
    parts = [
        "# Gallery",
        "",
        'One figure and a few lines of Python each. `Study("results/quick")` needs a finished study:',
        "`wearscope run quick`.",
    ]
    for file in sorted(folder.glob("*.py")):
        heading, _, code = file.read_text(encoding="utf-8").partition('\n"""\n')
        title, _, text = heading.strip('"').partition("\n")
        parts += ["", f"## {title.rstrip('.')}", "", " ".join(text.split())]
        picture = f"figures/gallery/{file.stem}.png"
        parts += ["", f"![{title.rstrip('.')}]({picture})", "", f"```python\n{code.strip()}\n```"]
    return "\n".join(parts) + "\n"


def reference_page() -> str:
    """The functions and classes that others call, from their docstrings."""
    parts = [
        "# Python",
        "",
        "`import wearscope` has `Study`, `diagnose`, `track`, `detect`, `evaluate`, `example_dataset`,",
        "`simulate` and `InputError`.",
    ]
    for heading, modules in REFERENCE.items():
        parts += ["", f"## {heading}", ""]
        for module in modules:
            parts += [f"::: {module}", "    options: {heading_level: 3}", ""]
    return "\n".join(parts) + "\n"


def effects_page() -> str:
    """Each effect of the vocabulary: formula, parameters, source."""
    parts = [
        "# Effects",
        "",
        "Each is one formula, which identification fits and the simulator applies. q, v, a: position, speed",
        "and acceleration of the joint; T its temperature [deg C]; f its wear [-]. The pictures show the",
        "effect alone along a sinusoid, at a joint of some 100 N m. Where this is not possible they show",
        "what it adds to the simulated torque of the medium robot's second axis.",
    ]
    for name in plugins.list_names("effects", "EFFECT"):
        parts += ["", *describe_effect(load_effect(name), _module("effects", name))]
    return "\n".join(parts) + "\n"


def describe_effect(effect: Effect, module: ModuleType) -> list[str]:
    """Section of an effect, in lines."""
    lines = [f"## `{effect.name}`", "", *_text(module), "", "```text", effect.form, "```", ""]
    lines += [f"![{effect.name}: torque of a joint](pictures/effects/{effect.name}.svg)", ""]
    if effect.parameters:
        rows = [_parameter_row(p, p in effect.coefficients) for p in effect.parameters]
        header = ["parameter", "unit", "bounds", "default", "enters", "from data"]
        lines += [*_table(header, rows), ""]
    facts = {
        "Source": effect.source,
        "Depends on": ", ".join(f"`{one}`" for one in effect.depends_on),
        "Shown by": effect.excitation,
        "Refines": ", ".join(f"`{one}`" for one in effect.parents),
        "Contains": ", ".join(f"`{one}`" for one in effect.contains),
    }
    return lines + [f"- {label}: {text}" for label, text in facts.items() if text]


def detectors_page() -> str:
    """Each built-in detector, from its docstring and its options."""
    parts = [
        "# Built-in detectors",
        "",
        "What a detector is given, and how to add one: [detectors](detectors.md). Pictures: the second",
        "axis of the medium robot in the test-cycle `axis_sweeps`; the detector learned at 50 °C.",
    ]
    for name in plugins.list_names("detectors", "DETECTOR"):
        kind = plugins.load(name, "detectors", "DETECTOR")
        text = inspect.getdoc(kind) or ""
        unit = getattr(kind, "unit", "-")
        unit = "N m, or N where the tested joint is prismatic" if unit == "torque" else unit
        options = [
            [f"`{field.name}`", f"`{field.default!r}`"]
            for field in (fields(kind) if is_dataclass(kind) else ())
            if field.init
        ]
        picture = f"![{name}: test quantity over wear](pictures/detectors/{name}.svg)"
        parts += ["", f"## `{name}`", "", *_sections(text), "", picture, ""]
        parts += [f"- Unit of the test quantity: {unit}", f"- It is told: {name_knowledge(name)}"]
        if options:
            parts += ["", *_table(["option", "default"], options)]
    return "\n".join(parts) + "\n"


def tables_page() -> str:
    """Every column of a study's tables with unit and meaning."""
    content = read_dictionary()
    parts = ["# Tables", "", content["introduction"]]
    for name, table in content["tables"].items():
        rows = [
            [f"`{column}`", *split_meaning(meaning)] for column, meaning in columns_of(content, name).items()
        ]
        parts += ["", f"## `{name}`", "", table["what"], "", *_table(["column", "unit", "meaning"], rows)]
    return "\n".join(parts) + "\n"


def cite_page(file: Path) -> str:
    """How to cite, from CITATION.cff."""
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    parts = ["# How to cite", "", content["message"], ""]
    for one in (content, content.get("preferred-citation", {})):
        if one:
            names = ", ".join(
                who.get("name") or f"{who['family-names']}, {who['given-names']}" for who in one["authors"]
            )
            told = [names, f"*{one['title']}*", str(one.get("year") or f"version {one['version']}")]
            parts.append(f"- {'. '.join(told)}.")
    return "\n".join([*parts, "", "```yaml", file.read_text(encoding="utf-8").rstrip(), "```", ""])


def _module(room: str, name: str) -> ModuleType:
    return __import__(f"wearscope.{room}.{name}", fromlist=["_"])


def _text(module: ModuleType) -> list[str]:
    return _sections(inspect.getdoc(module) or "")


def _sections(text: str) -> list[str]:
    """A NumPy docstring as Markdown: underlined headings in bold, parameters as a list."""
    lines, out, k = text.splitlines(), [], 0
    listing = False
    while k < len(lines):
        line = lines[k]
        if k + 1 < len(lines) and line.strip() and set(lines[k + 1].strip()) == {"-"}:
            out += ["", f"**{line.strip()}**", ""]
            listing, k = True, k + 2
            continue
        if listing and line and not line[0].isspace():
            names, _, kind = line.partition(" : ")
            out.append(f"- `{names}`" + (f" ({kind})" if kind else ""))
        else:
            out.append(line)
        k += 1
    return out


def _parameter_row(p: Parameter, linear: bool) -> list[str]:
    unit = p.unit_at("rad", "N m") if p.unit != "-" else "-"
    default = "must be given" if np.isnan(p.default) else f"{p.default:g}"
    return [
        f"`{p.name}`", unit, f"{p.lower:g} to {p.upper:g}", default,
        "linearly" if linear else "as a shape", "yes" if p.estimated else "no",
    ]  # fmt: skip


def _table(header: list[str], rows: list[list[str]]) -> list[str]:
    return write_table(header, rows).split("\n")
