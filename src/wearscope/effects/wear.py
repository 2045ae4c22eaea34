"""Friction that wear adds: the wear terms of the paper's eq. (17), which are 0 without wear."""

from wearscope.effects.base import WEAR, Effect, Parameter, compile_row, decay


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    worn = wear[j]
    # At f = 0, where eta8 f would divide by zero, both terms are 0.
    out[0] = worn * decay(abs(v[j]) / (shape[0] * worn), shape[1]) * sign[j] if worn > 0.0 else 0.0
    out[1] = worn * v[j]


EFFECT = Effect(
    name="wear",
    form="(eta7 f exp(-abs(v/(eta8 f))^alpha) + eta9 f abs(v)) sign(v)",
    coefficients=(
        Parameter("eta7", "{torque}"),
        Parameter("eta9", "{torque} s/{position}"),
    ),
    source="Samuelsson et al. 2014, eq. (17); Bittencourt et al. 2011",
    depends_on=("qd_{joint}", "sign_qd_{joint}", "wear_{joint}"),
    row=_row,
    shape=(
        Parameter("eta8", "{position}/s", lower=1e-12, default=1e-3),
        Parameter("alpha", "-", lower=0.1, upper=4.0, default=1.0, estimated=False),
    ),
    candidate=False,
    excitation=WEAR,
)
