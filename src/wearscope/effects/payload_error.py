"""Error of the declared payload's mass and centre of mass."""

from wearscope.effects.base import POSTURES, Parameter, PayloadEffect

EFFECT = PayloadEffect(
    name="payload_error",
    form="inverse dynamics of additional mass, first moments and inertia at the last link",
    coefficients=(
        Parameter("mass", "kg"),
        Parameter("moment_x", "kg m"),
        Parameter("moment_y", "kg m"),
        Parameter("moment_z", "kg m"),
        Parameter("inertia_xx", "kg m^2"),
        Parameter("inertia_xy", "kg m^2"),
        Parameter("inertia_yy", "kg m^2"),
        Parameter("inertia_xz", "kg m^2"),
        Parameter("inertia_yz", "kg m^2"),
        Parameter("inertia_zz", "kg m^2"),
    ),
    source="Swevers et al. 2007, IEEE Control Systems 27(5), payload identification",
    depends_on=("load_{joint}",),
    variants=(("mass", "moment_x", "moment_y", "moment_z"),),
    extensions=(
        (
            *("mass", "moment_x", "moment_y", "moment_z"),
            *("inertia_xx", "inertia_xy", "inertia_yy", "inertia_xz", "inertia_yz", "inertia_zz"),
        ),
    ),
    excitation=POSTURES,
)
