"""Motion of the tank, and the body force that it means for the liquid in the tank's own frame.

The equations are solved in the tank frame, where walls stand still. With X(r) = o + R r the earth position of
the tank-frame point r, a particle at r that moves at u relative to the tank feels, per unit mass,

    R^T (g - o'') - alpha x r - omega x (omega x r) - 2 omega x u

(rigid-body kinematics; Goldstein, Classical Mechanics, section 4.10), all in tank-frame components.
Vectors always have the three components x, y, z; in 2D the motion stays in the x-z plane.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from parmps.curves import Curve
from parmps.records import ROTATIONS, TRANSLATIONS, read_motion_file, state_of
from parmps.rounding import steady_clock

AXIS = {"surge": 0, "sway": 1, "heave": 2, "roll": 0, "pitch": 1, "yaw": 2}
STANDARD_GRAVITY = 9.80665
"""m/s2, in which accelerations are told."""
LOOKS = 720
"""Times in a period of a law at which its extremes are looked for: within 1e-5 of them."""


class FrameState(NamedTuple):
    """Motion of the tank frame at one instant.

    Attributes
    ----------
    rotation : (3, 3) float64
        Takes tank-frame components to earth-frame components.
    omega, alpha : (3,) float64, rad/s and rad/s2
        Angular velocity and acceleration, tank-frame components.
    force : (3,) float64, m/s2
        Uniform part of the body force, R^T (g - o''), tank-frame components.
    velocity : (3,) float64, m/s
        Velocity of the tank-frame origin, R^T o', tank-frame components.
    origin : (3,) float64, m
        Earth position of the tank-frame origin.
    """

    rotation: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray
    force: np.ndarray
    velocity: np.ndarray
    origin: np.ndarray

    def velocity_at(self, position):
        """Velocity of points fixed to the tank, tank-frame components.

        Parameters
        ----------
        position : (..., 3) float64, m
            Tank frame.

        Returns
        -------
        (..., 3) float64, m/s
        """
        return self.velocity + np.cross(self.omega, position)

    def force_at(self, position):
        """Body force on what rests in the tank, tank-frame components.

        Parameters
        ----------
        position : (..., 3) float64, m
            Tank frame.

        Returns
        -------
        (..., 3) float64, m/s2
        """
        return self.force - position @ self.turn()

    def turn(self):
        """Matrix T of the force -r T by which the body force changes with the place r: (3, 3) float64, 1/s2."""
        axes = np.eye(3)  # one product with a matrix: in a tank that turns, each step asks for all particles
        return np.cross(self.alpha, axes) + np.cross(self.omega, np.cross(self.omega, axes))

    def greatest_force(self, corners):
        """Greatest body force in the tank, which is at one of its corners.

        Parameters
        ----------
        corners : (m, 3) float64, m
            `Motion.corners`.

        Returns
        -------
        float
            m/s2.
        """
        return float(np.linalg.norm(self.force_at(corners), axis=1).max())


class RigidMotion(NamedTuple):
    """A moving frame seen from an outer frame: X(r) = origin + rotation r, with first and second derivatives.

    Attributes
    ----------
    rotation : (3, 3) float64
    origin, velocity, acceleration : (3,) float64, m, m/s, m/s2
        Of the inner frame's origin, outer components.
    omega, alpha : (3,) float64, rad/s, rad/s2
        Angular velocity and acceleration, outer components.
    """

    rotation: np.ndarray
    origin: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    omega: np.ndarray
    alpha: np.ndarray

    def after(self, inner):
        """Compose with a motion inside this frame: ``(self after inner)(r) = self(inner(r))``.

        The acceleration holds the Euler, centrifugal and Coriolis terms of the inner origin.

        Parameters
        ----------
        inner : RigidMotion

        Returns
        -------
        RigidMotion
        """
        arm = self.rotation @ inner.origin
        slip = self.rotation @ inner.velocity
        swing = _cross(self.omega, arm)
        spin = self.rotation @ inner.omega
        return RigidMotion(
            rotation=self.rotation @ inner.rotation,
            origin=self.origin + arm,
            velocity=self.velocity + swing + slip,
            acceleration=self.acceleration
            + _cross(self.alpha, arm)
            + _cross(self.omega, swing + 2.0 * slip)
            + self.rotation @ inner.acceleration,
            omega=self.omega + spin,
            alpha=self.alpha + _cross(self.omega, spin) + self.rotation @ inner.alpha,
        )


class Sine:
    """The law amplitude sin(omega t + phase), times a smooth ramp if there is one; at rest before t = 0.

    The ramp 10 s^3 - 15 s^4 + 6 s^5, s = t / ramp, has two continuous derivatives and begins from rest.

    Parameters
    ----------
    amplitude : float
        m or rad.
    omega : float
        rad/s.
    phase : float
        rad.
    ramp : float
        s; 0 for none.
    """

    def __init__(self, amplitude, omega, phase, ramp=0.0):
        self.amplitude, self.omega, self.phase, self.ramp = amplitude, omega, phase, ramp

    @property
    def still(self):
        """Whether the value never changes."""
        return self.amplitude * self.omega == 0.0 and self.amplitude * np.sin(self.phase) * self.ramp == 0.0

    def __call__(self, t):
        """Value and its first two time derivatives at t (s)."""
        if t < 0:
            return self.amplitude * np.sin(self.phase) * (self.ramp == 0.0), 0.0, 0.0
        angle = self.omega * t + self.phase
        value = self.amplitude * np.sin(angle)
        rate = self.amplitude * self.omega * np.cos(angle)
        acceleration = -(self.omega**2) * value
        if t >= self.ramp:
            return value, rate, acceleration
        s = t / self.ramp
        share = s**3 * (10.0 + s * (6.0 * s - 15.0))
        first = 30.0 * (s * (1.0 - s)) ** 2 / self.ramp
        second = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / self.ramp**2
        return (
            share * value,
            share * rate + first * value,
            share * acceleration + 2.0 * first * rate + second * value,
        )

    def history(self, end):
        """Value and its first two derivatives, (3, n), at times up to the end (s) that have all extremes."""
        period = 2.0 * np.pi / self.omega if self.omega else 0.0
        until = min(end, self.ramp + period)
        periods = min(max(until / period, 1.0), 100.0) if period else 1.0
        return np.array([self(t) for t in np.linspace(0.0, until, int(LOOKS * periods) + 1)]).T


class Record:
    """A recorded signal as a curve with two continuous derivatives.

    Before its first row the tank rests at the first value, and before t = 0 at the value of t = 0. A record
    that begins after the start of the run sets out from rest; one that begins with the run, or before, keeps the
    velocity of its data, so that it may start with an impulse as the sine law does.

    Parameters
    ----------
    time : (n,) float64, s
    values : (n,) float64
    start : float
        Time in the record at which the run begins, s.
    unit : float
        Of the values, m or rad.
    """

    def __init__(self, time, values, start=0.0, unit=1.0):
        late = time[0] - start > 0.5 * (time[1] - time[0])  # not only by the rounding of its times
        self.curve = Curve(time, values, rests=late)
        self._shift, self._unit = start, unit
        self._begin = self.curve.nodes.time[0] if late else start
        self.still = bool(np.ptp(values) == 0.0)

    def __call__(self, t):
        """Value and its first two time derivatives at t (s)."""
        time = t + self._shift
        if t < 0.0 or time < self._begin:
            return self._unit * float(self.curve(self._begin)[0]), 0.0, 0.0
        return tuple((self._unit * self.curve(time)).tolist())

    def history(self, end):
        """Value and its first two derivatives, (3, n), at times up to the end (s) that have all extremes."""
        last = end + self._shift
        nodes = self.curve.nodes.time
        nodes = np.concatenate([[self._begin], nodes[(nodes > self._begin) & (nodes < last)], [last]])
        between = nodes[:-1, None] + np.diff(nodes)[:, None] * np.arange(4) / 4
        return self._unit * self.curve(np.append(between.ravel(), last))


@lru_cache(maxsize=16)
def _record(path, key, kind, start, backwards, _state):
    """One column of a motion file in one state; checks, plan and run all ask for it."""
    table = read_motion_file(path, key)
    unit = np.pi / 180.0 if kind in ROTATIONS else 1.0
    return Record(steady_clock(table.time), table.columns[kind], start, -unit if backwards else unit)


class Part(NamedTuple):
    """One displacement or turn among those of a motion.

    Attributes
    ----------
    number : int
        Of the item in the job's list.
    kind : str
        surge, sway, heave, roll, pitch or yaw.
    axis : int
    centre : (3,) float64 or None, m
        Of a turn.
    law : Sine or Record
    arm : float
        Distance of the tank's farthest corner from the axis of a turn, m.
    """

    number: int
    kind: str
    axis: int
    centre: np.ndarray | None
    law: object
    arm: float

    def extremes(self, end):
        """Find how far and fast it goes.

        Parameters
        ----------
        end : float
            s; from the start of the run on.

        Returns
        -------
        value, rate, acceleration : float
            Greatest, m or rad and s.
        felt : float
            Greatest acceleration of a corner of the tank, m/s2.
        """
        value, rate, acceleration = np.abs(self.law.history(end))
        felt = acceleration if self.centre is None else self.arm * np.hypot(acceleration, rate**2)
        return float(value.max()), float(rate.max()), float(acceleration.max()), float(felt.max())


class Motion:
    """Superposed motions of the tank.

    Surge, sway and heave are summed along the tank-fixed axes and applied first (innermost); then come roll
    about x, pitch about y and yaw about z, each about its own centre, which is given in the tank at rest and
    stays fixed in the frame outside it. Turns of the same kind are applied in the order listed. In 2D, roll
    and pitch both turn about y, positive when the right side goes down, and sway is surge. OpenFOAM's tables, which
    have another order, come last.

    Parameters
    ----------
    items : sequence of Translation, Rotation or MotionFile
    gravity : float
        m/s2; acts along -z of the earth frame.
    dimension : int
    tank : Tank
        Its bottom centre is the centre of turns that name none.

    Attributes
    ----------
    corners : (m, 3) float64, m
        Of the box around the tank.

    Raises
    ------
    InputError
        A motion file cannot be used.
    """

    def __init__(self, items, gravity, dimension, tank):
        self._gravity = np.array([0.0, 0.0, -gravity])
        size = tank.size if dimension == 3 else (tank.length, 0.0, tank.height)
        self.corners = np.stack(np.meshgrid(*[(0.0, side) for side in size]), axis=-1).reshape(-1, 3)
        self.parts, self._translations, turns, self._outer = [], [], [], []
        for number, item in enumerate(items):
            laws, outer = _laws(item, f"motion[{number}].path", dimension)
            parts = [self._part(number, item, kind, law, dimension, tank) for kind, law in laws]
            self.parts += parts
            if outer:
                self._outer += [parts]
                continue
            self._translations += [part for part in parts if part.centre is None]
            turns += [part for part in parts if part.centre is not None]
        self._turns = sorted(turns, key=lambda part: ROTATIONS.index(part.kind))

    def _part(self, number, item, kind, law, dimension, tank):
        axis = AXIS[kind]
        if dimension == 2:
            axis = {"sway": AXIS["surge"], "roll": AXIS["pitch"]}.get(kind, axis)
        if kind in TRANSLATIONS:
            return Part(number, kind, axis, None, law, 0.0)
        centre = _xyz(item.centre or tank.bottom_centre)
        arm = np.linalg.norm(np.delete(self.corners - centre, axis, axis=1), axis=1).max()
        return Part(number, kind, axis, centre, law, float(arm))

    @property
    def moves(self):
        """Whether the tank ever moves; without, the body force is constant."""
        return any(not part.law.still for part in self.parts)

    @property
    def rotates(self):
        """Whether the tank ever turns; without, the body force is uniform."""
        return any(not part.law.still for part in self.parts if part.centre is not None)

    def at(self, t):
        """State of the tank frame at a time.

        Parameters
        ----------
        t : float
            s. Before 0 the tank is at rest where the laws put it at t = 0.

        Returns
        -------
        FrameState
        """
        frame = _translation(self._translations, t)
        for part in self._turns:
            frame = _turn(part.axis, part.centre, *part.law(t)).after(frame)
        for parts in self._outer:
            for part in reversed([part for part in parts if part.centre is not None]):
                frame = _turn(part.axis, part.centre, *part.law(t)).after(frame)
            frame = _translation([part for part in parts if part.centre is None], t).after(frame)
        to_tank = frame.rotation.T
        return FrameState(
            rotation=frame.rotation,
            omega=to_tank @ frame.omega,
            alpha=to_tank @ frame.alpha,
            force=to_tank @ (self._gravity - frame.acceleration),
            velocity=to_tank @ frame.velocity,
            origin=frame.origin,
        )

    def initial_velocity(self, position):
        """Velocity relative to the tank, at t = 0, of liquid at rest in the earth frame.

        The tank of a sine law starts with a velocity jump that the liquid does not follow.

        Parameters
        ----------
        position : (..., 3) float64, m
            Tank frame.

        Returns
        -------
        (..., 3) float64, m/s
        """
        return -self.at(0.0).velocity_at(position)


def _laws(item, key, dimension):
    """List the (kind, law) pairs of one motion item, and tell whether they are in OpenFOAM's order."""
    if item.kind != "file":
        amplitude = np.radians(item.amplitude_deg) if item.kind in ROTATIONS else item.amplitude
        return [(item.kind, Sine(amplitude, item.rate, np.radians(item.phase_deg), item.ramp))], False
    table, state = read_motion_file(item.path, key), state_of(item.path, key)
    # OpenFOAM's roll turns y towards z; in 2D its plane y-z is ours, where a positive turn takes z towards x
    flat = dimension == 2 and table.outer
    kinds = [kind for kind, values in table.columns.items() if not flat or np.any(values)]
    return [
        (kind, _record(item.path, key, kind, item.start or 0.0, flat and kind == "roll", state)) for kind in kinds
    ], table.outer


