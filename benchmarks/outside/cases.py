"""The cases: each an arm in a regime, with nothing, one or several effects planted."""

from benchmarks.outside.planted import Case, Plant

_SHORT = (("fourier", 20.0), ("points", 25.0), ("fourier", 20.0))
_POINTS = (("points", 25.0), ("points", 30.0), ("points", 25.0))
_SWEEPS = (("sweeps", 40.0), ("fourier", 25.0), ("points", 30.0))
_FWT = ("rigid_body", "rotor_inertia", "friction_wear_temperature")
_BODY = ("rigid_body",)

NULLS = (
    Case("null-white-ur10", "ur10"),
    Case("null-coloured3-puma", "puma560", noise="coloured", level=0.03, rate=125),
    Case("null-coloured10-iiwa", "iiwa14", noise="coloured", level=0.10, rate=100, train=_SHORT),
    Case("null-hum3-tx40", "tx40", noise="hum", level=0.03, rate=250, train=_SHORT),
    Case("null-heavy5-scara", "scara", noise="heavy", level=0.05, rate=250, drives=False),
    Case("null-drift3-ur5", "ur5", noise="drift", level=0.03, rate=125, train=_POINTS),
    Case("null-loop-planar", "planar", loop=0.01, rate=500, level=0.005),
    Case("null-loop-ur5", "ur5", loop=0.01, rate=125, level=0.005, train=_SHORT),
    Case("null-approx-manutec", "manutec", inertials="approximate", stated=0.1, rate=100, drives=False),
    Case("null-onerun-panda", "panda", train=(("fourier", 60.0),), rate=250, level=0.005, counts=16384),
    Case("null-wide-puma", "puma560", width=0.03, rate=200, train=_SWEEPS),
    Case("null-fwt-ur5", "ur5", declared=_FWT, rate=125, train=_POINTS),
)

BARE = (
    Case("bare-ur10", "ur10", declared=_BODY, rate=125),
    Case("bare-panda", "panda", declared=_BODY, rate=200, level=0.005, counts=16384, drives=False),
    Case("bare-scara", "scara", declared=_BODY, rate=250, train=_SHORT, drives=False),
    Case("bare-coloured-puma", "puma560", declared=_BODY, noise="coloured", level=0.03, rate=125,
         drives=False),
    Case("bare-approx-tx40", "tx40", declared=_BODY, inertials="approximate", stated=0.1, rate=125,
         drives=False, train=_SWEEPS),
    Case("empty-planar", "planar", declared=(), rate=200, drives=False),
    Case("bare-stribeck-ur5", "ur5", (Plant("stribeck", 2, 4.0),), declared=_BODY, rate=125),
)  # fmt: skip

ONE = (
    Case("stribeck-panda", "panda", (Plant("stribeck", 1, 4.0),), rate=200, level=0.01, counts=16384),
    Case("concave-ur10", "ur10", (Plant("concave_viscous", 1, 4.0),), rate=125, train=_SHORT),
    Case("asymmetry-puma", "puma560", (Plant("viscous_asymmetry", 2, 4.0),), noise="coloured", level=0.02,
         rate=125),
    Case("coulasym-tx40", "tx40", (Plant("coulomb_asymmetry", 1, 4.0),), rate=200, train=_POINTS),
    Case("load-iiwa", "iiwa14", (Plant("load_dependent_friction", 1, 4.0),), noise="coloured", level=0.03,
         rate=100),
    Case("thermal-ur5", "ur5", (Plant("temperature_dependent_friction", 1, 5.0),), rate=125),
    Case("warmup-tx40", "tx40", (Plant("warm_up_drift", 2, 5.0),), rate=125),
    Case("lugre-ur5", "ur5", (Plant("presliding_hysteresis", 0, 0.02),), rate=200, level=0.005, train=_SHORT),
    Case("backlash-manutec", "manutec", (Plant("backlash", 1, 4.0),), rate=200, level=0.005, train=_SHORT),
    Case("elastic-iiwa", "iiwa14", (Plant("joint_elasticity", 1, 9.0),), rate=200, level=0.005, train=_SHORT),
    Case("ripple-planar", "planar", (Plant("torque_ripple", 0, 4.0),), rate=250),
    Case("spring-scara", "scara", (Plant("joint_spring", 0, 4.0),), rate=100, train=_SHORT),
    Case("balancer-manutec", "manutec", (Plant("gravity_counterbalance", 1, 6.0),), rate=100, train=_SHORT),
    Case("payload-ur10", "ur10", (Plant("payload_error", 5, 2.8),), rate=125, train=_POINTS),
    Case("mass-puma", "puma560", (Plant("inertial_error", 1, 0.15),), rate=125),
    Case("gain-ur5", "ur5", (Plant("torque_constant_error", 2, 0.08),), rate=125, train=_SHORT),
    Case("rotor-manutec", "manutec", (Plant("rotor_inertia_error", 2, 0.35),), rate=125, train=_SHORT),
    Case("delay-panda", "panda", (Plant("time_delay", 3, 12.0),), rate=250, level=0.005, counts=16384),
    Case("coupling-puma", "puma560", (Plant("cross_coupling", 5, 4.0),), rate=125),
    Case("slide-quadratic-scara", "scara", (Plant("quadratic_viscous", 2, 4.0),), width=0.03, rate=250,
         noise="heavy", level=0.02),
)  # fmt: skip

SEVERAL = (
    Case("two-ur10", "ur10", (Plant("stribeck", 0, 4.0), Plant("torque_offset", 3, 4.0)), rate=125),
    Case("three-iiwa", "iiwa14", (Plant("joint_spring", 3, 4.0), Plant("coulomb_asymmetry", 0, 4.0),
         Plant("load_dependent_friction", 1, 4.0)), rate=100),
    Case("four-tx40", "tx40", (Plant("concave_viscous", 0, 5.0), Plant("viscous_asymmetry", 1, 4.0),
         Plant("torque_ripple", 2, 4.0), Plant("cross_coupling", 5, 4.0)), rate=200),
    Case("two-approx-puma", "puma560", (Plant("stribeck", 1, 4.0), Plant("cross_coupling", 5, 4.0)),
         inertials="approximate", stated=0.1, rate=125),
    Case("payload-stribeck-ur5", "ur5", (Plant("payload_error", 5, 1.5), Plant("stribeck", 1, 5.0)),
         rate=125),
    Case("loop-stribeck-planar", "planar", (Plant("stribeck", 0, 5.0),), loop=0.005, rate=250, level=0.01),
)  # fmt: skip

OUTSIDE = (
    Case("square-ur5", "ur5", (Plant("square_in_time", 2, 5.0),), rate=125),
    Case("product-puma", "puma560", (Plant("product_of_positions", 1, 5.0),), rate=125),
    Case("posspeed-panda", "panda", (Plant("position_times_speed", 0, 5.0),), rate=200, level=0.01,
         counts=16384),
    Case("step-tx40", "tx40", (Plant("step_in_time", 1, 5.0),), rate=125),
    Case("loadspeed-ur10", "ur10", (Plant("load_times_speed", 1, 5.0),), rate=125),
)  # fmt: skip

CASES = {case.name: case for case in (*NULLS, *BARE, *ONE, *SEVERAL, *OUTSIDE)}
