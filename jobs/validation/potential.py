"""Potential flow in a rectangular tank: the references of the wave cases.

Tank frame, x along the tank and y across, elevation z = 0 at the still level. Everything even about the walls:
functions of x are cosine series, k_n = n pi / length; of x and y, double ones. A surging tank adds the body force
-X''(t), a swaying one -Y''(t).
"""

import math

import numpy as np
from scipy.fft import dct, dctn, idctn, idst


def wave_number(mode, length):
    """k_n = n pi / length, rad/m."""
    return mode * np.pi / length


def frequency(mode, length, depth, gravity):
    """Linear angular frequency of a standing wave, rad/s: omega^2 = g k tanh(k h) (Lamb, Hydrodynamics, 228)."""
    k = wave_number(mode, length)
    return np.sqrt(gravity * k * np.tanh(k * depth))


def finite_amplitude_frequency(amplitude, length, depth, gravity):
    """Angular frequency of the first standing mode at finite amplitude, rad/s.

    omega = omega_0 + (k a)^2 omega_2 / 2 with omega_2 = (9 w^-7 - 12 w^-3 - 3 w - 2 w^5) / 32 in units of
    sqrt(g k), w = sqrt(tanh k h) (Tadjbakhsh & Keller 1960, J. Fluid Mech. 8:442).

    Parameters
    ----------
    amplitude : float
        Of the first mode, m.
    length, depth : float
        m.
    gravity : float
        m/s2.
    """
    k = wave_number(1, length)
    w = math.sqrt(math.tanh(k * depth))
    second = (9.0 * w**-7 - 12.0 * w**-3 - 3.0 * w - 2.0 * w**5) / 32.0
    return math.sqrt(gravity * k) * (w + 0.5 * (k * amplitude) ** 2 * second)


def viscous_decay(mode, length, depth, gravity, viscosity):
    """Decay rate of the amplitude of a standing wave, 1/s: bulk, and boundary layers at bottom and end walls.

    Bulk: 2 nu k^2 (Lamb, Hydrodynamics, 348). Layers: the mean of the power (rho/2) sqrt(nu omega / 2) u^2 per area
    over twice the wave's energy (Keulegan 1959, J. Fluid Mech. 6:33).

    Parameters
    ----------
    mode : int
    length, depth : float
        m.
    gravity : float
        m/s2.
    viscosity : float
        Kinematic, m2/s.

    Returns
    -------
    bulk, layers : float
        1/s.
    """
    k, omega = wave_number(mode, length), frequency(mode, length, depth, gravity)
    # for a surface amplitude of 1: u = omega cosh(kz)/sinh(kh) sin(kx) at the bottom, w = omega sinh(kz)/sinh(kh)
    bottom = (omega / math.sinh(k * depth)) ** 2 * length / 2.0
    ends = 2.0 * (omega / math.sinh(k * depth)) ** 2 * (math.sinh(2 * k * depth) / (4.0 * k) - depth / 2.0)
    energy = gravity * length / 4.0
    power = 0.5 * math.sqrt(viscosity * omega / 2.0) * (bottom + ends)
    return 2.0 * viscosity * k * k, power / (2.0 * energy)


def surge_response(x, time, length, depth, gravity, amplitude, omega, phase=0.0, modes=60):
    """Linear elevation in a tank that starts from rest with X = amplitude sin(omega t + phase), m.

    With x - L/2 = sum c_n cos(k_n x), c_n = -4 / (L k_n^2) for odd n, each mode obeys
    b'' + omega_n^2 b = -k_n tanh(k_n h) c_n X'', b = 0 and b' = -k_n tanh(k_n h) c_n X'(0) at the start, where the
    tank's velocity jumps (Faltinsen & Timokha, Sloshing, 2009, ch. 5).

    Parameters
    ----------
    x, time : float and (n,) float64
        m and s.
    length, depth : float
        m.
    gravity : float
        m/s2.
    amplitude, omega, phase : float
        m, rad/s, rad.
    modes : int
        Number of the highest mode.
    """
    eta = np.zeros_like(time)
    for n in range(1, modes + 1, 2):
        k, own = wave_number(n, length), frequency(n, length, depth, gravity)
        gain = 4.0 * math.tanh(k * depth) / (length * k)
        # b = p sin(omega t + phase) + q cos(own t) + r sin(own t)
        p = -gain * amplitude * omega**2 / (own**2 - omega**2)
        q = -p * math.sin(phase)
        r = (gain * amplitude * omega * math.cos(phase) - p * omega * math.cos(phase)) / own
        mode = p * np.sin(omega * time + phase) + q * np.cos(own * time) + r * np.sin(own * time)
        eta += mode * math.cos(k * x)
    return eta


