"""The liquids of a scene: their densities, and what acts between particles of two of them.

Everything that depends on a pair of liquids is a small table that the kernels read with the numbers of the two
particles' liquids. The densities are sharp: each particle has that of its liquid. A scene with one liquid has no
tables; its kernels are compiled without them.
"""

import numpy as np


class Liquids:
    """Constants of the liquids of a job and of pairs of them.

    Parameters
    ----------
    job : Job

    Attributes
    ----------
    several : bool
    density : (liquids,) float64, kg/m3
    reference : float, kg/m3
        Density of the first, which the pressure equation is made with.
    viscosity : (liquids, liquids) float64, m2/s
        Kinematic viscosity of particle i in its interaction with j, 2 mu_i mu_j /
        ((mu_i + mu_j) rho_i) ([000] eqs. 13 and 14).
    viscous_rate : float, m2/s
        The greatest of them, which bounds the time step.
    capillary_rate : float, m3/s2
        The greatest sigma / (rho_1 + rho_2), with rho_2 = 0 at the free surface, which bounds the time step.
    contrast : float
        Square root of the least density over the greatest. An error e of the pressure gives liquid of density rho the
        energy e^2 / rho, so that the lightest one bounds the error that energy allows.
    volume : None or (liquids, liquids) float64
        Specific volume between particles of two liquids, 2 / (rho_i + rho_j), times the reference density.
    share : None or (liquids, liquids) float64
        Share rho_i / (rho_i + rho_j) of particle i in the mass of the pair.
    sheet : None or (liquids, liquids) bool
        Whether the velocity jumps between two liquids: where their densities differ
        or surface tension acts; None for nowhere.
    meeting : None or (liquids, liquids) int8
        1 where there is a sheet, 2 where it has a tension; None for nowhere.
    tension : None or (liquids, liquids) float64, N/m
        Interfacial tension; None where all are zero.
    wetting : None or (liquids, liquids) float64, rad
        A right angle less that between a wall and the interface with the other liquid, inside the own; None where all
        are right angles.
    surface_tension : None or (liquids,) float64, N/m
        At the free surface; None where all are zero, or where there is no free surface.
    """

    def __init__(self, job):
        rho = np.array([fluid.density for fluid in job.fluids])
        nu = np.array([fluid.kinematic_viscosity for fluid in job.fluids])
        self.several = len(rho) > 1
        self.density = rho
        self.reference = float(rho[0])
        self.volume = self.share = self.tension = self.sheet = self.meeting = self.surface_tension = self.wetting = None
        self.capillary_rate = 0.0
        self.contrast = float(np.sqrt(rho.min() / rho.max()))
        if self.several:
            total = rho[:, None] + rho
            self.volume = 2.0 * self.reference / total
            self.share = rho[:, None] / total
            self.tension, self.wetting = _tension(job), _wetting(job)
            sheet = rho[:, None] != rho
            if self.tension is not None:
                sheet |= self.tension > 0.0
                self.capillary_rate = float(np.max(self.tension / total))
            if sheet.any():
                tense = False if self.tension is None else self.tension > 0.0
                self.sheet, self.meeting = sheet, sheet.astype(np.int8) + tense
        free = np.array([fluid.surface_tension for fluid in job.fluids])
        if free.any() and not job.full:
            self.surface_tension = free
            self.capillary_rate = max(self.capillary_rate, float(np.max(free / rho)))
        self.viscosity = harmonic(rho * nu) / rho[:, None]
        self.viscous_rate = float(np.max(self.viscosity))


def harmonic(values):
    """Harmonic means of all pairs, 2 a b / (a + b); 0 where both are.

    Parameters
    ----------
    values : (n,) float64

    Returns
    -------
    (n, n) float64
    """
    total = values[:, None] + values
    return 2.0 * values[:, None] * values / np.where(total > 0.0, total, 1.0)


def _tension(job):
    names = [fluid.name for fluid in job.fluids]
    table = np.zeros((len(names), len(names)))
    for interface in job.interfaces:
        a, b = (names.index(name) for name in interface.between)
        table[a, b] = table[b, a] = interface.surface_tension
    return table if table.any() else None


def _wetting(job):
    names = [fluid.name for fluid in job.fluids]
    table = np.zeros((len(names), len(names)))
    for interface in job.interfaces:
        a, b = (names.index(name) for name in interface.between)
        table[a, b] = np.radians(90.0 - interface.wetting_angle)
        table[b, a] = -table[a, b]
    return table if table.any() else None
