"""The simulation: its state, its time step, and what the ranks share of it."""

import math
import time as clock

import numpy as np

from parmps.components import Floating
from parmps.energy import Ledger
from parmps.errors import DivergedError
from parmps.interfaces import Links, Near
from parmps.kernels.shifting import keep_off_walls
from parmps.kernels.smoothing import smooth_mass_density
from parmps.kernels.velocity import body_force, greatest_speed
from parmps.kernels.walls import distances
from parmps.kernels.weight import lattice
from parmps.liquids import Liquids
from parmps.motion import Motion
from parmps.neighbors import Pairs
from parmps.particles import FLUID, OUT, Particles
from parmps.pressure import Blocks, PressureSolver, VelocitySolver
from parmps.stages import make_plan, pressure_gradient, smooth_density
from parmps.tank import initial_velocity, place

HALO_MARGIN = 1.6
"""Width of the halo beyond the largest radius, in spacings: how far particles may move before it is renewed."""
BALANCE_EVERY = 10
"""Steps between two looks at the balance of the ranks."""
IMBALANCE = 1.03
"""Largest over mean cost of the ranks beyond which particles are distributed anew."""
SORT_EVERY = 400
"""Steps after which particles are sorted again for the sake of the caches."""
HALO_COST = 4.0
"""Cost of a particle of the halo, which is sorted, searched and exchanged, over that of a pair of neighbours."""
DISTRIBUTION_STEPS = 7.0
"""What it costs to distribute the particles anew and to make a new multigrid hierarchy, in steps."""
CLOSED_STEP = 0.125
"""Bound of the step by the body force f where a part of the liquid has no free surface: dt <= 0.125 sqrt(l0 / f). With
0.2 and more, particles of a full tank in 3D that pitches by 20 degrees piled up to three times the density."""
CLOSED_COURANT = 0.2
"""Bound of the Courant number there. With 0.4, a full tank in 3D with baffles that pitches by 20 degrees at 12 rad/s
gained a tenth of its energy while gaps opened behind the baffles' edges."""
HASTE = 0.01
"""A step by the Courant number shorter than this share of the other bounds makes the greatest speed suspicious."""
CAPILLARY_STEP = math.sqrt(0.25 / math.pi)
"""Bound of the step by surface tension: dt <= sqrt((rho_1 + rho_2) l0^3 / (4 pi sigma)) (Brackbill 1992)."""
CAPILLARY_SHARE = 0.25
"""Share of c / l0^3 in the grid's frequency: that of a wave of 10 spacings, the shortest with a curvature."""
WAVE_STEP = 0.1
"""Bound of the step by the liquid's head f h where it moves before its pressure is known: dt <= 0.1 l0 / sqrt(f h).

With the papers' gradient, pressures scatter by several heads from step to step and throw particles by
dt^2 P / (rho l0): with 0.2, most runs of the main job end in 0.1 s."""
DIVERGENCE_FADING = 0.1
"""How fast the time in which divergence is removed falls to a step that became short, over that step."""
VISCOUS_STEP = 0.2
"""Bound of the step by explicit viscosity: dt <= 0.2 l0^2 / nu."""
IMPLICIT_GAIN = 1.5
"""How much longer the step must get for the implicit viscous step, which costs about half of another step, to pay."""
PROJECTIONS = 10
"""How often at most the initial velocity is projected: each time leaves half of what a row has towards its wall."""


COUNTERS = (
    "time",
    "step_number",
    "divergence_time",
    "initial_energy",
    "initial_potential",
    "energy_scale",
    "largest_kinetic",
    "contacts",
    "put_back",
    "surface_distance",
    "volume_error",
    "volume_off",
    "iterations",
    "iterations_max",
    "step_min",
    "step_max",
)
"""What a simulation knows beside its particles. Those of `SUMMED` are this rank's share of a sum."""
SUMMED = ("contacts", "put_back")