class PotentialFlow:
    """Fully nonlinear waves by the high-order spectral method (West et al. 1987, J. Geophys. Res. 92:11803).

    Parameters
    ----------
    length, depth : float
        m.
    gravity : float
        m/s2.
    order : int
        Of the expansion in the steepness; 1 is linear theory.
    modes : int
        Cosine modes along each side that are kept; products are evaluated on a grid of four times as many points.
    width : float, optional
        m; of a tank in 3D.

    Attributes
    ----------
    x : (points,) float64, m
        Along the tank; (points, 1) in 3D, where y is (1, points).
    eta, potential : (points,) or (points, points) float64
        Elevation, m, and the potential at the surface, m2/s.
    """

    def __init__(self, length, depth, gravity, order=5, modes=48, width=None):
        self.depth, self.gravity, self.order, self.modes = depth, gravity, order, modes
        self.points = 4 * modes
        self._sides = (length,) if width is None else (length, width)
        n = np.arange(self.points)
        self._k = self._outer([wave_number(n, side) for side in self._sides])
        self.k = np.sqrt(sum(k**2 for k in self._k))
        self._at = self._outer([(n + 0.5) * side / self.points for side in self._sides])
        self.x, self.y = self._at[0], self._at[-1]
        # a smooth cut of the shortest waves, which a breaking crest would feed without end
        cut = np.exp(-36.0 * (n / modes) ** 16) * (n <= modes)
        self.keep = math.prod(self._outer([cut] * len(self._sides)))
        self.eta = np.zeros_like(self.k)
        self.potential = np.zeros_like(self.k)

    def _outer(self, rows):
        """Arrays (points,), one a side, so that they broadcast to the grid."""
        return np.meshgrid(*rows, indexing="ij", sparse=True)

    def _slope(self, f, side):
        """Derivative along a side, a sine series, of a cosine series."""
        sines = np.roll(-self._k[side] * dct(f, type=2, axis=side), -1, axis=side)
        np.moveaxis(sines, side, 0)[-1] = 0.0
        return idst(sines, type=2, axis=side)

    def _slopes(self, f):
        return [self._slope(f, side) for side in range(len(self._sides))]

    def _filtered(self, f):
        return idctn(self.keep * dctn(f, type=2), type=2)

    def _vertical(self, f, count):
        """Vertical derivatives of order 0 .. count at z = 0 of the potential with the values f there."""
        c = self.keep * dctn(f, type=2)
        rise = np.tanh(self.k * self.depth)
        return [idctn(c * self.k**m * (rise if m % 2 else 1.0), type=2) for m in range(count + 1)]

    def _vertical_velocity(self, eta, potential):
        parts, derivatives = [potential], []
        power = [eta**m / math.factorial(m) for m in range(self.order + 1)]
        for m in range(self.order):
            if m:
                parts.append(-sum(power[j] * derivatives[m - j][j] for j in range(1, m + 1)))
            derivatives.append(self._vertical(parts[m], self.order - m))
        terms = ((m, j) for m in range(self.order) for j in range(m + 1))
        return sum(power[j] * derivatives[m - j][j + 1] for m, j in terms)

    def _rates(self, eta, potential, acceleration):
        w = self._vertical_velocity(eta, potential)
        forcing = -self.gravity * eta
        for at, side, a in zip(self._at, self._sides, np.atleast_1d(acceleration), strict=True):
            forcing = forcing - a * (at - side / 2.0)
        if self.order == 1:
            return self._filtered(w), self._filtered(forcing)
        slope, along = self._slopes(eta), self._slopes(potential)
        stretch = 1.0 + sum(s**2 for s in slope)
        first = w * stretch - sum(a * s for a, s in zip(along, slope, strict=True))
        second = forcing - 0.5 * sum(a**2 for a in along) + 0.5 * stretch * w**2
        return self._filtered(first), self._filtered(second)

    def run(self, times, step, acceleration=None):
        """Advance by the classical Runge-Kutta method.

        Parameters
        ----------
        times : (n,) float64
            When to keep the elevation, ascending from 0, s.
        step : float
            Longest time step, s.
        acceleration : function, optional
            Of the tank along its sides, m/s2, of time in s: a number, or two in 3D.

        Returns
        -------
        (n, modes) or (n, modes, modes) float64
            Cosine coefficients of the elevation, m; see `elevation`.
        """
        force = acceleration or (lambda t: np.zeros(len(self._sides)))
        now, kept = 0.0, []
        for until in times:
            count = math.ceil((until - now) / step - 1e-9)
            dt = (until - now) / max(count, 1)
            for _ in range(count):
                e, p = self.eta, self.potential
                a = self._rates(e, p, force(now))
                b = self._rates(e + 0.5 * dt * a[0], p + 0.5 * dt * a[1], force(now + 0.5 * dt))
                c = self._rates(e + 0.5 * dt * b[0], p + 0.5 * dt * b[1], force(now + 0.5 * dt))
                d = self._rates(e + dt * c[0], p + dt * c[1], force(now + dt))
                self.eta = e + dt / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
                self.potential = p + dt / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
                now += dt
            now = until
            kept.append(self._coefficients())
        return np.array(kept)

    def _coefficients(self):
        coefficients = dctn(self.eta, type=2) / self.points ** len(self._sides)
        for side in range(len(self._sides)):
            np.moveaxis(coefficients, side, 0)[0] *= 0.5
        return coefficients[(slice(self.modes),) * len(self._sides)]

    def elevation(self, coefficients, x):
        """Elevation at x of a 2D tank from the coefficients that `run` returned, m: (n,) float64."""
        return coefficients @ np.cos(self.k[: coefficients.shape[1]] * x)
