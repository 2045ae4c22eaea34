"""Compiled mass matrix and bias torque of a kinematic tree, in spatial vectors about one common origin.

All spatial vectors are taken about the world's origin, (angular, linear), so that they add from link to link
without being transformed: Featherstone, Rigid Body Dynamics Algorithms, 2008, secs. 5.3 (recursive
Newton-Euler) and 6.2 (composite rigid bodies).
"""

from collections import namedtuple

import numpy as np
from numba import njit

from wearscope.simulation.arrays import INNER
from wearscope.simulation.chain import Chain


class Scratch(
    namedtuple(
        "Scratch",
        "turn place screw velocity acceleration force start_force composite mass_matrix bias start_bias",
    )
):
    """Arrays that `mass_and_bias` works in; its results: `mass_matrix` (n, n), `bias`, `start_bias` (n,)."""


def make_scratch(n: int) -> Scratch:
    """Scratch arrays for `n` joints, all 0."""
    z = np.zeros
    return Scratch(
        turn=z((n, 9)),
        place=z((n, 3)),
        screw=z((n, 6)),
        velocity=z((2, n, 6)),
        acceleration=z((2, n, 6)),
        force=z((n, 6)),
        start_force=z((n, 6)),
        composite=z((n, 10)),
        mass_matrix=z((n, n)),
        bias=z(n),
        start_bias=z(n),
    )


@njit(cache=True, **INNER)
def _place(chain: Chain, q, w, j):
    """Orientation, origin and screw of joint `j` in the world."""
    p = chain.parent[j]
    offset, own, axis = chain.offset, chain.turn, chain.axis
    ux, uy, uz = axis[j, 0], axis[j, 1], axis[j, 2]
    if chain.prismatic[j]:
        s, c = 0.0, 1.0
        ox = offset[j, 0] + q[j] * (own[j, 0, 0] * ux + own[j, 0, 1] * uy + own[j, 0, 2] * uz)
        oy = offset[j, 1] + q[j] * (own[j, 1, 0] * ux + own[j, 1, 1] * uy + own[j, 1, 2] * uz)
        oz = offset[j, 2] + q[j] * (own[j, 2, 0] * ux + own[j, 2, 1] * uy + own[j, 2, 2] * uz)
    else:
        s, c = np.sin(q[j]), np.cos(q[j])
        ox, oy, oz = offset[j, 0], offset[j, 1], offset[j, 2]
    d = 1.0 - c
    r00, r01, r02 = c + ux * ux * d, ux * uy * d - uz * s, ux * uz * d + uy * s
    r10, r11, r12 = uy * ux * d + uz * s, c + uy * uy * d, uy * uz * d - ux * s
    r20, r21, r22 = uz * ux * d - uy * s, uz * uy * d + ux * s, c + uz * uz * d
    turn, place, screw = w.turn, w.place, w.screw
    for i in range(3):
        # Row i of the parent's orientation times the joint's own.
        if p < 0:
            a0, a1, a2 = own[j, i, 0], own[j, i, 1], own[j, i, 2]
            place[j, i] = ox if i == 0 else (oy if i == 1 else oz)
        else:
            b0, b1, b2 = turn[p, 3 * i], turn[p, 3 * i + 1], turn[p, 3 * i + 2]
            a0 = b0 * own[j, 0, 0] + b1 * own[j, 1, 0] + b2 * own[j, 2, 0]
            a1 = b0 * own[j, 0, 1] + b1 * own[j, 1, 1] + b2 * own[j, 2, 1]
            a2 = b0 * own[j, 0, 2] + b1 * own[j, 1, 2] + b2 * own[j, 2, 2]
            place[j, i] = place[p, i] + b0 * ox + b1 * oy + b2 * oz
        turn[j, 3 * i] = a0 * r00 + a1 * r10 + a2 * r20
        turn[j, 3 * i + 1] = a0 * r01 + a1 * r11 + a2 * r21
        turn[j, 3 * i + 2] = a0 * r02 + a1 * r12 + a2 * r22
    zx = turn[j, 0] * ux + turn[j, 1] * uy + turn[j, 2] * uz
    zy = turn[j, 3] * ux + turn[j, 4] * uy + turn[j, 5] * uz
    zz = turn[j, 6] * ux + turn[j, 7] * uy + turn[j, 8] * uz
    if chain.prismatic[j]:
        screw[j, 0], screw[j, 1], screw[j, 2] = 0.0, 0.0, 0.0
        screw[j, 3], screw[j, 4], screw[j, 5] = zx, zy, zz
    else:
        px, py, pz = place[j, 0], place[j, 1], place[j, 2]
        screw[j, 0], screw[j, 1], screw[j, 2] = zx, zy, zz
        screw[j, 3] = py * zz - pz * zy
        screw[j, 4] = pz * zx - px * zz
        screw[j, 5] = px * zy - py * zx


