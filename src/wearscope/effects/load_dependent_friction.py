"""Friction that grows with the transmitted load.

Its coefficient is the gear's loss, 1 - efficiency: 0.1 to 0.3 for strain wave and cycloidal gears; a half is
a worm gear that does not drive back.
"""

from wearscope.effects.base import Effect, Parameter, compile_row
from wearscope.effects.motions import PAYLOAD


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = abs(load[j]) * sign[j]


EFFECT = Effect(
    name="load_dependent_friction",
    form="coefficient abs(tau_rb) sign(v)",
    coefficients=(Parameter("coefficient", "-", lower=0.0, believable=(0.0, 0.5)),),
    source="Gogoussis and Donath 1988; Hamon et al. 2010, IEEE IROS",
    depends_on=(
        "load_{joint}",
        "sign_qd_{joint}",
    ),
    row=_row,
    parents=("coulomb",),
    excitation=PAYLOAD,
    changes=2,
    passive=lambda values, temperature: {"by_load": values["coefficient"]},
    passive_lacks="its friction is held at one load, the mean of the motion that is compared",
)
