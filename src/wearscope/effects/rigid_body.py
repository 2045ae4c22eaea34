"""Multibody dynamics of the links with the declared payload."""

from wearscope.effects.base import QUICK, RigidBodyEffect

EFFECT = RigidBodyEffect(
    name="rigid_body",
    form="M(q) a + C(q, v) v + g(q)",
    coefficients=(),
    source="Featherstone 2008, Rigid Body Dynamics Algorithms, ch. 5",
    depends_on=("q_{joint}", "qd_{joint}", "qdd_{joint}"),
    candidate=False,
    excitation=QUICK,
)