class Work:
    """Arrays that live for one step: filled by one stage, read by later ones.

    Parameters
    ----------
    centres, rows, count : int
        Particles that have moments, rows of the pressure equation, and all with the halo.
    stages : container of str
        Names of the stages of a step: what only others need is not there.

    Attributes
    ----------
    density, lean, inverse, full, smooth, surface_normal, change
        One row a particle that has moments: the liquid alone, and with the papers' scheme the walls too. See the
        kernels; ``inverse`` holds the moment matrices before they are inverted.
    source, rhs
        One row a row of the pressure equation.
    asymmetry, wet, surface, near, force, link_force, intermediate, gradient
        One row a particle, the halo included.
    support : None or (count,) float64
        How far what is around a particle keeps it from moving on its own, from 0 to 1; None where all are whole.
    mass_density, fraction : None or (count,) float64
        Density smoothed where liquids meet, kg/m3, and share of the own liquid among the neighbours; None where
        densities are sharp.
    weak : (m,) int32
        The particles of little support.
    nearest : (rows,) int32
        Fluid particle whose liquid a wall particle belongs to, -1 for none; empty where there is one liquid.
    bend : None or (count,) float64
        Curvature of the interface near each particle, 1/m; None without surface tension between liquids.
    near_interface : None or Near
        What is known of interfaces; None without any.
    above : None or (count,) float64
        Pressure on the free surface above its particles, Pa; None without surface tension there.
    inward : None or (count,) float64
        Asymmetry that shifts its particles into the liquid where they are crowded, 0 or less.
    surface_links : None or Links
        Of its particles.
    impulse : None or (count, 3) float64
        Change of the velocity by contacts, m/s; None where the step is not hurried.
    """

    def __init__(self, centres, rows, count, stages):
        self.density, self.smooth = np.zeros(centres), np.zeros(centres)
        self.source, self.rhs = np.zeros(rows), np.zeros(rows)
        for name, width in (("lean", 3), ("inverse", 6), ("full", 6), ("surface_normal", 3), ("change", 3)):
            setattr(self, name, np.zeros((centres, width)))
        for name, width in (("asymmetry", 3), ("force", 3), ("link_force", 3), ("intermediate", 3), ("gradient", 9)):
            setattr(self, name, np.zeros((count, width)))
        self.wet = np.ones(count)
        self.surface = np.zeros(count, np.int8)
        self.near = np.zeros(count, np.int8)
        self.nearest = np.empty(rows if "wall liquids" in stages else 0, np.int32)
        self.support = np.ones(count) if "support" in stages else None
        self.weak, self.impulse = np.empty(0, np.int32), None
        self.bend = np.zeros(count) if "curvature" in stages else None
        self.near_interface = Near(rows, count) if "interfaces" in stages else None
        smooth = "density smoothing" in stages
        self.mass_density, self.fraction = (np.empty(count), np.ones(count)) if smooth else (None, None)
        self.above, self.inward, self.surface_links = None, None, None
        if "surface pressure" in stages:
            self.above, self.inward, self.surface_links = np.zeros(count), np.zeros(count), Links()