def _xyz(point):
    """Three components of a 2D (x, z) or 3D point."""
    return np.array([point[0], 0.0, point[1]] if len(point) == 2 else point, dtype=float)


def _cross(a, b):
    """Cross product of two 3-vectors; numpy's own costs ten times as much for a single pair."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _translation(parts, t):
    """Sum the displacements of an unturned frame."""
    derivatives = np.zeros((3, 3))
    for part in parts:
        derivatives[:, part.axis] += part.law(t)
    return RigidMotion(np.eye(3), *derivatives, omega=np.zeros(3), alpha=np.zeros(3))


def _turn(axis, centre, angle, rate, acceleration):
    """Rigid motion of a turn about a coordinate axis through a fixed centre (right-hand rule)."""
    direction = np.eye(3)[axis]
    rotation = _axis_rotation(axis, angle)
    arm = -(rotation @ centre)
    omega, alpha = rate * direction, acceleration * direction
    swing = _cross(omega, arm)
    return RigidMotion(
        rotation=rotation,
        origin=centre + arm,
        velocity=swing,
        acceleration=_cross(alpha, arm) + _cross(omega, swing),
        omega=omega,
        alpha=alpha,
    )


def _axis_rotation(axis, angle):
    """Rotation matrix about a coordinate axis."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.eye(3)
    rotation[j, j] = rotation[k, k] = cos
    rotation[j, k], rotation[k, j] = -sin, sin
    return rotation


def forcing_period(items):
    """Period of a motion whose sines have one frequency.

    Parameters
    ----------
    items : sequence of motion items
        As in a job.

    Returns
    -------
    float or None
        s; None for a recorded motion, for several frequencies, and for none.
    """
    if any(item.kind == "file" for item in items):
        return None
    rates = {item.rate for item in items if item.rate > 0.0}
    return 2.0 * math.pi / rates.pop() if len(rates) == 1 else None
