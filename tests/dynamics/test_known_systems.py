"""Systems of which the literature says what their outputs determine, by rows and by jets.

The null spaces of models with unknown parameters are those of their scaling symmetries; each
is named beside its system.
"""

import numpy as np
import pytest

import gramian as gm

POPULATION = 1000.0


def array(*parts):
    return np.array(parts)


def prey(t, x):
    u, v, a, b, c, d = x
    return array(a * u - b * u * v, -c * v + d * u * v, *(0 * x[2:]))


def epidemic(t, x):
    s, i, beta, gamma = x[:4]
    infected = beta * s * i / POPULATION
    return array(-infected, infected - gamma * i, *(0 * x[2:]))


def mass_action(t, x):
    s, i, beta, gamma = x[:4]
    return array(-beta * s * i, beta * s * i - gamma * i, *(0 * x[2:]))


def latent(t, x):
    s, e, i, beta, sigma, gamma = x[:6]
    infected = beta * s * i / POPULATION
    return array(-infected, infected - sigma * e, sigma * e - gamma * i, *(0 * x[3:]))


def voltage(t):
    return 1 + np.sin(2 * t) + np.sin(5 * t)


def motor(t, x):
    i, w, r, inductance, k, inertia, b = x
    return array((voltage(t) - r * i - k * w) / inductance, (k * i - b * w) / inertia, *(0 * x[2:]))


def shaft(t, x):
    w, k, inertia, b = x
    return array((k * voltage(t) - b * w) / inertia, *(0 * x[1:]))


def pendulum(t, x):
    return array(x[1], -x[2] / x[3] * np.sin(x[0]), *(0 * x[2:]))


def van_der_pol(t, x):
    return array(x[1], x[2] * (1 - x[0] ** 2) * x[1] - x[0], 0 * x[0])


def lorenz(t, x):
    a, b, c, s, r, d = x
    return array(s * (b - a), a * (r - c) - b, a * b - d * c, *(0 * x[3:]))


def steering(t):
    return 0.03 * np.sin(1.5 * t) + 0.02 * np.sin(4 * t)


def forces(t, x):
    slip, yaw, _, _, front, rear = x
    return (
        front * (steering(t) - (slip + 1.2 * yaw) / 15),
        -rear * (slip - 1.5 * yaw) / 15,
    )


def bicycle(t, x):
    front, rear = forces(t, x)
    turning = (1.2 * front - 1.5 * rear) / x[3]
    return array((front + rear) / x[2] - 15 * x[1], turning, *(0 * x[2:]))


def yaw_and_acceleration(t, x):
    front, rear = forces(t, x)
    return array(x[1], (front + rear) / x[2])


def orbit(t, x):
    cubed = (x[0] ** 2 + x[1] ** 2) ** 1.5
    return array(x[2], x[3], -x[4] * x[0] / cubed, -x[4] * x[1] / cubed, 0 * x[0])


def reactor(t, x):
    ca, temperature, log_k, energy, heat, feed = x
    rate = np.exp(log_k - energy * (1 / temperature - 1 / 350)) * ca
    cooled = (300 + 10 * np.sin(t)) - temperature - 2 * (temperature - 290)
    return array(feed - ca - rate, cooled + heat * rate, *(0 * x[2:]))


def compartments(t, x):
    a, b, k21, k12, k01, k02 = x
    fed = np.sin(t) + 2
    return array(-(k21 + k01) * a + k12 * b + fed, k21 * a - (k12 + k02) * b, *(0 * x[2:]))


def enzyme(t, x):
    return array(-x[1] * x[0] / (x[2] + x[0]), *(0 * x[1:]))


def neuron(t, x):
    v, w, e, a, b = x
    return array(v - v**3 / 3 - w + 0.5, e * (v + a - b * w), *(0 * x[2:]))


def first(t, x):
    return x[:1]


def second(t, x):
    return x[1:2]


def third(t, x):
    return x[2:3]


def reported(t, x):
    return x[-1:] * x[1:2]


def reported_late(t, x):
    return x[-1:] * x[2:3]


def part(t, x):
    return x[-1:] * x[:1]


def both(t, x):
    return x[:2]


def radius(t, x):
    return array(np.sqrt(x[0] ** 2 + x[1] ** 2))


def slope(t, x):
    return array(x[1] / x[0])


