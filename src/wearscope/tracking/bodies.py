"""Mass and place of a small body that was added to a link, or taken from it."""

import numpy as np
from scipy import optimize

#: Masses that are tried, as multiples of the least one that its moment allows, and steps a decade.
_MOST, _STEPS = 1e3, 24
#: Usual radius of a body about its own centre, as a share of the arm's reach.
_OWN = 0.05
#: Usual mass of a body, over the prior standard deviation of a link's mass.
_HEAVY = 3.0
#: Rise of the misfit at the ends of a 95 % interval of one parameter.
_RISE = 3.84


def point_parameters(mass: float, place: np.ndarray, radius: float = 0.0) -> np.ndarray:
    """Inertial parameters (10,) of a round body, as the regressor of a rigid body orders them.

    `radius` is that of gyration about its own centre.
    """
    x, y, z = place
    own = radius**2
    inertia = (y * y + z * z + own, -x * y, x * x + z * z + own, -x * z, -y * z, x * x + y * y + own)
    return mass * np.array([1.0, x, y, z, *inertia])


def weigh_point(
    value: np.ndarray, covariance: np.ndarray, prior: np.ndarray, reach: float
) -> tuple[float, float, float, np.ndarray]:
    """Mass of a body with its 95 % interval, and its place.

    The interval is that of the profile likelihood: place and own radius are fitted for each mass, the one
    within the arm's reach, the other within a share of it.

    Parameters
    ----------
    value, covariance : ndarray (10,), (10, 10)
        Inertial parameters of a body that was fitted with the prior.
    prior : ndarray (10,)
        Prior precision of the parameters, which is taken out.
    reach : float
        [m]

    Returns
    -------
    mass, low, high : float
        [kg]; negative where a body was taken away.
    place : ndarray (3,)
        In the link's frame [m].
    """
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    precision = np.linalg.pinv(covariance / np.outer(scale, scale), rcond=1e-9, hermitian=True)
    precision /= np.outer(scale, scale)
    goal = precision @ value
    size, vector = np.linalg.eigh(precision - np.diag(prior))
    keep = size > 1e-6 * size.max()
    root = np.sqrt(size[keep])[:, None] * vector[:, keep].T
    wanted = (vector[:, keep].T @ goal) / np.sqrt(size[keep])
    moment = float(np.linalg.norm(value[1:4]))
    least = max(moment / reach, 0.02 * abs(value[0]), 1e-9)
    masses = least * np.geomspace(0.5, _MOST, int(_STEPS * np.log10(2.0 * _MOST)))
    # Nobody adds much more than the heaviest link weighs: that decides where the motion does not.
    usual = np.sqrt(prior[0]) / _HEAVY
    found = []
    for sign in (1.0, -1.0):
        place = sign * value[1:4] / masses[0]
        place = np.append(place * min(1.0, reach / max(float(np.linalg.norm(place)), 1e-12)), _OWN * reach)
        tried = []
        for mass in sign * masses:

            def miss(c: np.ndarray, m: float = mass) -> np.ndarray:
                far = [*(2.0 * c[:3] / reach), c[3] / (_OWN * reach), usual * m]
                return np.concatenate([root @ point_parameters(m, c[:3], c[3]) - wanted, far])

            fit = optimize.least_squares(miss, place)
            place = fit.x
            tried.append((2.0 * fit.cost, mass, place))
        found.append(tried)
    # What a motion does not tell from an added body is none that was taken away.
    added, removed = (min(cost for cost, _, _ in tried) for tried in found)
    chosen = found[1] if removed < added - _RISE else found[0]
    cost, mass, place = min(chosen, key=lambda one: one[0])
    ends = [m for c, m, _ in chosen if c <= cost + _RISE]
    step = 10.0 ** (0.5 / _STEPS)
    low, high = sorted(
        [mass / abs(mass) * min(map(abs, ends)) / step, mass / abs(mass) * max(map(abs, ends)) * step]
    )
    return float(mass), float(low), float(high), place[:3]
