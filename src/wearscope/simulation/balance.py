"""Newton iteration that balances the torques over a part of a step; an active set holds motors at rest.

The unknowns are the mean speeds x of the links and y of the motors over the part. With h half its length (its
whole length when the end of the part is computed, not its middle),

    M (x - v)/h + c = g                                   links
    J (y - v_motor)/h + tau(y) + g = u(y)                 motors
    x = y                       where the gear is rigid; g is then the torque that the links need
    deflection(g) = gap(y - x)  where the gear is flexible

with M, c the links' mass matrix and bias torque, J the rotor inertia, tau the effects' torque, u the
saturated controller torque and g the torque through the gear. tau is set-valued at rest: a motor stays there
exactly where the torque that holds it lies between tau(0-) and tau(0+). The slope of tau against y is the
secant of the last two iterates.

Otter, Elmqvist, Mattsson 1999, IEEE CACSD, for friction that is set-valued at rest.
"""

import numpy as np
from numba import njit

from wearscope.simulation.arrays import INNER
from wearscope.simulation.terms import evaluate_terms


@njit(cache=True, error_model="numpy", forceinline=True)
def deflection(torque, compliance, lost_motion, mesh_torque):
    """Deflection (motor minus link position) under a torque."""
    return compliance * torque + 0.5 * lost_motion * np.tanh(torque / mesh_torque)


@njit(cache=True, error_model="numpy", forceinline=True)
def deflection_slope(torque, compliance, lost_motion, mesh_torque):
    """Compliance at a torque: derivative of the deflection with respect to the torque."""
    take_up = np.cosh(min(abs(torque / mesh_torque), 300.0))
    return compliance + 0.5 * lost_motion / (mesh_torque * take_up * take_up)


@njit(cache=True, error_model="numpy", forceinline=True)
def invert_deflection(gap, compliance, lost_motion, mesh_torque):
    """Torque at a deflection.

    For positive torque the deflection is concave, so Newton's method converges from any start below the root.
    The start is the larger of two lower bounds: from the slope at zero torque, and from the asymptote.
    """
    size = abs(gap)
    torque = max(
        size / (compliance + 0.5 * lost_motion / mesh_torque), (size - 0.5 * lost_motion) / compliance
    )
    if lost_motion > 0.0:
        for _ in range(100):
            change = (size - deflection(torque, compliance, lost_motion, mesh_torque)) / deflection_slope(
                torque, compliance, lost_motion, mesh_torque
            )
            torque += change
            if abs(change) <= 1e-14 * torque:
                break
    return np.copysign(torque, gap)


MAX_ITERATIONS = 80
#: The iteration becomes careful after this many iterations, or where the slopes make the system singular.
#: Then it releases only the motor furthest beyond break-away at a time, and it measures the slopes of torques
#: that depend on the load against the speeds of all joints.
PATIENCE = 25
#: A correction is accepted without another evaluation of the effects on two conditions. At the last measured
#: rate of convergence it leaves less than the tolerance over `SAFETY`. And that rate has served fewer than
#: `TRUST` steps.
SAFETY, TRUST = 3.0, 50.0
#: A motor counts as at rest where its speed at the end of a part is below this share of the change of its
#: speed over the part.
REST = 1e-4
#: `balance_part` returns the share of the part after which a motor reverses, or one of these special values:
#: no motor reverses; the torques do not balance.
WHOLE, NO_BALANCE = 1.0, -1.0


@njit(**INNER)
def _solve(a, b):
    """Solve a x = b in place, without pivoting; False where a pivot vanishes or is negative."""
    n = len(b)
    for i in range(n):
        pivot = a[i, i]
        if not pivot > 0.0:
            return False
        for r in range(i + 1, n):
            if a[r, i] != 0.0:
                factor = a[r, i] / pivot
                for c in range(i + 1, n):
                    a[r, c] -= factor * a[i, c]
                b[r] -= factor * b[i]
    for i in range(n - 1, -1, -1):
        for c in range(i + 1, n):
            b[i] -= a[i, c] * b[c]
        b[i] /= a[i, i]
    return True


@njit(**INNER)
def _set_speed(motion, state, j, speed, h):
    """Set the iterate's speed of motor `j`, and the acceleration that leads there in the time `h`."""
    motion.speed[j] = speed
    motion.acceleration[j] = (speed - state.y[j]) / h


