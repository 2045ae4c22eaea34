"""Error of the declared payload's mass and centre of mass."""

from wearscope.effects.base import Parameter, PayloadEffect

EFFECT = PayloadEffect(
    name="payload_error",
    form="inverse dynamics of an additional mass and first moment at the last link",
    coefficients=(
        Parameter("mass", "kg"),
        Parameter("moment_x", "kg m"),
        Parameter("moment_y", "kg m"),
        Parameter("moment_z", "kg m"),
    ),
    source="Swevers et al. 2007, IEEE Control Systems 27(5), payload identification",
    depends_on=("load_{joint}",),
    spread=True,
    variants=(("mass",), ("mass", "moment_x", "moment_y", "moment_z")),
)