@njit(cache=True, **INNER)
def _place_inertia(chain: Chain, w, j):
    """Mass, first moment and tensor (xx, xy, xz, yy, yz, zz) of link `j` about the world's origin."""
    t, c, tensor, m, g = w.turn, chain.com, chain.tensor, chain.mass[j], w.composite
    cx = w.place[j, 0] + t[j, 0] * c[j, 0] + t[j, 1] * c[j, 1] + t[j, 2] * c[j, 2]
    cy = w.place[j, 1] + t[j, 3] * c[j, 0] + t[j, 4] * c[j, 1] + t[j, 5] * c[j, 2]
    cz = w.place[j, 2] + t[j, 6] * c[j, 0] + t[j, 7] * c[j, 1] + t[j, 8] * c[j, 2]
    xx, xy, xz = tensor[j, 0, 0], tensor[j, 0, 1], tensor[j, 0, 2]
    yy, yz, zz = tensor[j, 1, 1], tensor[j, 1, 2], tensor[j, 2, 2]
    k = 4
    for i in range(3):
        a0, a1, a2 = t[j, 3 * i], t[j, 3 * i + 1], t[j, 3 * i + 2]
        b0 = a0 * xx + a1 * xy + a2 * xz
        b1 = a0 * xy + a1 * yy + a2 * yz
        b2 = a0 * xz + a1 * yz + a2 * zz
        for l in range(i, 3):  # noqa: E741
            g[j, k] = b0 * t[j, 3 * l] + b1 * t[j, 3 * l + 1] + b2 * t[j, 3 * l + 2]
            k += 1
    g[j, 0], g[j, 1], g[j, 2], g[j, 3] = m, m * cx, m * cy, m * cz
    g[j, 4] += m * (cy * cy + cz * cz)
    g[j, 5] -= m * cx * cy
    g[j, 6] -= m * cx * cz
    g[j, 7] += m * (cx * cx + cz * cz)
    g[j, 8] -= m * cy * cz
    g[j, 9] += m * (cx * cx + cy * cy)


@njit(cache=True, **INNER)
def _apply_inertia(g, j, x0, x1, x2, x3, x4, x5):
    """Spatial inertia (10,) times a motion vector, (moment, force)."""
    m, hx, hy, hz = g[j, 0], g[j, 1], g[j, 2], g[j, 3]
    return (
        g[j, 4] * x0 + g[j, 5] * x1 + g[j, 6] * x2 + hy * x5 - hz * x4,
        g[j, 5] * x0 + g[j, 7] * x1 + g[j, 8] * x2 + hz * x3 - hx * x5,
        g[j, 6] * x0 + g[j, 8] * x1 + g[j, 9] * x2 + hx * x4 - hy * x3,
        m * x3 + x1 * hz - x2 * hy,
        m * x4 + x2 * hx - x0 * hz,
        m * x5 + x0 * hy - x1 * hx,
    )


