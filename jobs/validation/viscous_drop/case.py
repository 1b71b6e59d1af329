"""Decay and period of a free drop's second mode against the exact linear theory of viscous liquid."""

import numpy as np
import viscous
from scipy.optimize import curve_fit, root
from scipy.special import iv

from parmps.tank import place

TITLE = "Viscous drop"
SPACINGS = (0.01, 0.005)
STRETCH = 0.02
"""Amplitude over the radius, without decay."""
VARIANTS = {f"{nu:g} m2/s": [f"fluids[0].kinematic_viscosity={nu}"] for nu in (3e-4, 1e-3, 3e-3)}
NOT_IN_PAPERS = tuple(VARIANTS)
TARGETS = {"decay [%]": (10.0, 5.0), "period [%]": (3.0, 1.0)}


def vibration(radius, tension, viscosity, n=2):
    """Mode n of a plane drop, as exp(s t) with complex s.

    The stream function (r^n + b I_n(q r)) sin(n theta) exp(s t), q^2 = s / nu, has no shear stress at r = R: psi'' -
    psi' / R + n^2 psi / R^2 = 0. Its first part is a potential flow, whose pressure is - rho s r^n cos(n theta)
    exp(s t). At R, p - 2 mu d v_r / dr is the tension's pressure sigma (n^2 - 1) / R^2 times the elevation v_r / s
    (as for spheres: Chandrasekhar, Hydrodynamic and Hydromagnetic Stability, section 98).

    Parameters
    ----------
    radius : float, m
    tension : float, m3/s2
        Over the density.
    viscosity : float, m2/s
    n : int

    Returns
    -------
    complex
        s: the decay rate is - Re s, the angular frequency Im s, 1/s.
    callable
        Of r: v_r without cos(n theta) and v_theta without sin(n theta), for an elevation of 1 at t = 0.
    """

    def functions(r, q):
        """r^n and I_n(q r), both 1 at R, with two derivatives."""
        power = np.array([r**n, n * r ** (n - 1), n * (n - 1) * r ** (n - 2)]) / radius**n
        near, slope = iv(n, q * r), 0.5 * q * (iv(n - 1, q * r) + iv(n + 1, q * r))
        return power, np.array([near, slope, (q * q + n * n / r**2) * near - slope / r]) / iv(n, q * radius)

    def solution(s):
        power, bessel = functions(radius, np.sqrt(s / viscosity))
        shear = [f[2] - f[1] / radius + n * n * f[0] / radius**2 for f in (power, bessel)]
        share = -shear[0] / shear[1]
        return share, power + share * bessel

    def residual(parts):
        s = complex(*parts)
        _, psi = solution(s)
        normal = s + 2.0 * viscosity * n * (psi[1] / radius - psi[0] / radius**2)
        balance = s * normal + tension * n * (n * n - 1) / radius**3 * psi[0]
        return balance.real, balance.imag

    inviscid = np.sqrt(n * (n * n - 1) * tension / radius**3)
    s = complex(*root(residual, (-2 * n * (n - 1) * viscosity / radius**2, inviscid), tol=1e-12).x)
    share, at_surface = solution(s)

    def flow(r):
        power, bessel = functions(r, np.sqrt(s / viscosity))
        psi = (power + share * bessel) * s * radius / (n * at_surface[0])
        return n * psi[0] / r, -psi[1]

    return s, flow


def theory(job):
    """As `vibration`, of a job's drop."""
    oil = job.fluids[0]
    return vibration(oil.region.disc.radius, oil.surface_tension / oil.density, oil.kinematic_viscosity)


def initial(job):
    """The particles of the job with the velocity of the second mode as its elevation passes zero."""
    placement = place(job, "half")
    position = placement.position[: placement.total_fluid]
    x, _, z = (position - position.mean(axis=0)).T
    angle, amplitude = np.arctan2(z, x), STRETCH * job.fluids[0].region.disc.radius
    radial, turning = theory(job)[1](np.maximum(np.hypot(x, z), 1e-9))
    radial, turning = amplitude * radial.imag * np.cos(2 * angle), amplitude * turning.imag * np.sin(2 * angle)
    velocity = np.zeros_like(position)
    velocity[:, 0] = radial * np.cos(angle) - turning * np.sin(angle)
    velocity[:, 2] = radial * np.sin(angle) + turning * np.cos(angle)
    return position, velocity


def stretch(results):
    """Second moment along x less that along z: (frames,) float64, m2."""
    moments = [np.var(results.liquid(time)["position"], axis=0) for time in results.frames]
    return np.array([x - z for x, _, z in moments])


def full_stretch(job):
    """Stretch of the mode without decay, m2: the elevation a cos(2 theta) has R a."""
    return STRETCH * job.fluids[0].region.disc.radius ** 2


def fit(results):
    """Parameters of `swing` in a run; the mean is what the lattice leaves of the drop's roundness."""
    signal, (s, _) = stretch(results), theory(results.job)
    return curve_fit(viscous.swing, results.frames, signal, [signal.max(), -s.real, s.imag, 0.0, 0.0])[0]


def measure(results):
    """Errors of decay and period."""
    found = fit(results)
    amplitude = 100.0 * (found[0] / full_stretch(results.job) - 1.0)
    return viscous.errors(theory(results.job)[0], found) | {"amplitude [%]": amplitude}


def plot(figure, runs):
    """Stretch over time, and theory."""

    def scaled(results):
        return stretch(results) / full_stretch(results.job)

    def exact(results, time):
        return np.exp(theory(results.job)[0] * time).imag

    viscous.plot(figure, runs, VARIANTS, scaled, exact, ("theory", "Stretch over its amplitude without decay"))