class Simulation:
    """The liquid of a job on the ranks of a domain.

    Parameters
    ----------
    job : Job
    domain : Domain

    Attributes
    ----------
    time : float
        s.
    step_number : int
    dt : float
        Of the step under way, s.
    particles : Particles
    plan : Plan
    force : float
        Greatest body force in the tank, m/s2.
    courant, grid_number, activity : float
        Time step in the units that shifting and damping refer to: u dt / l0 with the greatest speed u,
        sqrt(f / l0 + c / (4 l0^3)) dt with the body force f and the capillary rate c of `Liquids`, and the latter plus
        a fifth of the former.
    divergence_time : float
        Time in which the divergence that the past steps left is removed, s: the step, unless it is short for the sake
        of an output. What flow makes of its divergence in a step is the source of its dynamic pressure; all of it
        removed in a shorter step is that much more pressure.
    implicit : bool
        Whether the viscous step is implicit, so that it does not bound the time step.
    volume_error, volume_off : float
        Mean of the last measured compression, up to 5 % a particle; relative change of the volume by the same density.
    contacts, put_back : int
        Of this rank: contacts of close particles, particles put back from walls.
    """

    def __init__(self, job, domain):
        scheme = job.scheme
        self.job, self.scheme, self.domain = job, scheme, domain
        self.dimension = job.dimension
        self.liquids = Liquids(job)
        placement = place(job, scheme.wall, domain.rank, domain.size, layers=wall_layers(scheme))
        self.geometry = placement.geometry
        self.l0 = placement.spacing
        self.particle_mass = self._masses(placement)
        self.totals = {"fluid": placement.total_fluid, "total": placement.total}
        self.ledger = Ledger(self.particle_mass, self.liquids.density)
        self.motion = Motion(job.motion, job.gravity, job.dimension, job.tank)
        self.lattice = lattice(job.dimension, scheme.radius)
        self.laplacian_lattice = lattice(job.dimension, scheme.laplacian_radius)
        self.wide_lattice = lattice(job.dimension, scheme.volume_radius)
        self.surface_lean = self.lattice.lean
        self.surface_distance = 0.5 * self.l0
        self.volume_error = self.volume_off = 0.0
        self.plan = make_plan(job, domain.size)
        self.seconds = {stage.name: 0.0 for stage in (*self.plan.solve, *self.plan.move)}
        self.solver = PressureSolver(
            domain.comm, scheme.ksp_rtol * self.liquids.contrast, scheme.hierarchy_excess, scheme.laplacian_radius
        )
        self.velocity_solver = VelocitySolver(domain.comm) if "viscosity" in self.seconds else None
        self.solvers = [solver for solver in (self.solver, self.velocity_solver) if solver is not None]
        reach = max(scheme.radius, scheme.laplacian_radius) * self.l0
        moved = scheme.position == "moved"
        self.pairs = Pairs(reach, self.geometry.obstacles, wall_pairs=moved)
        self.halo_reach = max(reach, scheme.volume_radius * self.l0)
        self.halo_width = self.halo_reach + HALO_MARGIN * self.l0
        arrays = {
            name: getattr(placement, name) for name in ("id", "kind", "fluid", "parent", "position", "normal", "depth")
        }
        arrays["velocity"] = initial_velocity(job, placement)
        liquid = placement.kind == FLUID
        arrays["velocity"][liquid] += self.motion.initial_velocity(placement.position[liquid])
        self.particles = Particles(arrays)
        self.time, self.step_number, self.dt = 0.0, 0, 0.0
        self.frame = self.motion.at(0.0)
        self.force = self.courant = self.grid_number = self.activity = self.divergence_time = 0.0
        self.implicit = False
        self.contacts = self.put_back = 0
        self.left = []
        self.largest_kinetic = 0.0
        self.iterations, self.iterations_max = 0, 0
        self.step_min, self.step_max = math.inf, 0.0
        self.started = False
        self.distribute()
        self.initial_energy, self.initial_potential = self.kinetic_energy(), self.potential_energy()
        at = self.particles.position[: self.particles.liquid, 2]
        self.energy_scale = np.linalg.norm(self.frame.force) * self.domain.sum(self.mass_sum(at))

    # Distribution

    def distribute(self):
        """Give every rank its particles, rows and halo; forget all that depends on the past."""
        if self.domain.size > 1:
            self._spread(np.ones(self.particles.owned))
        self._spread(self.costs() if self.domain.size > 1 else np.ones(self.particles.owned))
        self._sorted_at, self._blocks = self.step_number, None
        self._halo_at_first, self._steps_lost = self.domain.sum(float(self.domain.halo)), 0.0
        self.floating, self._check_floating = Floating(np.full(0, -1), 0), True

    def _spread(self, cost):
        """Give every rank particles of the same total cost, and find the halo."""
        self.particles = self.domain.distribute(self.particles, cost, 2.0 * self.l0)
        self._first_row = self.domain.first_of(self.particles.rows)
        for solver in self.solvers:
            solver.new_layout(self.particles.rows)
        self.rebuild_halo()

    def costs(self):
        """Cost of each of this rank's particles, which the ranks share evenly: its neighbours', and its own.

        Returns
        -------
        (owned,) float64
        """
        p = self.particles
        self.pairs.find(p)
        cost = np.ones(p.owned)
        cost[: p.rows] += np.diff(self.pairs.lists[0])
        return cost

    def rebuild_halo(self):
        """Find the halo anew, number the rows of the pressure equation in it, and size the arrays of the step."""
        p = self.particles
        if len(p) != p.owned:
            p.resize(p.owned)
        self.domain.build_halo(p, self.halo_width)
        centres = p.liquid if self.scheme.position == "start" else p.rows
        self.work = Work(centres, p.rows, len(p), self.seconds)
        self.row = np.full(len(p), -1, np.int64)
        self.row[: p.rows] = self._first_row + np.arange(p.rows)
        self.domain.exchange(self.row)
        beyond = np.flatnonzero(self.row[p.owned :] >= 0) + p.owned
        beyond = beyond[np.argsort(self.row[beyond])]
        self.column = np.full(len(p), -1, np.int32)
        self.column[beyond] = np.arange(len(beyond))
        for solver in self.solvers:
            solver.new_halo(self.row[beyond])

    def balance(self):
        """Distribute the particles anew where the ranks' costs have drifted apart, or the order has, or their boxes.

        The flow carries particles into the boxes of other ranks, whose halos grow. What that has cost since the last
        distribution pays for the next one.
        """
        since = self.step_number - self._sorted_at
        if since == 0:
            return
        due = since >= SORT_EVERY
        if not due and self.step_number % BALANCE_EVERY == 0 and self.domain.size > 1:
            cost = float(self.pairs.count + self.particles.owned)
            total, halo = self.domain.sum(np.array([cost, self.domain.halo]))
            self._steps_lost += BALANCE_EVERY * HALO_COST * (halo - self._halo_at_first) / total
            due = self._steps_lost > DISTRIBUTION_STEPS
            due |= self.domain.max(cost) > IMBALANCE * total / self.domain.size
        if due:
            self.distribute()

    def start(self):
        """Make the initial velocity one that incompressible liquid in this tank can have; once, at the start.

        A velocity towards a wall, as of a tank that starts with a jolt, is stopped by an impulse of pressure
        in no time: the velocity is projected, without a body force and without moving anything, for as long as this
        takes kinetic energy from it. What does not is the operators' own error.

        Raises
        ------
        DivergedError
            On all ranks.
        """
        if self.started:
            return
        self.started = True
        p = self.particles
        if self.domain.max(float(np.abs(p.velocity[: p.liquid]).max(initial=0.0))) == 0.0:
            return
        self.choose_step(self.job.time.max_step or self.job.output.probes_every)
        self.frame = self.frame._replace(force=np.zeros(3), alpha=np.zeros(3))
        for _ in range(PROJECTIONS):
            velocity, energy = p.velocity[: p.liquid].copy(), self.kinetic_energy()
            self._run(self.plan.project)
            self.frame = self.frame._replace(velocity=np.zeros(3), omega=np.zeros(3))  # the tank jolts once
            pressure_gradient(self)
            p.velocity[: p.liquid] = velocity - self.dt * p.acceleration[: p.liquid]
            p.pressure[:] = 0.0
            if self.kinetic_energy() > energy:
                p.velocity[: p.liquid] = velocity
                break
        p.acceleration[:], self.divergence_time = 0.0, 0.0
        self.frame = self.motion.at(0.0)
        self.contacts = 0
        self.ledger.clear()
        self.initial_energy = self.kinetic_energy()
        self.distribute()  # a restart from here would not know the solver's state

    # What the stages use

    def packing(self):
        """Number density that the liquid should have, over that of the lattice.

        Layers whose depths are no multiples of the spacing begin with lattices that are stretched to fit, but for walls
        on the line, where the rows of all are a spacing apart.

        Returns
        -------
        float or (liquid,) float64
        """
        if self.fluid is None or self.scheme.wall == "line":
            return 1.0
        volume = self.particle_mass / self.liquids.density
        layered = np.array([fluid.region is None for fluid in self.job.fluids])
        packing = np.where(layered, self.l0**self.dimension / volume, 1.0)
        return packing[self.fluid[: self.particles.liquid]]

    @property
    def fluid(self):
        """Number of each particle's liquid, or None where there is one liquid: (n,) int8."""
        return self.particles.fluid if self.liquids.several else None

    @property
    def fraction(self):
        """Share of the own liquid among each particle's neighbours, 1 for walls: (n,) float64."""
        near, p = self.work.near_interface, self.particles
        if near is not None:
            return near.colour + 0.5
        if self.work.fraction is not None or not self.liquids.several:
            return np.ones(len(p)) if self.work.fraction is None else self.work.fraction
        unused, fraction = np.empty(len(p)), np.ones(len(p))  # liquids of one density, which no stage tells apart
        lists = (*self.pairs.wet, self.strength)
        smooth_mass_density(
            p.position, p.kind, p.fluid, self.liquids.density, *lists, self.scheme.radius, p.liquid, unused, fraction
        )
        return fraction

    def blocks(self):
        """Room for this rank's part of the matrix.

        Returns
        -------
        Blocks
        """
        entries = self.pairs.count + self.particles.rows
        if self._blocks is None or len(self._blocks.columns) < entries:
            room = entries + entries // 8
            self._blocks = Blocks(self.particles.rows, room, room)
        return self._blocks

    def check_floating(self):
        """Whether to look for parts without a free surface: after a new distribution, and when one got or lost one.

        While a full tank has gaps, and once they are closed, too: what lies alone in a gap is a part of its own. Its
        pressure, known to the solver's error alone as one part with the rest, went to 1e9 Pa.
        """
        gaps = self.job.full and self.domain.max(float(len(self.work.weak))) > 0.0
        check, self._check_floating = self._check_floating or gaps, gaps
        return check or self.floating.outdated(self.domain, self.work.surface[: self.particles.rows])

    def evaluate_body_force(self):
        """Body force of the tank's motion on the liquid, at the step's start; Coriolis' by a later velocity.

        Pressure makes v^(n+1) one along the walls at r^n, so liquid that circles at w loses w^2 dt^2 / 2 of its speed
        in each step, while Coriolis' force by v^n, which is along the circle one step behind, adds 2 Omega w dt^2:
        liquid that stayed behind a round tank, w = Omega, had four times its energy after 30 rad. By the velocity a
        quarter of a step behind, it keeps it.
        """
        p, w = self.particles, self.work
        f, velocity = self.frame, p.velocity
        if self.scheme.position == "start" and f.omega.any():
            velocity = velocity - 0.75 * self.dt * p.acceleration
        body_force(p.position, velocity, p.kind, f.force, f.alpha, f.omega, w.force)

    def force_field(self):
        """Body force on what rests in the tank, as in `kernels.energy.work_along`: (4, 3) float64."""
        field, frame = np.zeros((4, 3)), self.frame
        field[0] = frame.force
        if frame.omega.any() or frame.alpha.any():
            field[1:] = frame.turn()
        return field

    def keep_inside(self):
        """Put particles back that a wall should have stopped, and tell those that left an open tank over its rim."""
        p, walls = self.particles, self.geometry.walls
        account = (p.fluid, self.ledger.mass, self.force_field(), self.ledger.booked)
        least = 0.2 * self.l0
        self.put_back += keep_off_walls(p.position, p.velocity, p.kind, walls, least, p.liquid, *account)
        if not walls.open_top:
            return
        above = (p.position[: p.liquid, 2] > walls.container[1, 2]) & (p.kind[: p.liquid] == FLUID)
        index = np.flatnonzero(above)
        # the rim is where the tank's walls end, chamfers included
        at = np.column_stack([p.position[index, :2], np.full(len(index), walls.container[1, 2])])
        for i in index[distances(at, walls._replace(solids=walls.solids[:0]))[0] < 0.0]:
            p.kind[i] = OUT
            mass = float(self.particle_mass[p.fluid[i]])
            self.ledger.book("left", -0.5 * mass * float(p.velocity[i] @ p.velocity[i]))
            p.velocity[i] = p.pressure[i] = 0.0
            self.left.append((int(p.id[i]), p.position[i].tolist(), self.step_number))

    # Time

    def choose_step(self, until, request=0):
        """Choose the time step by the present state, and hear what the ranks want.

        Parameters
        ----------
        until : float
            Time of the next output, which a whole number of steps must reach, s.
        request : int
            What this rank wants the others to know, such as a request to stop.

        Returns
        -------
        int
            The greatest request of all ranks.

        Raises
        ------
        DivergedError
            On all ranks: a velocity is not finite, or greater than all the liquid's energy can make it.
        """
        p = self.particles
        speed, request = self.domain.max(np.array([greatest_speed(p.velocity, p.liquid), request], float))
        if not math.isfinite(speed):
            raise DivergedError(f"a velocity is not finite at t = {self.time:g} s, step {self.step_number}")
        self.frame = self.motion.at(self.time)
        control, force = self.job.time, self.frame.greatest_force(self.motion.corners)
        self.force = force
        courant, steady = flow_limits(self.job, self.floating.count > 0)
        bounds = [control.max_step or math.inf]
        if force > 0.0:
            bounds.append(steady * math.sqrt(self.l0 / force))
        if self.liquids.capillary_rate > 0.0:
            bounds.append(CAPILLARY_STEP * math.sqrt(self.l0**3 / self.liquids.capillary_rate))
        if self.scheme.position == "moved":
            bounds.append(WAVE_STEP * self.l0 / math.sqrt(max(self._head(), 1e-300)))
        left = until - self.time
        if speed > 0.0:
            bound = courant * self.l0 / speed
            if bound < HASTE * min(*bounds, left):
                self._check_speed(speed)
            bounds.append(bound)
        if "viscosity" in self.seconds:
            explicit = VISCOUS_STEP * self.l0**2 / self.liquids.viscous_rate
            self.implicit = min(*bounds, max(left, self.divergence_time)) > IMPLICIT_GAIN * explicit
            if not self.implicit:
                bounds.append(explicit)
        steps = max(math.ceil(left / min(bounds) * (1.0 - 1e-9)), 1)
        self._end_of_step = until if steps == 1 else _rounded(self.time + left / steps, left / steps)
        self.dt = self._end_of_step - self.time
        self.divergence_time = max(self.dt, min(*bounds, self.divergence_time))
        self.courant = speed * self.dt / self.l0
        capillary = self.liquids.capillary_rate * CAPILLARY_SHARE / self.l0**3
        self.grid_number = math.sqrt(force / self.l0 + capillary) * self.dt
        self.activity = self.grid_number + 0.2 * self.courant
        return int(request)

    def _check_speed(self, speed):
        """Stop a run whose fastest particle has twice the energy of all the liquid, before its steps vanish."""
        energy = self.initial_energy + self.energy_scale + abs(self.work_done())
        if 0.5 * float(self.particle_mass.min()) * speed**2 > 2.0 * energy:
            raise DivergedError(
                f"a particle moves at {speed:g} m/s at t = {self.time:g} s, step {self.step_number}: "
                "more than the energy of all the liquid"
            )

    def _head(self):
        """Greatest difference of the body force's potential in the liquid, m2/s2: f h of a depth h."""
        p = self.particles
        at = p.position[: p.liquid]
        potential = np.einsum("ij,ij->i", at, self.frame.force_at(0.5 * at))  # of a force that is linear in the place
        ends = [potential.max(initial=-math.inf), (-potential).max(initial=-math.inf)]
        return float(np.sum(self.domain.max(np.array(ends))))

    def solve(self):
        """Find the pressure at the present time."""
        self._run(self.plan.solve)

    def move(self):
        """Move the liquid to the end of the step."""
        self._run(self.plan.move)
        self.time = self._end_of_step
        self.step_number += 1
        self.divergence_time -= DIVERGENCE_FADING * self.dt
        self.iterations += self.solver.iterations
        self.iterations_max = max(self.iterations_max, self.solver.iterations)
        self.step_min, self.step_max = min(self.step_min, self.dt), max(self.step_max, self.dt)

    def step(self, until):
        """Advance by one time step, no further than to a given time.

        Parameters
        ----------
        until : float
            s.
        """
        self.start()
        self.balance()
        self.choose_step(until)
        self.solve()
        self.move()

    def _run(self, stages):
        for stage in stages:
            start = clock.perf_counter()
            stage.run(self)
            self.seconds[stage.name] = self.seconds.get(stage.name, 0.0) + clock.perf_counter() - start

    @property
    def hurried(self):
        """Whether the step is shorter than the time in which the divergence of the past ones is removed."""
        return self.dt < self.divergence_time

    # States

    def snapshot(self):
        """Copy what `restore` needs to come back to this instant.

        Returns
        -------
        dict
        """
        counters = {name: getattr(self, name) for name in COUNTERS}
        arrays = {name: values.copy() for name, values in self.particles.arrays().items()}
        return {"counters": counters, "arrays": arrays, "left": list(self.left), "ledger": self.ledger.state}

    def restore(self, snapshot):
        """Go back to a snapshot of this rank, or on to the state of a checkpoint.

        Parameters
        ----------
        snapshot : dict
            ``counters``, ``arrays`` of particles, ``left``: what is to be told of particles that left, and the state
            of the ``ledger``.
        """
        for name in COUNTERS:
            setattr(self, name, snapshot["counters"][name])
        self.left, self.ledger.state = snapshot["left"], snapshot["ledger"]
        self.started = True
        self.particles = Particles(snapshot["arrays"])
        self.distribute()

    def close(self):
        """Free the solvers."""
        for solver in self.solvers:
            solver.close()

    # Sums over the liquid

    def _masses(self, placement):
        """Mass of a particle of each liquid, so that the sum is that of the volume filled: (liquids,), kg (kg/m)."""
        liquid = placement.kind == FLUID
        kinds, count = placement.fluid[liquid], len(self.liquids.density)
        sums = [np.bincount(kinds, placement.volume[liquid], count), np.bincount(kinds, minlength=count)]
        volume, number = self.domain.sum(np.array(sums, dtype=float))
        return self.liquids.density * np.where(number > 0.0, volume / np.maximum(number, 1.0), self.l0**self.dimension)

    def work_done(self):
        """Work of the body force so far, J; collective."""
        self.ledger.settle(self.domain)
        return float(self.ledger.totals[-1])

    def mass_sum(self, values):
        """Sum of a value times the mass over this rank's liquid.

        Parameters
        ----------
        values : (liquid,) float64

        Returns
        -------
        float
        """
        if self.fluid is None:
            return float(self.particle_mass[0] * values.sum())
        return float(self.particle_mass[self.fluid[: len(values)]] @ values)

    def kinetic_energy(self):
        """Kinetic energy relative to the tank, J (J/m in 2D)."""
        p = self.particles
        return float(self.domain.sum(self.ledger.kinetic(p, p.velocity)))

    def potential_energy(self):
        """Potential of the uniform part of the body force, J (J/m in 2D)."""
        p = self.particles
        return -float(self.domain.sum(self.mass_sum(p.position[: p.liquid] @ self.frame.force)))

    def surface_energy(self):
        """Energy of the surfaces under tension, J (J/m in 2D), by the number of particles in them."""
        tables = [table for table in (self.liquids.tension, self.liquids.surface_tension) if table is not None]
        if not tables:
            return 0.0
        p, w = self.particles, self.work
        between = 0 if w.near_interface is None else len(w.near_interface.index)
        count = float(self.domain.sum(float(np.count_nonzero(w.surface[: p.liquid]) + between)))
        return count * self.l0 ** (self.dimension - 1) * max(float(table.max()) for table in tables)

    def note_energy(self):
        """Let the ledger note the gains and the error of the volume so far; collective, in a solved step."""
        p = self.particles
        self.largest_kinetic = max(self.largest_kinetic, self.kinetic_energy())
        weight = self.force * float(self.domain.sum(self.mass_sum(p.position[: p.liquid, 2])))
        self.energy_scale = max(self.energy_scale, weight)
        self.ledger.settle(self.domain)
        self.ledger.note(self.time, self.energy_scale + self.largest_kinetic, self.surface_energy())
        # not older than a few steps where a stage measures it
        self.ledger.note_volume(self.time, self.volume_off if "volume" in self.seconds else self.volume_drift())

    def energy_drift(self):
        """Energy that came from nowhere (or, negative, went to heat), over the energy of the liquid; collective.

        Kinetic energy less its initial value and less the work of the body force, over the greatest kinetic
        energy noted so far plus the greatest potential energy of the liquid above the tank's bottom. The energy of
        surfaces under tension is not known: what they give the liquid counts as from nowhere.

        Returns
        -------
        float
        """
        self.note_energy()
        return float(self.ledger.totals[:-1].sum()) / max(self.energy_scale + self.largest_kinetic, 1e-300)

    def volume_drift(self):
        """Relative change of the liquid's volume, from the smooth density inside the liquid.

        Returns
        -------
        float
        """
        ratio, inside = smooth_density(self)
        errors = 1.0 / ratio[inside] - 1.0
        total, count = self.domain.sum(np.array([errors.sum(), float(len(errors))]))
        return float(total / max(count, 1.0))


def _rounded(time, step):
    """Time rounded to 12 digits, as those of outputs are, unless a step is near that.

    Steps of 2 ms then end at the same instants whether outputs are 20 ms apart or 2.
    """
    rounded = float(f"{time:.12g}")
    return rounded if abs(rounded - time) < 1e-6 * step else time


def flow_limits(job, closed):
    """Bounds of the step by the flow: the Courant number, and that by the body force in sqrt(l0 / f).

    Parameters
    ----------
    job : Job
    closed : bool
        Whether a part of the liquid has no free surface.

    Returns
    -------
    float, float
    """
    courant, steady = job.courant, job.scheme.steady_step
    return (min(courant, CLOSED_COURANT), min(steady, CLOSED_STEP)) if closed else (courant, steady)


def wall_layers(scheme):
    """Wall layers that the radii need: one wall and so many dummies, which only ghosts need in the Laplacian.

    Parameters
    ----------
    scheme : Scheme

    Returns
    -------
    int
    """
    laplacian = scheme.laplacian_radius if scheme.surface == "ghost" else 0.0
    volume = scheme.volume_radius - 1.0 if scheme.volume_time is not None else 0.0  # half a spacing off on both sides
    return max(3, math.ceil(max(scheme.radius, laplacian, volume)))
