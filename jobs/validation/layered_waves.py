"""Linear response of layered liquids to the motion of their tank, on top of `parmps.waves`.

In the tank's frame the liquid of density rho feels, per mass, the tilt g theta along x and the Euler force
-theta'' x r (theta positive: right end down), both of first order. By virtual displacements along the potential flow
phi = Z(z) cos(k x) of each layer, M a'' + K a = Q with Q = sum rho int f . grad phi over half the length; what of
the flow has vorticity moves no boundary. For odd modes, with w = Z' and the brackets taken from the bottom to the
top of a layer,

    Q = sum rho (4 / (L k^2)) { theta'' [(z - z_c) w - 2 Z] - g theta [w] }.

A tank that starts with an angular velocity gives the liquid the impulse of theta'' at once.
"""

import numpy as np
from scipy.integrate import solve_ivp

from parmps import waves


def forcing(layers, k, length, centre_height):
    """Q per theta'' and per theta: two (free,) float64, in kg/m and kg/(m s2)."""
    n = len(layers.depth)
    bottom = np.concatenate([[0.0], np.cumsum(layers.depth)])
    euler, tilt = np.zeros(layers.free), np.zeros(layers.free)
    for j in range(layers.free):
        w = np.zeros(n + 1)
        w[j + 1] = 1.0
        for i in range(n):
            kh = k * layers.depth[i]
            top = (w[i + 1] * np.cosh(kh) - w[i]) / (k * np.sinh(kh))
            base = (w[i + 1] - w[i] * np.cosh(kh)) / (k * np.sinh(kh))
            moment = (bottom[i + 1] - centre_height) * w[i + 1] - (bottom[i] - centre_height) * w[i]
            scale = 4.0 * layers.density[i] / (length * k * k)
            euler[j] += scale * (moment - 2.0 * (top - base))
            tilt[j] -= scale * layers.gravity * (w[i + 1] - w[i])
    return euler, tilt


def roll_response(layers, length, amplitude, omega, centre_height, times, modes=15, damping=0.0, power=0):
    """Elevations of the layers' tops at the left wall, in the tank, after theta = amplitude sin(omega t).

    Parameters
    ----------
    layers : parmps.waves.Layers
    length : float, m
    amplitude, omega : float, rad and rad/s
        Of the angle, positive with the right end down, from rest.
    centre_height : float, m
        Of the centre of the turn above the bottom; it lies in the middle of the length.
    times : (n,) float64, s
    modes : int
        Number of odd modes.
    damping : float
        Ratio of damping of every free wave.
    power : int
        Count the odd mode m with 1 / m^power: 2 for what the centres of the liquids tell (see `layer_modes`).

    Returns
    -------
    (n, free) float64, m
    """
    total = np.zeros((len(times), layers.free))
    for m in range(1, 2 * modes, 2):
        k = m * np.pi / length
        mass, _ = waves.matrices(layers, k)
        omega2, shape = waves.modes(layers, k)
        euler, tilt = forcing(layers, k, length, centre_height)
        weight = np.einsum("ji,jk,ki->i", shape, mass, shape)
        per_angle = (shape.T @ tilt - omega**2 * (shape.T @ euler)) / weight
        impulse = amplitude * omega * (shape.T @ euler) / weight
        for number, w2 in enumerate(omega2):
            w = np.sqrt(w2)

            def rates(t, y, w=w, force=per_angle[number]):
                drive = force * amplitude * np.sin(omega * t)
                return [y[1], drive - w * w * y[0] - 2.0 * damping * w * y[1]]

            done = solve_ivp(rates, (0.0, times[-1]), [0.0, impulse[number]], t_eval=times, rtol=1e-8, atol=1e-12)
            total += np.outer(done.y[0] / m**power, shape[:, number])
    return total


def layer_modes(results):
    """Elevations of the layers' tops in the first mode, m: (frames, layers), from the centres of the liquids.

    a cos(k x) moves the liquid below by sum (x - L / 2) V = -2 a / k^2: no definition of the interface is needed.
    The n-th odd mode takes part with 1 / n^2.
    """
    job = results.job
    k, length = np.pi / job.tank.length, job.tank.length
    volume = length * sum(fluid.depth for fluid in job.fluids) / len(results.liquid(0.0)["fluid"])
    found = []
    for time in results.frames:
        liquid = results.liquid(time)
        x, number = liquid["position"][:, 0] - length / 2.0, liquid["fluid"]
        found.append([-0.5 * k * k * volume * x[number <= layer].sum() for layer in range(len(job.fluids))])
    return np.array(found)