@njit(cache=True, **INNER)
def _newton_euler(chain: Chain, qd, w, v, a, f, j):
    """Velocity of link `j`, its acceleration at zero joint acceleration, and the force that it needs."""
    p = chain.parent[j]
    s = w.screw
    rate = qd[j]
    x0, x1, x2, x3, x4, x5 = (
        s[j, 0] * rate,
        s[j, 1] * rate,
        s[j, 2] * rate,
        s[j, 3] * rate,
        s[j, 4] * rate,
        s[j, 5] * rate,
    )
    if p < 0:
        u0, u1, u2, u3, u4, u5 = x0, x1, x2, x3, x4, x5
        a[j, 0], a[j, 1], a[j, 2] = 0.0, 0.0, 0.0
        a[j, 3], a[j, 4], a[j, 5] = -chain.gravity[0], -chain.gravity[1], -chain.gravity[2]
    else:
        u0, u1, u2, u3, u4, u5 = (
            v[p, 0] + x0,
            v[p, 1] + x1,
            v[p, 2] + x2,
            v[p, 3] + x3,
            v[p, 4] + x4,
            v[p, 5] + x5,
        )
        a[j, 0] = a[p, 0] + u1 * x2 - u2 * x1
        a[j, 1] = a[p, 1] + u2 * x0 - u0 * x2
        a[j, 2] = a[p, 2] + u0 * x1 - u1 * x0
        a[j, 3] = a[p, 3] + u1 * x5 - u2 * x4 + u4 * x2 - u5 * x1
        a[j, 4] = a[p, 4] + u2 * x3 - u0 * x5 + u5 * x0 - u3 * x2
        a[j, 5] = a[p, 5] + u0 * x4 - u1 * x3 + u3 * x1 - u4 * x0
    v[j, 0], v[j, 1], v[j, 2], v[j, 3], v[j, 4], v[j, 5] = u0, u1, u2, u3, u4, u5
    n0, n1, n2, l0, l1, l2 = _apply_inertia(w.composite, j, u0, u1, u2, u3, u4, u5)
    f0, f1, f2, f3, f4, f5 = _apply_inertia(
        w.composite, j, a[j, 0], a[j, 1], a[j, 2], a[j, 3], a[j, 4], a[j, 5]
    )
    f[j, 0] = f0 + u1 * n2 - u2 * n1 + u4 * l2 - u5 * l1
    f[j, 1] = f1 + u2 * n0 - u0 * n2 + u5 * l0 - u3 * l2
    f[j, 2] = f2 + u0 * n1 - u1 * n0 + u3 * l1 - u4 * l0
    f[j, 3] = f3 + u1 * l2 - u2 * l1
    f[j, 4] = f4 + u2 * l0 - u0 * l2
    f[j, 5] = f5 + u0 * l1 - u1 * l0


@njit(cache=True, **INNER)
def _project(s, f, j):
    """Force or torque along joint `j`: product of its screw axis and a spatial force."""
    return (
        s[j, 0] * f[j, 0]
        + s[j, 1] * f[j, 1]
        + s[j, 2] * f[j, 2]
        + s[j, 3] * f[j, 3]
        + s[j, 4] * f[j, 4]
        + s[j, 5] * f[j, 5]
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def mass_and_bias(chain: Chain, q, qd, start, w):
    """Write the mass matrix and the Coriolis, centrifugal and gravity torque at two speeds into `w`.

    Parameters
    ----------
    chain : Chain
    q, qd, start : ndarray (n,)
    w : Scratch
        Receives `mass_matrix` [kg m^2 or kg], and `bias` at `qd` and `start_bias` at `start` [N m or N].
    """
    n = len(q)
    mass, s, g = w.mass_matrix, w.screw, w.composite
    for i in range(n):
        j = chain.order[i]
        _place(chain, q, w, j)
        _place_inertia(chain, w, j)
        _newton_euler(chain, qd, w, w.velocity[0], w.acceleration[0], w.force, j)
        _newton_euler(chain, start, w, w.velocity[1], w.acceleration[1], w.start_force, j)
    for i in range(n - 1, -1, -1):
        j = chain.order[i]
        p = chain.parent[j]
        w.bias[j] = _project(s, w.force, j)
        w.start_bias[j] = _project(s, w.start_force, j)
        y0, y1, y2, y3, y4, y5 = _apply_inertia(g, j, s[j, 0], s[j, 1], s[j, 2], s[j, 3], s[j, 4], s[j, 5])
        k = j
        while k >= 0:
            entry = s[k, 0] * y0 + s[k, 1] * y1 + s[k, 2] * y2 + s[k, 3] * y3 + s[k, 4] * y4 + s[k, 5] * y5
            mass[j, k] = entry
            mass[k, j] = entry
            k = chain.parent[k]
        if p >= 0:
            for k in range(6):
                w.force[p, k] += w.force[j, k]
                w.start_force[p, k] += w.start_force[j, k]
            for k in range(10):
                g[p, k] += g[j, k]
