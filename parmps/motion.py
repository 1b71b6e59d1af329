"""Motion of the tank, and the body force that it means for the liquid in the tank's own frame.

The equations are solved in the tank frame, where walls stand still. With X(r) = o + R r the earth position of
the tank-frame point r, a particle at r that moves at u relative to the tank feels, per unit mass,

    R^T (g - o'') - alpha x r - omega x (omega x r) - 2 omega x u

(rigid-body kinematics; Goldstein, Classical Mechanics, section 4.10), all in tank-frame components.
Vectors always have the three components x, y, z; in 2D the motion stays in the x-z plane.
"""

import math
import os
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from parmps.errors import InputError
from parmps.fields import nearest, show

AXIS = {"surge": 0, "sway": 1, "heave": 2, "roll": 0, "pitch": 1, "yaw": 2}
TRANSLATIONS = ("surge", "sway", "heave")
ROTATIONS = ("roll", "pitch", "yaw")
COLUMNS = {f"{kind} [m]": kind for kind in TRANSLATIONS} | {f"{kind} [deg]": kind for kind in ROTATIONS}
TIME_COLUMN = "time [s]"

MAX_FILE_BYTES = 64 * 2**20
MIN_ROWS = 4
MIN_INTERVAL = 1e-6  # s; closer rows would make the spline's derivatives meaningless
MAX_VALUE = 1e6  # s, m or deg


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
        axes = np.eye(3)  # one product with a matrix: in a tank that turns, each step asks for all particles
        turn = np.cross(self.alpha, axes) + np.cross(self.omega, np.cross(self.omega, axes))
        return self.force - position @ turn

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
    """The law amplitude sin(omega t + phase), at rest before t = 0.

    Parameters
    ----------
    amplitude : float
        m or rad.
    omega : float
        rad/s.
    phase : float
        rad.
    """

    def __init__(self, amplitude, omega, phase):
        self.amplitude, self.omega, self.phase = amplitude, omega, phase

    @property
    def still(self):
        """Whether the value never changes."""
        return self.amplitude * self.omega == 0.0

    def __call__(self, t):
        """Value and its first two time derivatives at t (s)."""
        if t < 0:
            return self.amplitude * np.sin(self.phase), 0.0, 0.0
        angle = self.omega * t + self.phase
        value = self.amplitude * np.sin(angle)
        return value, self.amplitude * self.omega * np.cos(angle), -(self.omega**2) * value


class Record:
    """A recorded signal as a cubic spline.

    Before its first row the tank rests at the first value, and before t = 0 at the value of t = 0. A record
    that begins after the start of the run sets out from rest (zero slope); one that begins with the run, or
    before, keeps the velocity of its data (not-a-knot ends), so that it may start with an impulse as the sine
    law does.

    Parameters
    ----------
    time : (n,) float64, s
    values : (n,) float64, m or rad
    """

    def __init__(self, time, values):
        first = (1, 0.0) if time[0] > 0 else "not-a-knot"
        spline = CubicSpline(time, values, bc_type=(first, "not-a-knot"))
        self._start = max(time[0], 0.0)
        self._laws = spline, spline.derivative(1), spline.derivative(2)
        self.still = bool(np.ptp(values) == 0.0)

    def __call__(self, t):
        """Value and its first two time derivatives at t (s)."""
        if t < self._start:
            return float(self._laws[0](self._start)), 0.0, 0.0
        return tuple(float(law(t)) for law in self._laws)


