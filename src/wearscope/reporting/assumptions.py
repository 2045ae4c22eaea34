"""What a study assumed, as sentences made from its configuration and tables."""

from collections.abc import Sequence

from wearscope.reporting.findings import PAPER_MODULES
from wearscope.reporting.labels import join_words, unit_text
from wearscope.reporting.page import format_number
from wearscope.reporting.study import Study


def list_assumptions(study: Study) -> list[tuple[str, str]]:
    """Assumptions as pairs of what they are about and a sentence or two."""
    return [
        ("Detectors", _detectors(study)),
        *[(f"Robot {robot}", _say_once(texts)) for robot, texts in study.sources.items()],
        ("Factors", _factors(study)),
        ("Distribution of the factors", _distribution(study)),
        ("Extrapolation to nominal", _extrapolation(study)),
        (
            "Intervals",
            "95 %. Those of medians, ranks and differences are bootstraps over the cells; shares have Wilson "
            "intervals; those of the surrogates assume independent normal residuals.",
        ),
        ("Reality", "All is simulated. Only measured data say how well, see the closed loop."),
    ]


def _say_once(texts: Sequence[str]) -> str:
    """Sources of a robot's numbers; what several of them repeat is said once."""
    parts = (part.strip() for text in texts for part in text.split(";"))
    return "; ".join(dict.fromkeys(part for part in parts if part))


def _detectors(study: Study) -> str:
    text = ", ".join(f"{name} is {one['use']}" for name, one in study.config["detectors"].items()) + "."
    followers = [name for module in PAPER_MODULES.values() if (name := study.detector_of(module)) is not None]
    if followers:
        text += f" The paper's detectors are confidential; {join_words(followers)} follow its description."
    return text


def _factors(study: Study) -> str:
    levels = "; ".join(
        f"{one.description}, {one.low:g} to {one.high:g} {unit_text(one.unit)}".strip()
        for one in study.factors
    ).replace(" -", " −")
    return (
        f"{levels}. Each is constant within a test-cycle; temperature is the same in every joint. The "
        "controller believes in the declared payload mass; the robot carries it over (1 + error)."
    )


def _distribution(study: Study) -> str:
    snr, scope = study.config["snr"], study.config["scope"]
    text = (
        f"Normal about the middle of each range, in coded units. SNR: all factors vary at once, σ = "
        f"{snr['sigma']:g}, wear from {snr['f0']:g} to {snr['f0'] + snr['delta']:g}. Scope: one factor "
        f"varies, the others are nominal, wear from {scope['f0']:g}. Tails beyond ±2 were not simulated."
    )
    return text.replace(" -", " −")


def _extrapolation(study: Study) -> str:
    rows = study.checks[study.checks["model"] == study.config["scope"]["model"]]
    if study.config["scope"]["model"] == "chosen":
        return "None: the chosen surrogates learn from runs at nominal and along the scope's lines."
    if rows.empty:
        return "Not known: the design has no check for the surrogate."
    row = rows.iloc[0]
    where = "outside" if row["nominal_outside"] else "within"
    there, centre = (format_number(float(row[f"variance_{name}"])) for name in ("nominal", "centre"))
    return (
        f"The scope starts from nominal, {where} the design region. The prediction variance there is {there} "
        f"of a run's, and {centre} at the centre."
    )