@njit(**INNER)
def _learn_slopes(terms, state, work, motion):
    """Estimate the slope of each joint's torque against its speed from the last two iterates."""
    mode, y = state.mode, motion.speed
    for j in range(len(mode)):
        moved = y[j] - work.old_speed[j]
        if mode[j] != 0 and work.old_mode[j] == mode[j] and abs(moved) > 1e-9 and not terms.coupled[j]:
            state.slope[j] = (work.high[j] - work.old_torque[j]) / moved
        work.old_speed[j], work.old_torque[j], work.old_mode[j] = y[j], work.high[j], mode[j]


@njit(**INNER)
def _forget_slopes(terms, gears, state, work, w):
    """Mark the slopes of load-dependent torques for measurement, and set the inertia behind rigid gears.

    Behind a rigid gear the links accelerate with the motors. So `work.inertia` is there the derivative of the
    load by the motors' accelerations; it is 0 elsewhere.
    """
    for j in range(len(state.mode)):
        if terms.loaded[j] and state.mode[j] != 0:
            state.slope[j] = np.nan
            work.old_mode[j] = 0
        for c in range(len(state.mode)):
            rigid = terms.loaded[j] and not (gears.flexible[j] or gears.flexible[c])
            work.inertia[j, c] = w.mass_matrix[j, c] if rigid else 0.0


@njit(**INNER)
def _load_links(state, work, motion, w, h):
    """Write the torque that the links need at the iterate into `motion.load`."""
    n = len(state.mode)
    for j in range(n):
        work.rate[j] = (work.x[j] - state.v[j]) / h
    for j in range(n):
        links = w.bias[j]
        for c in range(n):
            links += w.mass_matrix[j, c] * work.rate[c]
        motion.load[j] = links


@njit(**INNER)
def _balance(law, gears, state, work, motion, at):
    """Compute the torques of motors and gears; return the links' largest imbalance over its tolerance."""
    y, x = motion.speed, work.x
    missing = 0.0
    for j in range(len(state.mode)):
        ahead = work.ahead[j] - at * y[j]
        motor = work.fed[j] + law.stiffness[j] * ahead + law.damping[j] * (work.wanted[j] - y[j])
        work.free[j] = max(law.damping[j] + at * law.stiffness[j], 0.0)
        if abs(motor) > law.limit[j]:
            motor = np.copysign(law.limit[j], motor)
            work.free[j] = 0.0
        work.motor[j] = motor
        gear = motion.load[j]
        if gears.flexible[j]:
            gap = work.gap[j] + work.give[j] * (y[j] - x[j])
            gear = invert_deflection(gap, gears.compliance[j], gears.lost_motion[j], gears.mesh_torque[j])
            work.stiff[j] = work.give[j] / deflection_slope(
                gear, gears.compliance[j], gears.lost_motion[j], gears.mesh_torque[j]
            )
            work.residual[j] = gear - motion.load[j]
            missing = max(missing, abs(work.residual[j]) / gears.tolerance[j])
        else:
            work.residual[j] = 0.0
        work.need[j] = motor - gear - gears.armature[j] * motion.acceleration[j]
    return missing


@njit(**INNER)
def _release(gears, state, work, motion, single):
    """Release motors at rest whose torque exceeds what friction can hold; return whether there is one."""
    worst, beyond = -1, 0.0
    any_released = False
    for j in range(len(state.mode)):
        if state.mode[j] != 0:
            continue
        excess = max(work.need[j] - work.high[j], work.low[j] - work.need[j])
        if excess <= gears.tolerance[j]:
            continue
        any_released = True
        if not single:
            _let_go(state, work, motion, j)
        elif excess > beyond:
            worst, beyond = j, excess
    if single and worst >= 0:
        _let_go(state, work, motion, worst)
    return any_released


@njit(**INNER)
def _let_go(state, work, motion, j):
    """Let motor `j` move in the direction of its excess torque."""
    state.mode[j] = 1 if work.need[j] > work.high[j] else -1
    motion.sign[j] = state.mode[j]
    state.slope[j] = np.nan


