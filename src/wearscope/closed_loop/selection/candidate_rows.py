"""Rows of the candidates table."""

from collections.abc import Sequence
from typing import Any

from wearscope.closed_loop.selection.evidence import Evidence, Refusal


def tell_candidates(
    step: int, joints: Sequence[str], weighed: Sequence[Evidence], taken: Sequence[Evidence]
) -> list[dict[str, Any]]:
    """Each candidate of a step, what held-out runs say of it, and why it was or was not taken."""
    names = {(e.term.effect.name, e.term.joint) for e in taken}
    rows = []
    for e in weighed:
        term = e.term
        is_taken = (term.effect.name, term.joint) in names and e.refusal is Refusal.NONE
        rows.append(
            {
                "step": step,
                "joint": joints[term.joint],
                "effect": term.effect.name,
                "coefficients": " ".join(term.effect.coefficients[k].name for k in term.subset),
                "shape": " ".join(f"{v:.6g}" for v in term.shape),
                "cv_gain": e.share,
                "p_value": e.p_value,
                "agreement": e.agreement,
                "isolability": e.sine,
                "taken": is_taken,
                "reason": "taken" if is_taken else (e.refusal.value or "another candidate gained more"),
            }
        )
    return rows
