"""The ledger of the liquid's energy: what each stage of a step gives the liquid and takes from it.

Energy is kinetic energy relative to the tank, less the work of the body force along the particles' ways, so that the
sum of all stages is, to rounding, what kinetic energy rises by beyond that work. Nothing but the body force works on
liquid between walls and a surface without pressure: what a stage gives comes from nowhere.

A stage's account goes up and down: pressure takes from one wave what it gives to the next. Its gain at a time is how
far the account is above the least that it ever was, and the gains of all stages add up: what another stage takes
meanwhile does not hide them. Pressure has one account with two of its parts. Impacts are what stops when flow meets a
wall or other flow; a pressure that corrects the flow too much gives more than it should and takes that as an impact in
the same step. Volume is what lifts the liquid that the curvature of its ways pressed together in waves, where pressure
takes as much: in a surge of four periods 1.6 % of the energy, of which 1.8 % came back. How much volume there is, is
watched on its own. Symplectic Euler takes m a^2 dt^2 / 2 in every step, of which only what is new, m a . (a - a') dt^2
/ 2, is an impact; the rest belongs to steady flow, which gives it back by volume and the next step's pressure.

Measured at the default settings: gains of tutorials and validation cases are below 2 %, but for a disc thrown at a wall
without gravity (4 to 5 %); the jet at an edge that drew energy from suction 12 %, still water that blew up 250 %.
"""

import numpy as np

from parmps.kernels import energy

STAGES = (
    "pressure", "impacts", "volume", "viscosity", "tension", "contacts", "damping", "shifting", "surface", "walls",
    "left",
)  # fmt: skip
"""In the order in which the kernels book them; behind them comes the work of the body force."""
PARTS = 3
"""The first stages, which have one account: pressure."""
ACCOUNTS = ("pressure", *STAGES[PARTS:])
GAINED_LIMIT = 0.05
"""Greatest gain of a run within its limits, over the liquid's energy. It is five times what sound runs gain, and what
makes a wave 2.5 % higher, which is as much as the scheme's errors at coarse spacings."""
VOLUME_LIMIT = 0.05
"""Greatest error of the volume of a run within its limits: of the level as much, and twice that of a tank's smallest
differences of level which a user would look at."""
TO_COUNT = 0.01
"""Share of the liquid's energy from which the log names a gain or a loss."""