PREY = [10.0, 5, 1.1, 0.4, 0.4, 0.1]
DC = [0.1, 0.2, 1.0, 0.5, 0.3, 0.2, 0.1]
CHAOS = [1.0, 2, 20, 10, 28, 8 / 3]
SPACE = [1.0, 0, 0.1, 1.1, 1.0]
#: f, h, x0, duration, samples, dimension of what is not determined.
SYSTEMS = {
    # b with the scale of the predator.
    "prey of Lotka-Volterra": (prey, first, PREY, 10, 40, 1),
    "prey and predator": (prey, both, PREY, 10, 40, 0),
    # S, I, 1 / beta and 1 / k: the reporting rate is not identifiable.
    "epidemic, unknown reporting": (epidemic, reported, [900.0, 10, 0.5, 0.2, 0.3], 60, 61, 1),
    "the same by mass action": (mass_action, reported, [900.0, 10, 5e-4, 0.2, 0.3], 60, 61, 1),
    "epidemic, all reported": (epidemic, second, [900.0, 10, 0.5, 0.2], 60, 61, 0),
    "latent, unknown reporting": (
        latent, reported_late, [900.0, 20, 10, 0.5, 0.3, 0.2, 0.3], 80, 81, 1,
    ),
    "latent, all reported": (latent, third, [900.0, 20, 10, 0.5, 0.3, 0.2], 80, 81, 0),
    # Three coefficients of the transfer function and two states, of seven unknowns.
    "motor by its speed": (motor, second, DC, 10, 80, 2),
    "motor by current and speed": (motor, both, DC, 10, 80, 0),
    "shaft of unknown inertia": (shaft, first, [0.2, 0.3, 0.2, 0.1], 10, 50, 1),
    "pendulum: g / l": (pendulum, first, [1.0, 0, 9.8, 2.0], 5, 30, 1),
    "van der Pol": (van_der_pol, first, [2.0, 0, 1.0], 10, 60, 0),
    "Lorenz by x": (lorenz, first, CHAOS, 2, 60, 0),
    # (x, y) and (-x, -y) are alike: two points, no direction.
    "Lorenz by z": (lorenz, third, CHAOS, 2, 60, 0),
    # Mass, inertia and both stiffnesses scale together.
    "bicycle with slip": (
        bicycle, yaw_and_acceleration, [0.1, 0.05, 1500, 2500, 8e4, 9e4], 5, 80, 1,
    ),
    # The angle; and r with the cube root of mu.
    "orbit by radius": (orbit, radius, SPACE, 6, 60, 1),
    "orbit by angle": (orbit, slope, SPACE, 1, 40, 1),
    # Concentration and feed with the heat of reaction.
    "stirred reactor": (reactor, second, [0.5, 320, 0, 3000, 200, 1.0], 5, 60, 1),
    # Two losses, one too many (Bellman & Astrom 1970).
    "two compartments": (compartments, first, [1.0, 0.5, 0.5, 0.3, 0.2, 0.1], 15, 60, 1),
    "Michaelis-Menten": (enzyme, part, [2.0, 1, 2, 0.7], 4, 40, 1),
    "FitzHugh-Nagumo": (neuron, first, [0.1, 0.2, 0.08, 0.7, 0.8], 40, 120, 0),
}  # fmt: skip


@pytest.mark.parametrize("name", SYSTEMS)
def test_rows_tell_what_is_known_of_the_system(name):
    f, h, x0, duration, samples, lost = SYSTEMS[name]
    path = gm.dynamics.from_ode(f, h, x0, np.linspace(0, duration, samples))
    answer = gm.analyze(path.problem())
    assert answer.nullity == lost
    assert answer.status == ("unobservable" if lost else answer.status)
    assert path.windows(duration).rank[0] == len(x0) - lost


@pytest.mark.parametrize("name", SYSTEMS)
def test_jets_tell_the_same(name):
    f, h, x0, _, _, lost = SYSTEMS[name]
    found = gm.dynamics.lie_derivatives(f, h, x0, time=0.37, order=len(x0) + 2)
    assert len(x0) - found.generic_ranks[-1] == lost
    assert len(x0) - found.ranks[-1] == lost


def test_a_point_without_motion_tells_less():
    # On the z axis of Lorenz' system x and y stay zero: z and its rate are all there is.
    path = gm.dynamics.from_ode(lorenz, third, [0.0, 0, *CHAOS[2:]], np.linspace(0, 1, 20))
    assert gm.analyze(path.problem()).nullity == 4
    found = gm.dynamics.lie_derivatives(lorenz, third, [0.0, 0, *CHAOS[2:]], order=8)
    assert (found.ranks[-1], found.generic_ranks[-1]) == (2, 6)


def quadrotor(thrust, rate):
    def f(t, x):
        q, u, w = x[3:7], x[4:7], rate(t)
        force = np.array([0.0, 0, thrust(t)])
        force = force + 2 * np.cross(u, q[0] * force + np.cross(u, force))
        turning = 0.5 * np.concatenate([[-(u @ w)], q[0] * w + np.cross(u, w)])
        return np.concatenate([x[7:10], turning, force - [0, 0, 9.81]])

    return f


def test_a_hovering_quadrotor_hides_its_yaw():
    start, free = [0.0, 0, 0, 1, 0, 0, 0, 0.1, 0.2, 0], gm.dynamics.unit_norm([3, 4, 5, 6])
    times = np.linspace(0, 2, 20)
    hover = quadrotor(lambda t: 9.81, lambda t: np.zeros(3))
    moving = quadrotor(
        lambda t: 9.81 + np.sin(t), lambda t: array(0.5 * np.cos(2 * t), 0.4 * np.sin(3 * t), 0.3)
    )
    for f, lost in ((hover, 1), (moving, 0)):
        path = gm.dynamics.from_ode(f, lambda t, x: x[:3], start, times, tangent=free)
        assert gm.analyze(path.problem()).nullity == lost