@njit(**INNER)
def _correct(gears, terms, state, work, motion, w, h, ends):
    """Take one Newton step of the speeds; a motor that would reverse comes to rest.

    Returns the number of motors that came to rest, or -1 where the linear system is singular. In the middle
    of a part (not `ends`) only a motor that started at rest may come to rest; the part's end decides about
    the others.
    """
    n = len(state.mode)
    mass, mode, y, a, b = w.mass_matrix, state.mode, motion.speed, work.matrix, work.held
    for j in range(n):
        for c in range(n):
            a[j, c] = mass[j, c]
        inertia = gears.armature[j] / h
        damping = max(state.slope[j], -0.5 * (inertia + (0.0 if gears.flexible[j] else mass[j, j] / h)))
        motor = inertia + damping + work.free[j]
        if gears.flexible[j]:
            stiff = work.stiff[j]
            if mode[j] != 0:
                missing = work.need[j] - work.high[j]
                a[j, j] += h * stiff * motor / (motor + stiff)
                b[j] = h * (work.residual[j] + stiff * missing / (motor + stiff))
            else:
                a[j, j] += h * stiff
                b[j] = h * work.residual[j]
        elif mode[j] != 0:
            a[j, j] += h * motor
            b[j] = h * (work.need[j] - work.high[j])
            if terms.coupled[j] or work.inertia[j, j] > 0.0:
                for c in range(n):
                    if c != j:
                        a[j, c] += h * work.jacobian[j, c]
        else:
            b[j] = 0.0
    for j in range(n):
        if mode[j] == 0 and not gears.flexible[j]:
            for c in range(n):
                a[j, c] = 0.0
                a[c, j] = 0.0
            a[j, j] = 1.0
    if not _solve(a, b):
        return -1
    for j in range(n):
        work.change[j] = b[j]
        if gears.flexible[j]:
            work.change[j] = 0.0
            if mode[j] != 0:
                inertia = gears.armature[j] / h
                motor = inertia + max(state.slope[j], -0.5 * inertia) + work.free[j]
                missing = work.need[j] - work.high[j] + work.stiff[j] * b[j]
                work.change[j] = missing / (motor + work.stiff[j])
    share = _shorten(gears, state, work, motion)
    turned = 0
    for j in range(n):
        work.x[j] += share * b[j]
        if mode[j] == 0:
            continue
        speed = y[j] + share * work.change[j]
        if mode[j] * speed < 0.0 and (ends or state.y[j] == 0.0):
            speed = 0.0
            mode[j] = 0
            turned += 1
        _set_speed(motion, state, j, speed, h)
        motion.sign[j] = mode[j]
        if not gears.flexible[j]:
            work.x[j] = speed
    return turned


@njit(**INNER)
def _shorten(gears, state, work, motion):
    """Return the share of the Newton step in which each gear's torque changes about as its slope predicts.

    A gear stiffens where its lost motion is taken up, so that a full step from within the lost motion
    overshoots by far.
    """
    share = 1.0
    for j in range(len(state.mode)):
        if not gears.flexible[j] or gears.lost_motion[j] == 0.0:
            continue
        before = work.residual[j] + motion.load[j]
        for _ in range(40):
            speed = motion.speed[j] - work.x[j] + share * (work.change[j] - work.held[j])
            after = invert_deflection(
                work.gap[j] + work.give[j] * speed,
                gears.compliance[j],
                gears.lost_motion[j],
                gears.mesh_torque[j],
            )
            said = share * work.stiff[j] * (work.change[j] - work.held[j])
            if abs(after - before - said) <= 3.0 * abs(said) + gears.tolerance[j]:
                break
            share *= 0.5
    return share


@njit(**INNER)
def _look_ahead(gears, w, j, dt):
    """Return the time [s] by which a gear's deflection is predicted ahead, which keeps a stiff gear stable.

    The time is near zero for a gear whose oscillation the step resolves. For a gear too stiff to be resolved
    it is a whole step, as anything less would be unstable; in between it grows with the third power of the
    step.
    """
    rigidity = dt * dt / gears.compliance[j] * (gears.armature[j] + w.mass_matrix[j, j])
    return dt * rigidity / (rigidity + gears.armature[j] * w.mass_matrix[j, j])