class Ledger:
    """Energy that the stages of the steps gave the liquid.

    Parameters
    ----------
    mass, density : (liquids,) float64
        Of a particle, kg, and of its liquid, kg/m3.

    Attributes
    ----------
    booked : (stages + 1,) float64, J
        What this rank booked since the ranks last summed up.
    totals : (stages + 1,) float64, J
        Of all ranks until then.
    scale : float
        Energy of the liquid, J, to which gains are compared: the greatest of its weight's so far and of its motion's.
    gained_most, volume_most : float
        Greatest gain and error of the volume at any sample, both as shares.
    worst : dict
        Of the greatest gain: ``stage`` with the largest part of it, ``time`` in s.
    volume_time : float
        When the volume was furthest off, s.
    """

    def __init__(self, mass, density):
        self.mass, self.volume = mass, mass / density
        self.clear()

    def clear(self):
        """Begin anew."""
        self.booked, self.totals = np.zeros(len(STAGES) + 1), np.zeros(len(STAGES) + 1)
        self.least, self.gains = np.zeros(len(ACCOUNTS)), np.zeros(len(ACCOUNTS))
        self.scale = self.tension = self.gained_most = self.volume_most = self.volume_time = 0.0
        self.worst = {"stage": None, "time": None}

    @property
    def state(self):
        """What goes on in a restart, once the ranks have summed up: dict."""
        names = ("scale", "tension", "gained_most", "volume_most", "volume_time", "worst")
        arrays = {name: getattr(self, name).tolist() for name in ("totals", "least", "gains")}
        return arrays | {name: getattr(self, name) for name in names}

    @state.setter
    def state(self, state):
        for name, value in state.items():
            setattr(self, name, np.array(value) if isinstance(value, list) else value)
        self.booked[:] = 0.0

    def kinetic(self, particles, velocity):
        """Kinetic energy of this rank's liquid with a given velocity, J: float."""
        p = particles
        return energy.kinetic(velocity, p.kind, p.fluid, self.mass, p.liquid)

    def book(self, stage, change):
        """Book what a stage gave, in J."""
        self.booked[STAGES.index(stage)] += change

    def book_way(self, particles, velocity, time, field):
        """Book the work of the body force along a way, which the pressure has to pay for.

        Parameters
        ----------
        particles : Particles
            At the beginning of the way.
        velocity : (n, 3) float64, m/s
        time : float
            The way over the velocity, s.
        field : (4, 3) float64
            As in `kernels.energy.work_along`.
        """
        p = particles
        work = time * energy.power(p.position, velocity, p.kind, p.fluid, self.mass, field, p.liquid)
        self.booked[energy.WORK] += work
        self.booked[energy.PRESSURE] -= work

    def settle(self, domain):
        """Sum up what the ranks booked; collective."""
        self.totals += domain.sum(self.booked)
        self.booked[:] = 0.0

    def note(self, time, scale, tension):
        """Note the gains at a sample, after the ranks have summed up.

        Parameters
        ----------
        time : float
            s.
        scale : float
            Energy of the liquid, J.
        tension : float
            Energy of its surfaces under tension, J, which pressure may give: what they have less is not known.
        """
        accounts = np.array([self.totals[:PARTS].sum(), *self.totals[PARTS:-1]])
        self.tension, self.scale = max(self.tension, tension), max(self.scale, scale)
        self.least = np.minimum(self.least, accounts)
        self.gains = accounts - self.least
        tense = [ACCOUNTS.index("pressure"), ACCOUNTS.index("tension")]
        self.gains[tense] = np.maximum(self.gains[tense] - self.tension, 0.0)
        share = float(self.gains.sum()) / max(self.scale + self.tension, 1e-300)
        if share > self.gained_most:
            self.gained_most = share
            self.worst = {"stage": ACCOUNTS[int(self.gains.argmax())], "time": time}

    def note_volume(self, time, drift):
        """Note the relative error of the volume at a sample, at a time in s."""
        if abs(drift) > abs(self.volume_most):
            self.volume_most, self.volume_time = drift, time

    def summary(self, kinetic, potential):
        """What ``run.json`` holds of energy.

        Parameters
        ----------
        kinetic, potential : float
            Change of both since the start, J.

        Returns
        -------
        dict
            In J but for shares: kinetic + potential = work + gained - dissipated, where the work is that of the tank's
            motion, and the potential that of the uniform part of the body force.
        """
        gained, net = float(self.gains.sum()), float(self.totals[:-1].sum())
        return {
            "work": float(self.totals[-1]) + potential,
            "kinetic": kinetic,
            "potential": potential,
            "dissipated": gained - net,
            "gained": gained,
            "gained_most": self.gained_most,
            "gained_most_at": self.worst,
            "scale": self.scale + self.tension,
            "stages": {name: float(value) for name, value in zip(STAGES, self.totals[:-1], strict=True)},
        }

    def warnings(self):
        """What passed its limits: list of str, one sentence each."""
        said = []
        if self.gained_most > GAINED_LIMIT:
            said.append(
                f"energy came from nowhere: {self.gained_most:.1%} of the liquid's at t = {self.worst['time']:g} s, "
                f"most of it by {self.worst['stage']}; the limit is {GAINED_LIMIT:.0%}"
            )
        if abs(self.volume_most) > VOLUME_LIMIT:
            said.append(
                f"the liquid's volume was off by {self.volume_most:+.1%} at t = {self.volume_time:g} s; the limit is "
                f"{VOLUME_LIMIT:.0%}"
            )
        return said

    def account(self):
        """Say what went to heat and what came from nowhere: str."""
        whole = max(self.scale + self.tension, 1e-300)
        shares = {name: value / whole for name, value in zip(STAGES, self.totals[:-1], strict=True)}
        ways = {"pressure": shares["pressure"] + shares["impacts"] + shares["volume"]}
        ways |= {name: shares[name] for name in STAGES[PARTS:]}
        heat = [f"{-share:.1%} by {name}" for name, share in sorted(ways.items(), key=lambda item: item[1])
                if share < -TO_COUNT]  # fmt: skip
        gains = [f"{gain / whole:.1%} by {name}" for name, gain in zip(ACCOUNTS, self.gains, strict=True)
                 if gain > TO_COUNT * whole]  # fmt: skip
        return (
            f"of the liquid's energy, {', '.join(heat) if heat else f'less than {TO_COUNT:.0%} by any stage'} went to "
            f"heat; {', '.join(gains) if gains else f'less than {TO_COUNT:.0%} by any stage'} came from nowhere "
            f"(at most {self.gained_most:.1%} at any time, {GAINED_LIMIT:.0%} is allowed)"
        )
