"""A strapdown navigator in Earth-fixed axes, and what it says when it begins or measures wrong.

Independent of the package: nothing is linearised, and nothing is done in local axes but
what the states and the outputs are. Central differences of it are rows.
"""

import numpy as np

SEMI_MAJOR, FLATTENING = 6378137.0, 1 / 298.257223563
E2 = FLATTENING * (2 - FLATTENING)
RATIO = 0.00344978650684
EARTH_RATE = 7.292115e-5
OFF_DIAGONAL = ("LF", "UF", "UL", "FL", "FU", "LU")


def axes(latitude, longitude):
    """North, west and up as columns, (..., 3, 3)."""
    (s, c), (sl, cl) = ((np.sin(x), np.cos(x)) for x in (latitude, longitude))
    north = np.stack([-s * cl, -s * sl, c], axis=-1)
    west = np.stack([sl, -cl, 0 * s], axis=-1)
    up = np.stack([c * cl, c * sl, s], axis=-1)
    return np.stack([north, west, up], axis=-1)


def to_ecef(latitude, longitude, height):
    s, c = np.sin(latitude), np.cos(latitude)
    normal = SEMI_MAJOR / np.sqrt(1 - E2 * s**2)
    level = (normal + height) * c
    z = (normal * (1 - E2) + height) * s
    return np.stack([level * np.cos(longitude), level * np.sin(longitude), z], axis=-1)


def to_geodetic(place):
    """Latitude, longitude and height, by iteration to rounding."""
    x, y, z = np.moveaxis(place, -1, 0)
    level = np.hypot(x, y)
    latitude = np.arctan2(z, level * (1 - E2))
    for _ in range(6):
        s = np.sin(latitude)
        normal = SEMI_MAJOR / np.sqrt(1 - E2 * s**2)
        latitude = np.arctan2(z + E2 * normal * s, level)
    s, c = np.sin(latitude), np.cos(latitude)
    normal = SEMI_MAJOR / np.sqrt(1 - E2 * s**2)
    # Of the two the one that does not divide by a small number, smoothly.
    height = level * c + z * s - SEMI_MAJOR**2 / normal
    return latitude, np.arctan2(y, x), height


def weight(latitude, height):
    """Somigliana's gravity, which falls with the height."""
    s = np.sin(latitude) ** 2
    ground = 9.7803253359 * (1 + 0.00193185265241 * s) / np.sqrt(1 - E2 * s)
    above = 1 - 2 / SEMI_MAJOR * (1 + FLATTENING + RATIO - 2 * FLATTENING * s) * height
    return ground * (above + 3 * height**2 / SEMI_MAJOR**2)


