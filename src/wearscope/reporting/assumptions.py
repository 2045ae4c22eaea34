"""What a study assumed, as sentences made from its configuration and tables."""

from collections.abc import Sequence

from wearscope.reporting.findings import STAND_INS
from wearscope.reporting.labels import join_words, unit_text
from wearscope.reporting.page import format_number
from wearscope.reporting.study import Study


def list_assumptions(study: Study) -> list[tuple[str, str]]:
    """Assumptions as pairs of what they are about and a sentence or two."""
    return [
        ("Detectors", _detectors(study)),
        *[(f"Robot {robot}", _say_once(texts)) for robot, texts in study.sources.items()],
        ("Factors", _factors(study)),
        ("Distribution p(w)", _distribution(study)),
        ("Extrapolation to z⁰", _extrapolation(study)),
        ("Monte Carlo and KDE", _density(study)),
        (
            "Intervals",
            "95 %. Those of medians, ranks and differences are bootstraps over the cells, a robot, "
            "test-cycle and axis drawn for all detectors at once; shares have Wilson intervals; those of "
            "the surrogates assume independent normal residuals.",
        ),
        (
            "Reality",
            "All is simulated: a surrogate approximates the simulator, and the simulator the robot. Only "
            "measured data say how well, see the closed loop.",
        ),
    ]


def _say_once(texts: Sequence[str]) -> str:
    """Sources of a robot's numbers; what several of them repeat is said once."""
    parts = (part.strip() for text in texts for part in text.split(";"))
    return "; ".join(dict.fromkeys(part for part in parts if part))


def _detectors(study: Study) -> str:
    listed = ", ".join(f"{name} is {one['use']}" for name, one in study.config["detectors"].items())
    stand_ins = [
        name if name == letter else f"{name} for its {letter}"
        for letter, module in STAND_INS.items()
        if (name := study.detector_of(module)) is not None
    ]
    text = f"{listed}."
    if stand_ins:
        text += f" The paper's detectors are confidential; {join_words(stand_ins)} follow its description."
    knowing = study.detector_of("wear_temperature_fit")
    if knowing is not None:
        text += (
            f" {knowing} is told the friction law that the simulator uses: it bounds what a friction model "
            "can give."
        )
    return text


def _factors(study: Study) -> str:
    levels = "; ".join(
        f"{one.description}, {one.low:g} to {one.high:g} {unit_text(one.unit)}".strip()
        for one in study.factors
    ).replace(" -", " −")
    return (
        f"{levels}. Each is constant within a test-cycle; temperature is the same in every joint. With a "
        "payload mass error the robot carries the declared mass over (1 + error) and the controller believes "
        "in the declared one."
    )


def _distribution(study: Study) -> str:
    snr, scope = study.config["snr"], study.config["scope"]
    text = (
        f"Normal with mean 0 in coded units, the middle of each range. SNR: all nuisances at once, σ = "
        f"{snr['sigma']:g}, wear from {snr['f0']:g} to {snr['f0'] + snr['delta']:g}. Scope: one nuisance at "
        f"a time, the others as in z⁰, wear from {scope['f0']:g}. Tails beyond ±2 leave the ranges that were "
        "simulated" + ("; there a chosen surrogate is held at the end." if _asks_chosen(study) else ".")
    )
    return text.replace(" -", " −")


def _extrapolation(study: Study) -> str:
    if _asks_chosen(study):
        return (
            "None: z⁰ and the lines that the scope asks about are among the runs that the chosen surrogates "
            "learn from. The paper's quadratic models extrapolate there."
        )
    rows = study.checks[study.checks["model"] == study.config["scope"]["model"]]
    if rows.empty:
        return "Not known: the design has no check for the model that is asked."
    row = rows.iloc[0]
    where = "outside the design region" if row["nominal_outside"] else "within the design region"
    norm, region, variance, centre = (
        format_number(float(row[name]))
        for name in ("nominal_norm", "region_norm", "variance_nominal", "variance_centre")
    )
    return (
        f"The scope starts from z⁰, at {norm} coded units from the centre, {where} (its corners: {region}). "
        f"There the prediction variance is {variance} σ², against {centre} σ² at the centre; σ² is that of a "
        "run. " + ("The audit says what that costs." if study.audit is not None else "It was not audited.")
    )


def _asks_chosen(study: Study) -> bool:
    return study.config["scope"]["model"] == "chosen"


def _density(study: Study) -> str:
    snr, scope = study.config["snr"], study.config["scope"]
    return (
        f"SNR: {snr['runs']:,} runs a cell and hypothesis (at most 20,000 of a chosen surrogate), and the "
        "exact value, which for a chosen surrogate is by quadrature on 4,096 Sobol' points. Scope: "
        f"{scope['runs']:,} runs, all fault changes at one σ sharing those of H¹; Gaussian kernel, "
        "bandwidth by Silverman's rule; the closed form needs neither. Where the two differ is shown. "
        "Verdicts in sentences and tables are those of the closed form."
    )