@njit(**INNER)
def _begin(law, state, work, motion, gears, w, k, at, h, length, dt):
    """Set the first iterate from the previous part's accelerations, and the controller's torques."""
    n = len(state.mode)
    for j in range(n):
        position = state.q[j] + state.gap[j]
        motion.position[j] = position + at * state.y[j]
        work.ahead[j] = law.position[k, j] + at * law.speed[k, j] - position
        work.fed[j], work.wanted[j] = law.feedforward[k, j], law.speed[k, j]
        if at != 0.0:
            before, after = max(k - 1, 0), min(k + 1, len(law.speed) - 1)
            share = at / (dt * max(after - before, 1))
            work.fed[j] += share * (law.feedforward[after, j] - law.feedforward[before, j])
            work.wanted[j] += share * (law.speed[after, j] - law.speed[before, j])
        speed = 0.0
        if state.mode[j] != 0:
            speed = state.y[j] + h * (2.0 * state.a_motor[j] - state.a_before[j])
            if speed * state.mode[j] < 0.0:
                speed = state.y[j]
        _set_speed(motion, state, j, speed, h)
        motion.sign[j] = state.mode[j]
        work.x[j] = state.v[j] + h * state.a[j] if gears.flexible[j] else speed
        if gears.flexible[j]:
            slip = state.y[j] - state.v[j]
            ahead = _look_ahead(gears, w, j, dt)
            work.give[j] = ahead * length / h
            work.gap[j] = state.gap[j] + (at - h + 0.5 * length + ahead - work.give[j]) * slip
        work.old_mode[j] = 0


@njit(**INNER)
def _find_turn(state, work, motion):
    """Return the share of the part after which the first motor reverses, WHOLE where none does."""
    first = WHOLE
    for j in range(len(state.mode)):
        before = abs(state.y[j])
        after = state.mode[j] * (2.0 * motion.speed[j] - state.y[j])
        if before > 0.0 and after < -REST * (before - after):
            share = before / (before - after)
            if share < first:
                first = share
                work.turning[0] = j
    return first


@njit(**INNER)
def balance_part(
    rows, terms, law, gears, state, work, motion, w, k, at, h, t, dt, temperature, wear, may_trust, ends
):
    """Iterate until the torques balance.

    Successive steps converge alike. So the last rate of convergence tells whether one correction is enough
    without another evaluation of the effects: Hairer and Wanner, Solving Ordinary Differential Equations II,
    sec. IV.8.

    Parameters
    ----------
    at : float
        Instant of the balance, counted from the instant of the step's positions [s].
    h : float
        Instant of the balance, counted from the part's start [s].
    ends : bool
        Whether that instant is the part's end, where motors that reverse come to rest; otherwise it is the
        part's middle.

    Returns
    -------
    float
        WHOLE where no motor reverses; the share of the part after which motor `work.turning[0]` reverses;
        NO_BALANCE where the iteration does not converge.
    """
    _begin(law, state, work, motion, gears, w, k, at, h, h if ends else 2.0 * h, dt)
    work.inertia[:] = 0.0
    before, careful = 0.0, False
    for iteration in range(MAX_ITERATIONS):
        _load_links(state, work, motion, w, h)
        careful = careful or iteration > PATIENCE
        if careful:
            _forget_slopes(terms, gears, state, work, w)
        evaluate_terms(
            rows, terms, state.mode, state.y, state.slope, work.jacobian, work.inertia, motion, work.low,
            work.high, t, h, temperature, wear,
        )  # fmt: skip
        _learn_slopes(terms, state, work, motion)
        missing = _balance(law, gears, state, work, motion, at)
        for j in range(len(state.mode)):
            if state.mode[j] != 0:
                off = abs(work.need[j] - work.high[j]) / gears.tolerance[j]
                if not off < np.inf:
                    return NO_BALANCE
                missing = max(missing, off)
        if before > 0.0:
            state.pace[0], state.pace[1] = missing / before, 0.0
        if missing <= 1.0:
            # Only a balanced iterate gives the torque that holds a motor at rest.
            if not _release(gears, state, work, motion, careful):
                return WHOLE if ends else _find_turn(state, work, motion)
            before = 0.0
            continue
        turned = _correct(gears, terms, state, work, motion, w, h, ends)
        if turned < 0:
            if careful:
                return NO_BALANCE
            careful = True
            continue
        if not ends:
            for j in range(len(state.mode)):
                if motion.speed[j] * state.mode[j] < 0.0:
                    return _find_turn(state, work, motion)
        before = 0.0 if turned > 0 else missing
        sure = SAFETY * state.pace[0] * missing <= 1.0 and state.pace[1] < TRUST
        if may_trust and iteration == 0 and turned == 0 and sure:
            # A gear's torque costs little to evaluate and may be far from linear, so it is checked here.
            _load_links(state, work, motion, w, h)
            missing = _balance(law, gears, state, work, motion, at)
            if missing <= 1.0 and not _release(gears, state, work, motion, False):
                state.pace[1] += 1.0
                return WHOLE if ends else _find_turn(state, work, motion)
            before = 0.0
    return NO_BALANCE