def turned(vector):
    """exp([vector x]) for vectors (..., 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    k = np.cross(vector[..., None, :], np.eye(3)).swapaxes(-1, -2)
    small = angle < 1e-12
    safe = np.where(small, 1.0, angle)
    first = np.where(small, 1.0, np.sin(safe) / safe)
    second = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    return np.eye(3) + first * k + second * k @ k


def times(matrix, vector):
    return (matrix @ vector[..., None])[..., 0]


def transposed(matrix):
    return matrix.swapaxes(-1, -2)


class Flight:
    """Level legs at a speed along the heading, each with constant rates of both.

    Parameters
    ----------
    legs : list of (duration, turn, change of speed)
    start : latitude, longitude, height, heading, speed
    """

    def __init__(self, legs, start, step):
        self.legs, self.start, self.step = legs, start, step
        self.count = round(sum(leg[0] for leg in legs) / step)
        # Places at every half step, as the steps of the navigator ask for them.
        place = np.array(start[:3])
        self.places = [place]
        half = step / 2
        for k in range(2 * self.count):
            t = k * half
            one = self._moving(t, place)
            two = self._moving(t + half / 2, place + half / 2 * one)
            three = self._moving(t + half / 2, place + half / 2 * two)
            four = self._moving(t + half, place + half * three, before=True)
            place = place + half / 6 * (one + 2 * two + 2 * three + four)
            self.places.append(place)

    def motion(self, t, *, before=False):
        """Heading, its rate, speed, its rate; `before`: of the leg that ends at t."""
        _, _, _, heading, speed = self.start
        begin = 0.0
        for k, (duration, turn, change) in enumerate(self.legs):
            inside = t < begin + duration - 1e-9 or (before and t < begin + duration + 1e-9)
            if inside or k == len(self.legs) - 1:
                part = (t - begin) / duration
                return (
                    heading + turn * part,
                    turn / duration,
                    speed + change * part,
                    (change / duration),
                )
            heading, speed, begin = heading + turn, speed + change, begin + duration
        raise AssertionError

    def _moving(self, t, place, *, before=False):
        heading, _, speed, _ = self.motion(t, before=before)
        latitude, _, height = place
        meridian, normal = radii(latitude, height)
        return np.array(
            [
                speed * np.cos(heading) / meridian,
                speed * np.sin(heading) / (normal * np.cos(latitude)),
                0.0,
            ]
        )

    def readings(self, k, *, before=False):
        """What perfect gyros and accelerometers say at the half step k."""
        t = k * self.step / 2
        heading, turning, speed, faster = self.motion(t, before=before)
        latitude, _, height = self.places[k]
        body = np.array(
            [
                [np.cos(heading), np.sin(heading), 0],
                [-np.sin(heading), np.cos(heading), 0],
                [0, 0, 1],
            ]
        )
        rates = self._moving(t, self.places[k], before=before)
        # The local axes turn with the longitude about the pole and with the latitude.
        transport = np.array([rates[1] * np.cos(latitude), rates[0], rates[1] * np.sin(latitude)])
        earth = EARTH_RATE * np.array([np.cos(latitude), 0, np.sin(latitude)])
        along, across = body[:, 0], body[:, 1]
        velocity = speed * along
        acceleration = faster * along - speed * turning * across
        gravity = np.array([0, 0, -weight(latitude, height)])
        force = acceleration + np.cross(2 * earth + transport, velocity) - gravity
        gyro = body.T @ (earth + transport) - np.array([0, 0, turning])
        return gyro, body.T @ force, body, velocity


def triad(x, kind, axis_names="FLU"):
    """The matrix of scale factors and misalignments in errors {name: (count,)}."""
    count = len(next(iter(x.values())))
    matrix = np.zeros((count, 3, 3))
    for i, row in enumerate(axis_names):
        for j, column in enumerate(axis_names):
            name = f"{kind}_scale_{row}" if i == j else f"{kind}_{row}{column}"
            matrix[:, i, j] = x.get(name, 0.0)
    return matrix


def vectors(x, names):
    count = len(next(iter(x.values())))
    return np.stack([np.zeros(count) + x.get(name, 0.0) for name in names], axis=-1)


def radii(latitude, height):
    """Of curvature plus height, in the meridian and across it."""
    w = np.sqrt(1 - E2 * np.sin(latitude) ** 2)
    return SEMI_MAJOR * (1 - E2) / w**3 + height, SEMI_MAJOR / w + height


SPIN = np.array([0, 0, EARTH_RATE])


class Navigator:
    """Navigators with errors x, {name: (count,)}, side by side."""

    def __init__(self, flight, x):
        self.flight, self.x = flight, x
        _, _, body, velocity = flight.readings(0)
        place = vectors(x, ["dL", "dlambda", "dh"]) + np.array(flight.places[0])
        local = axes(place[:, 0], place[:, 1])
        tilt, faster = (vectors(x, [f"{kind}_{axis}" for axis in "NWU"]) for kind in ("phi", "dV"))
        self.state = [
            local @ turned(-tilt) @ body,
            times(local, velocity + faster),
            to_ecef(*place.T),
        ]

    def measured(self, k, *, before=False):
        """What the gyros and the accelerometers say at the half step k."""
        gyro, force, _, _ = self.flight.readings(k, before=before)
        biases = (
            vectors(self.x, [f"{kind}_{axis}" for axis in "NWU"]) for kind in ("eps", "Delta")
        )
        matrices = triad(self.x, "gyro"), triad(self.x, "accel")
        return tuple(
            true + bias + matrix @ true
            for true, bias, matrix in zip((gyro, force), biases, matrices, strict=True)
        )

    def step(self, k, h):
        """From the step k to the next, by Runge and Kutta's method."""
        first, middle = self.measured(2 * k), self.measured(2 * k + 1)
        last = self.measured(2 * k + 2, before=True)

        def ahead(slope, h):
            return [value + h * rate for value, rate in zip(self.state, slope, strict=True)]

        one = slopes(*first, *self.state)
        two = slopes(*middle, *ahead(one, h / 2))
        three = slopes(*middle, *ahead(two, h / 2))
        four = slopes(*last, *ahead(three, h))
        self.state = [
            value + h / 6 * (a + 2 * b + 2 * c + d)
            for value, a, b, c, d in zip(self.state, one, two, three, four, strict=True)
        ]

    def said(self, gyro):
        """All outputs that there are."""
        attitude, velocity, position = self.state
        over_earth = gyro - times(transposed(attitude), SPIN)
        latitude, longitude, height = to_geodetic(position)
        here = axes(latitude, longitude)
        local_velocity = times(transposed(here), velocity)
        # Of the body against the local axes, which turn as they move.
        meridian, normal = radii(latitude, height)
        eastward = -local_velocity[:, 1] / normal
        transport = np.stack(
            [eastward, local_velocity[:, 0] / meridian, eastward * np.tan(latitude)], axis=-1
        )
        against = over_earth - times(transposed(attitude) @ here, transport)
        nose = times(transposed(here), attitude[..., 0])
        return {
            **self._of_the_antenna(over_earth),
            **self._of_the_wheels(against),
            "zero_velocity": local_velocity.T,
            "zero_angular_rate": against.T,
            "heading": np.arctan2(-nose[:, 1], nose[:, 0])[None],
        }

    def _of_the_antenna(self, over_earth):
        attitude, velocity, position = self.state
        arm = vectors(self.x, ["l_F", "l_L", "l_U"])
        place = to_geodetic(position + times(attitude, arm))
        moving = velocity + times(attitude, np.cross(over_earth, arm))
        seen = times(transposed(axes(*place[:2])), moving)
        return {"velocity": seen.T, "position": np.array(place)}

    def _of_the_wheels(self, against):
        attitude, velocity, _ = self.state
        arm = vectors(self.x, ["odo_l_F", "odo_l_L", "odo_l_U"])
        rolling = times(transposed(attitude), velocity) + np.cross(against, arm)
        mounting = turned(-vectors(self.x, ["none", "odo_pitch", "odo_yaw"]))
        rolling = times(mounting, rolling)
        scale = 1 + vectors(self.x, ["odo_scale"])[:, 0]
        return {"odometer": (rolling[:, 0] * scale)[None], "side_slip": rolling[:, 1:].T}