class Motion:
    """Superposed motions of the tank.

    Surge, sway and heave are summed along the tank-fixed axes and applied first (innermost); then come roll
    about x, pitch about y and yaw about z, each about its own centre, which is given in the tank at rest and
    stays fixed in the frame outside it. Turns of the same kind are applied in the order listed. In 2D, roll
    and pitch both turn about y, positive when the right side goes down.

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
        self._translations = []
        turns = {kind: [] for kind in ROTATIONS}
        for number, item in enumerate(items):
            for kind, law in _laws(item, f"motion[{number}].path"):
                if kind in TRANSLATIONS:
                    self._translations.append((AXIS[kind], law))
                else:
                    axis = AXIS["pitch"] if dimension == 2 else AXIS[kind]
                    turns[kind].append((axis, _xyz(item.centre or tank.bottom_centre), law))
        self._turns = [turn for kind in ROTATIONS for turn in turns[kind]]

    @property
    def moves(self):
        """Whether the tank ever moves; without, the body force is constant."""
        return self.rotates or any(not law.still for _, law in self._translations)

    @property
    def rotates(self):
        """Whether the tank ever turns; without, the body force is uniform."""
        return any(not law.still for _, _, law in self._turns)

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
        for axis, centre, law in self._turns:
            frame = _turn(axis, centre, *law(t)).after(frame)
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


def _laws(item, key):
    """List the (kind, law) pairs of one motion item; angles in rad."""
    if item.kind == "file":
        time, columns = read_motion_file(item.path, key)
        return [
            (kind, Record(time, np.radians(values) if kind in ROTATIONS else values))
            for kind, values in columns.items()
        ]
    amplitude = np.radians(item.amplitude_deg) if item.kind in ROTATIONS else item.amplitude
    return [(item.kind, Sine(amplitude, item.omega, np.radians(item.phase_deg)))]


def _xyz(point):
    """Three components of a 2D (x, z) or 3D point."""
    return np.array([point[0], 0.0, point[1]] if len(point) == 2 else point, dtype=float)


def _cross(a, b):
    """Cross product of two 3-vectors; numpy's own costs ten times as much for a single pair."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _translation(translations, t):
    """Sum the displacements of an unturned frame."""
    derivatives = np.zeros((3, 3))
    for axis, law in translations:
        derivatives[:, axis] += law(t)
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
    omegas = {item.omega for item in items if item.omega > 0.0}
    return 2.0 * math.pi / omegas.pop() if len(omegas) == 1 else None


def read_motion_file(path, key="motion"):
    """Read a recorded motion.

    Parameters
    ----------
    path : str
        CSV file with one header row: ``time [s]`` and at least one of ``surge [m]``, ``sway [m]``,
        ``heave [m]``, ``roll [deg]``, ``pitch [deg]``, ``yaw [deg]``, in any order. Blank lines and lines that
        begin with ``#`` are passed over.
    key : str
        Key of the job file that names it, for messages.

    Returns
    -------
    time : (n,) float64, s
    columns : dict of str to (n,) float64
        Values by kind of motion, m or deg.

    Raises
    ------
    InputError
        Names the file, line and column that cannot be used.
    """
    lines = _read_lines(path, key)
    header_line, header = next(lines, (1, []))
    names = [name.strip() for name in header]
    _check_header(names, f"{path}, line {header_line}", key)
    rows = []
    for number, cells in lines:
        where = f"{path}, line {number}"
        if len(cells) != len(names):
            raise InputError(key, f"{where}: got {len(cells)} values, must be {len(names)} as in the header")
        row = [_cell(cell, f"{where}, column '{name}'", key) for name, cell in zip(names, cells, strict=True)]
        time = row[names.index(TIME_COLUMN)]
        if rows and time - rows[-1][names.index(TIME_COLUMN)] < MIN_INTERVAL:
            raise InputError(
                key,
                f"{where}, column '{TIME_COLUMN}': got {time:g}, must grow by {MIN_INTERVAL:g} s or more",
            )
        rows.append(row)
    if len(rows) < MIN_ROWS:
        raise InputError(key, f"{path}: got {len(rows)} rows of values, must be at least {MIN_ROWS}")
    table = dict(zip(names, np.array(rows).T, strict=True))
    time = table.pop(TIME_COLUMN)
    return time, {COLUMNS[name]: values for name, values in table.items()}


def _read_lines(path, key):
    """Yield line number and cells of each line that is neither blank nor a comment."""
    if not os.path.isfile(path):
        raise InputError(key, f"{path}: no such file")
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise InputError(key, f"{path}: cannot be read: {error.strerror}") from None
    if len(data) > MAX_FILE_BYTES:
        raise InputError(key, f"{path}: must be at most {MAX_FILE_BYTES // 2**20} MiB")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(key, f"{path}, line {line}: not UTF-8 text") from None
    lines = enumerate(text.split("\n"), 1)
    return ((number, line.split(",")) for number, line in lines if line.strip() and not line.lstrip().startswith("#"))


def _check_header(names, where, key):
    allowed = [TIME_COLUMN, *COLUMNS]
    for number, name in enumerate(names):
        if name not in allowed:
            raise InputError(key, f"{where}: unknown column {show(name)}{nearest(name, allowed)}")
        if name in names[:number]:
            raise InputError(key, f"{where}: column '{name}' is given twice")
    if TIME_COLUMN not in names or len(names) < 2:
        raise InputError(key, f"{where}: the header row must name '{TIME_COLUMN}' and at least one motion")


def _cell(text, where, key):
    """Convert one cell of a motion file to a number."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    # float() also takes digit groups such as 1_000, which no CSV writer means
    if "_" in text or not abs(value) <= MAX_VALUE:
        raise InputError(key, f"{where}: got {show(text.strip())}, must be a number of at most {MAX_VALUE:g}")
    return value