def slopes(gyro, force, attitude, velocity, position):
    """Of attitude, velocity and position, in axes that turn with the Earth."""
    latitude, longitude, height = to_geodetic(position)
    down = -weight(latitude, height)[:, None] * axes(latitude, longitude)[..., 2]
    turning = attitude @ np.cross(gyro[:, None, :], np.eye(3)).swapaxes(-1, -2)
    turning = turning - np.cross(SPIN, np.eye(3)).T @ attitude
    acceleration = times(attitude, force) + down - 2 * np.cross(SPIN, velocity)
    return turning, acceleration, velocity


def navigate(flight, x, outputs, every):
    """What navigators with errors x say that is measured, (samples, outputs, count)."""
    navigator = Navigator(flight, x)
    found = []
    for k in range(flight.count + 1):
        if k % every == 0:
            said = navigator.said(navigator.measured(2 * k, before=k == flight.count)[0])
            found.append(np.concatenate([said[name] for name in outputs]))
        if k < flight.count:
            navigator.step(k, flight.step)
    return np.array(found)


def rows(flight, names, steps, outputs, every):
    """Return d outputs / d errors (samples, outputs, n), by central differences."""
    n = len(names)
    moves = np.diag(steps)
    points = np.concatenate([moves, -moves, moves / 2, -moves / 2])
    x = dict(zip(names, points.T, strict=True))
    said = navigate(flight, x, outputs, every)
    wide = (said[..., :n] - said[..., n : 2 * n]) / (2 * np.asarray(steps))
    narrow = (said[..., 2 * n : 3 * n] - said[..., 3 * n :]) / np.asarray(steps)
    return (4 * narrow - wide) / 3
