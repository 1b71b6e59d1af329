"""Where the solver breaks: ``make extremes`` runs a matrix of short jobs, results in ``jobs/extremes/results.md``.

A job survives when nothing is lost or not finite, no particle is beyond a wall, the energy, that of interfaces with
surface tension included, is at most 2 % above what was supplied, the volume is held within 2 %, and no step is shorter
than a thousandth of the one that the Courant number allows at the greatest speed the scene can supply. A job that
cannot work must be refused before it runs. With names as arguments, only those cases run and nothing is written; with
``--group``, one group of cases and its part of the results.
"""

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from parmps.domain import Domain
from parmps.errors import DivergedError, InputError
from parmps.loader import parse_job
from parmps.simulation import Simulation

ROOT = Path(__file__).resolve().parents[2]

sys.path.insert(0, str(ROOT / "jobs"))

from invariants import broken_state, energy_gain, surface_energy, volume  # noqa: E402
from provenance import provenance  # noqa: E402

MOST = 0.02
"""Greatest energy above the supply, and greatest relative change of the volume."""
SHORTEST = 1e-3
"""Least step, over that of the Courant number."""
LOOK_EVERY = 5
STEPS = {1: math.inf, 3: 40}
FEWEST = 10
"""Most steps by the number of ranks, and for others: what ranks break shows at once, and on fewer cores they take
turns, which costs far more than the work."""
VERDICT = "verdict: "
"""Begins the lines in which the processes of mpirun tell theirs."""
# In violent coarse flow the liquid does expand: an independent area, of the particles' discs closed over gaps, grows
# with the measured volume. What expands it is the push that parts crowded particles (scheme.separation), and it falls
# with the spacing: the fast preset's roll of 90 degrees gains 2.6, 1.6 and 0.7 % at 10, 7.5 and 5 mm, shaken layers of
# 1000 : 1 gain 1.4 to 2.7 % at 10 mm, the worst moments of twelve runs, and 1.0 % at 5 mm. So the violent
# cases are at 4 or 5 mm, but for the plain roll.

TANK = """
dimension: 2
spacing: 0.01
tank: {size: [0.4, 0.3]}
fluids: [{name: water, depth: 0.15}]
motion: [{kind: surge, amplitude: 0.02, omega: 8.0}]
time: {end: 0.5, cfl: 0.4}
"""
STILL = (
    TANK.replace("motion: [{kind: surge, amplitude: 0.02, omega: 8.0}]\n", "")
    .replace("0.01", "0.004").replace("0.15", "0.152")
)  # fmt: skip
BOX = """
dimension: 3
spacing: 0.02
tank: {size: [0.3, 0.2, 0.2]}
fluids: [{name: water, depth: 0.1}]
motion: [{kind: pitch, amplitude_deg: 20, omega: 6.0}]
time: {end: 0.4, cfl: 0.4}
"""

SHAKING, SETTLING = 2.0, 6.0
"""Duration of the motion that emulsifies layers, and of the rest after it, s."""

SHAPES = {
    "sphere": "shape: sphere, size: [0.5, 0.5, 0.5]",
    "cylinder": "shape: cylinder, size: [0.6, 0.45, 0.45]",
    "prism with a ring": "shape: prism, size: [0.6, 0.45, 0.4], chamfer: {bottom: [0.1, 0.1], top: [0.1, 0.1]}, "
    "baffles: [{x: 0.3, ring: 0.09, thickness: 0.03}]",
    "box with a ring": "size: [0.6, 0.4, 0.4], baffles: [{x: 0.3, ring: 0.09, thickness: 0.03}]",
    "perforated baffle": "size: [0.6, 0.3, 0.35], baffles: [{x: 0.3, bottom: 0, top: 0.3, thickness: 0.03, "
    "openings: [[[0.06, 0.06], [0.13, 0.13]], [[0.17, 0.06], [0.24, 0.13]], [[0.06, 0.17], [0.24, 0.24]]]}]",
    "thin baffle of partial width": "size: [0.6, 0.4, 0.35], "
    "baffles: [{x: 0.3, bottom: 0, top: 0.2, thickness: 0.01, width: [0.1, 0.3]}]",
}
SHAKEN = """
dimension: 3
spacing: 0.03
tank: {%s}
fluids: [{name: water, fill: 0.5}]
motion: [{kind: pitch, amplitude_deg: 15, omega: 6.0}, {kind: sway, amplitude: 0.03, omega: 6.0}]
time: {end: 1.0, cfl: 0.4}
"""
"""Tanks of other shapes, and with other baffles than a plate."""


LAYERS = """
dimension: 2
spacing: 0.01
tank: {size: [0.4, 0.3]}
fluids: [{name: lower, depth: 0.1, density: 1000}, {name: upper, depth: 0.1, density: %g}]
interfaces: [{between: [lower, upper], surface_tension: 0.05}]
motion: [{kind: surge, amplitude: 0.02, omega: 8.0}]
time: {end: 0.5, cfl: 0.4}
"""


class Case(NamedTuple):
    """One run: a job, what is changed in it, the numbers of ranks, from when on the volume is judged, and outputs.

    Particles at random positions have no volume before they are even. ``outputs`` is the interval of outputs, s, with
    a second one each time a step of 1e-9 s later.
    """

    name: str
    job: str
    changes: tuple = ()
    ranks: tuple = (1,)
    settled: float = 0.0
    outputs: float | None = None


def scaled(length):
    """The still tank's liquid, as a column that collapses, in a tank of another length."""
    s = length / 0.4
    region = f"{{box: [[0, 0], [{0.1 * s}, {0.2 * s}]]}}"
    return (
        f"tank.size=[{length}, {0.3 * s}]", f"spacing={0.004 * s}", f"time.end={0.4 * math.sqrt(s)}",
        f"output.probes_every={0.1 * math.sqrt(s)}", f"fluids=[{{name: water, region: {region}}}]",
    )  # fmt: skip


def from_file(name):
    """Take positions and velocities of a file that `write_states` made."""
    return (f"initial={{kind: file, path: {name}.h5}}",)


def write_states(directory):
    """Write initial states, which no depth or region describes, and a motion."""
    grid = (np.arange(100) + 0.5) * 0.004
    x, z = (a.ravel() for a in np.meshgrid(grid, grid, indexing="ij"))
    rng = np.random.default_rng(1)

    def part(inside, velocity=(0.0, 0.0)):
        return np.stack([x[inside], z[inside]], axis=1), np.tile(velocity, (np.count_nonzero(inside), 1))

    def write(name, *parts):
        with h5py.File(directory / f"{name}.h5", "w") as file:
            file["position"], file["velocity"] = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))

    pool = (x < 0.4) & (z < 0.08)
    write("drop", part(pool), part(np.hypot(x - 0.2, z - 0.15) < 0.04, (0.0, -2.0)))
    between = (z > 0.1) & (z < 0.2)
    write(
        "blocks",
        part(between & (x > 0.09) & (x < 0.19), (25.0, 0.0)),
        part(between & (x > 0.21) & (x < 0.31), (-25.0, 0.0)),
    )
    scattered = []
    while len(scattered) < 600:
        point = rng.uniform([0.0, 0.0], [0.16, 0.06])
        if all(math.dist(point, other) > 0.001 for other in scattered):
            scattered.append(point)
    write("random", (np.array(scattered), np.zeros((600, 2))))
    write("coincident", part(pool), (np.array([[0.102, 0.0421]]), np.zeros((1, 2))))
    write("outside", part(pool), (np.array([[0.45, 0.1]]), np.zeros((1, 2))))
    flying = np.array([[0.05, 0.1], [0.35, 0.1], [0.2, 0.25], [0.1, 0.2]])
    write("flying", (flying, np.array([[3.0, 1.0], [-3.0, 1.0], [0.0, -5.0], [20.0, 7.0]])))
    time = np.arange(0.0, SHAKING + SETTLING + 0.1, 0.01)
    shaking = np.where(time < SHAKING, 0.05 * np.sin(np.pi * time / SHAKING) * np.sin(18.0 * time), 0.0)
    columns = np.stack([time, shaking], axis=1)
    np.savetxt(directory / "shaking.csv", columns, delimiter=",", header="time [s],surge [m]", comments="")
    (directory / "turning.csv").write_text(
        "time [s],roll [deg]\n" + "".join(f"{0.1 * n},{36.0 * n}\n" for n in range(12))
    )
    # an irregular motion in all six ways: three waves each, of random frequency and phase, that grow from rest
    time = np.arange(0.0, 20.5, 0.02)
    omega, phase = rng.uniform(3.0, 9.0, (2, 6, 3, 1))
    irregular = np.sin(omega * time + phase).sum(axis=1) * np.minimum(time, 1.0) ** 2
    columns = np.vstack([time, irregular * np.array([[0.01]] * 3 + [[4.0]] * 3)]).T
    names = "time [s],surge [m],sway [m],heave [m],roll [deg],pitch [deg],yaw [deg]"
    np.savetxt(directory / "irregular.csv", columns, delimiter=",", header=names, comments="")


def cases():
    """The matrix.

    Returns
    -------
    list of Case
    """
    def each(name, key, values, job=TANK, more=()):
        return [Case(f"{name} {value:g}", job, (*more, f"{key}={value!r}")) for value in values]

    both, many = (1, 3), (16,)
    jet = "fluids=[{name: water, region: {box: [[0.2, 0.15], [0.35, 0.25]]}}]"
    jet_velocity = "initial={kind: velocity, fluid: water, value: [-10, -10]}"
    column = "fluids=[{name: water, region: {box: [[0, 0], [0.1, 0.2]]}}]"
    narrow = ("tank.size=[0.05, 0.4]", "fluids[0].depth=0.2", "time.end=0.1")
    kept = "motion=[{kind: surge, amplitude: 0.001, omega: 8.0}]"
    return [
        Case("surge", TANK, (), both),
        *each("Courant number", "time.cfl", [0.02, 0.1, 1.0]),
        *each("Courant number above 1:", "time.cfl", [1.5]),
        Case("rows 3", TANK, ("spacing=0.05",), both),
        Case("rows 6", TANK, ("spacing=0.025",)),
        Case("rows 50", TANK, ("spacing=0.004", *narrow)),
        Case("rows 200", TANK, ("spacing=0.001", *narrow, "time.end=0.03"), both),
        *[Case(f"depth of {n} rows", TANK, (f"fluids[0].depth={n * 0.01}",), both) for n in (1, 2, 3)],
        Case("fill 1 %", TANK, ("spacing=0.003", "fluids[0].depth=0.003")),
        Case("fill 99.9 %", TANK, ("fluids[0].depth=0.2997",), both),
        Case("fill 100 %", TANK, ("fluids[0].depth=0.3",), both),
        Case("overfull", TANK, ("fluids[0].depth=0.31",)),
        *each("gravity", "gravity", [0.0, 9.8, 300.0, 1000.0]),
        *each("gravity above the range:", "gravity", [1e4]),
        *each("kinematic viscosity", "fluids[0].kinematic_viscosity", [0.0, 1e-6, 1e-3, 0.1, 1.0, 100.0]),
        Case("kinematic viscosity 10", TANK, ("fluids[0].kinematic_viscosity=10",), both),
        *each("kinematic viscosity above the range:", "fluids[0].kinematic_viscosity", [1e3]),
        Case("kinematic viscosity 0.1, roll of 90 degrees", TANK, (
            "fluids[0].kinematic_viscosity=0.1", "motion=[{kind: roll, amplitude_deg: 90, omega: 6.0}]",
        ), both),
        Case("kinematic viscosity 0.01, column that collapses", STILL, (
            column.replace("water", "oil, kinematic_viscosity: 0.01"), "time.end=0.6",
        )),
        Case("kinematic viscosity 1, drop falls into a pool", STILL, (
            *from_file("drop"), "fluids[0].kinematic_viscosity=1",
        ), both),
        Case("kinematic viscosity 1, blocks collide at 50 m/s", STILL, (
            *from_file("blocks"), "fluids[0].kinematic_viscosity=1", "time.end=0.02",
        )),
        Case("kinematic viscosity 1, 3D pitch", BOX, ("fluids[0].kinematic_viscosity=1",), both),
        *each("density", "fluids[0].density", [1e-3, 1.0, 2e4]),
        *each("density out of range:", "fluids[0].density", [1e-4, 1e5]),
        Case("surge of 5 g", TANK, ("motion=[{kind: surge, amplitude: 0.05, omega: 31.3}]",), both),
        Case("heave of 5 g", TANK, ("motion=[{kind: heave, amplitude: 0.05, omega: 31.3}]",)),
        Case("roll of 90 degrees", TANK, ("motion=[{kind: roll, amplitude_deg: 90, omega: 6.0}]",), both),
        Case("continuous rotation", TANK, (
            "spacing=0.005", "motion=[{kind: file, path: turning.csv, centre: [0.2, 0.15]}]", "time.end=0.3",
        ), both),
        *[Case(f"tank of {length:g} m", STILL, scaled(length)) for length in (1e-3, 1e-2, 1.0, 100.0, 1e3)],
        Case("column that collapses", STILL, (column, "time.end=0.6"), both),
        Case("column with a thin baffle", STILL, (
            column, "tank.baffles=[{x: 0.2, bottom: 0, top: 0.05, thickness: 0.002}]", "time.end=0.6",
        )),
        Case("column in an open tank", STILL, (column, "tank.lid=false", "tank.size=[0.4, 0.2]", "time.end=0.6")),
        Case("jet onto a corner", STILL, (jet, jet_velocity, "time.end=0.05"), both),
        Case("drop falls into a pool", STILL, from_file("drop"), both),
        Case("blocks collide at 50 m/s", STILL, (*from_file("blocks"), "time.end=0.02"), both),
        Case("random positions", STILL, from_file("random"), settled=0.05),
        Case("coincident particles", STILL, from_file("coincident")),
        *[
            Case(f"tension of the surface {sigma:g}", TANK, (f"fluids[0].surface_tension={sigma}",), both)
            for sigma in (0.07, 1, 100)
        ],
        Case("tension of the surface above the range: 200", TANK, ("fluids[0].surface_tension=200",)),
        Case("tension of the surface 100, a square drop without gravity", STILL, (
            "gravity=0", "fluids=[{name: water, region: {box: [[0.1, 0.05], [0.3, 0.25]]}, surface_tension: 100}]",
            "time.end=0.1",
        ), both),
        Case("tension of the surface 1, column that collapses", STILL, (
            "fluids=[{name: water, region: {box: [[0, 0], [0.1, 0.2]]}, surface_tension: 1}]", "time.end=0.6",
        )),
        Case("tension of the surface 0.07, roll of 90 degrees", TANK, (
            "spacing=0.005", "motion=[{kind: roll, amplitude_deg: 90, omega: 6.0}]", "fluids[0].surface_tension=0.07",
        )),
        Case("tension of the surface 100, 3D pitch", BOX, ("fluids[0].surface_tension=100",), both),
        Case("particle outside the tank", STILL, from_file("outside")),
        Case("single particles in flight", STILL, from_file("flying"), both),
        *each(
            "papers, gamma", "scheme.gamma", [0.0, 0.01, 0.05, 0.1, 0.2, 1.0], STILL,
            ("scheme.preset=papers", "time.end=0.15"),
        ),
        *each("tolerance", "scheme.ksp_rtol", [0.1, 1e-14]),
        *each("tolerance out of range:", "scheme.ksp_rtol", [1.0, 1e-16]),
        *each("radius", "scheme.radius", [1.6, 3.1, 5.0]),
        *each("radius of the Laplacian", "scheme.laplacian_radius", [1.6, 3.1, 4.01, 5.0]),
        *each("both radii 5: Laplacian", "scheme.laplacian_radius", [5.0], TANK, ("scheme.radius=5",)),
        *each("radius out of range:", "scheme.radius", [1.0, 6.0]),
        *each("radius of the volume", "scheme.volume_radius", [1.6, 2.6, 5.0]),
        *each("relaxation of the volume", "scheme.volume_time", [1e-3, 100.0]),
        *each("shifting", "scheme.shifting", [0.0, 10.0], TANK, (kept,)),
        *each("damping", "scheme.damping", [0.0, 10.0], TANK, (kept,)),
        *[Case(f"preset {name}", TANK, (f"scheme={name}",)) for name in ("fast", "accurate")],
        Case("preset fast, roll of 90 degrees", TANK, (
            "scheme=fast", "time.cfl=null", "motion=[{kind: roll, amplitude_deg: 90, omega: 6.0}]", "spacing=0.005",
        )),
        Case("preset fast, column that collapses", STILL, ("scheme=fast", "time.cfl=null", column)),
        Case("preset papers", TANK, ("scheme=papers", "time.end=0.3")),
        Case("3D pitch", BOX, (), both),
        Case("3D full", BOX, ("fluids[0].depth=0.2",)),
        Case("3D jet onto a corner", BOX, (
            "motion=[]", "fluids=[{name: water, region: {box: [[0.1, 0.06, 0.06], [0.2, 0.14, 0.14]]}}]",
            "initial={kind: velocity, fluid: water, value: [-10, -10, -10]}", "time.end=0.05",
        ), both),
        Case("3D irregular motion in six ways, 20 s", BOX, (
            "spacing=0.025", "motion=[{kind: file, path: irregular.csv}]", "time.end=20",
        ), both),
        *[Case(f"3D {name}", SHAKEN % tank, (), both) for name, tank in SHAPES.items()],
        *[Case(f"3D sphere, fill {fill:.0%}", SHAKEN % SHAPES["sphere"], (f"fluids[0].fill={fill}",), both)
          for fill in (0.01, 0.99)],
        Case("3D, baffle of one particle", BOX, (
            "tank.baffles=[{x: 0.15, bottom: 0.0, top: 0.08, thickness: 0.001}]",
        ), both),
        Case("outputs 1e-9 s apart", TANK, (), both, outputs=0.01),
        Case("outputs 1e-9 s apart, roll of 90 degrees", TANK, (
            "motion=[{kind: roll, amplitude_deg: 90, omega: 6.0}]", "time.end=2",
        ), outputs=0.03),
        Case("outputs 1e-9 s apart, column that collapses", STILL, (column, "time.end=0.6"), outputs=0.01),
        Case("outputs 1e-9 s apart, full tank", TANK, ("fluids[0].depth=0.3",), outputs=0.01),
        Case("outputs 1e-9 s apart, surface under tension", TANK, ("fluids[0].surface_tension=1",), outputs=0.01),
        Case("outputs 1e-9 s apart, viscosity 0.1", TANK, ("fluids[0].kinematic_viscosity=0.1",), outputs=0.01),
        Case("outputs 1e-9 s apart, preset papers", TANK, ("scheme=papers", "time.end=0.3"), outputs=0.01),
        Case("outputs 1e-9 s apart, 3D pitch", BOX, (), both, outputs=0.01),
        Case("more ranks than particles", TANK, (
            "spacing=0.05", "fluids=[{name: water, region: {box: [[0, 0], [0.2, 0.1]]}}]", "time.end=0.2",
        ), many),
        Case("16 ranks on two cores", BOX, ("time.end=0.1",), many),
    ]  # fmt: skip


def layered_cases():
    """Several liquids.

    Returns
    -------
    list of Case
    """
    both, still, light = (1, 3), "motion=[]", LAYERS % 800
    full = ("fluids[0].depth=0.15", "fluids[1].depth=0.15", still)
    viscous = [(1e-6, 1.0), (1.0, 1e-6), (1e-4, 100.0)]
    layers = ", ".join(f"{{name: layer {n}, depth: 0.02, density: {1000 - 50 * n}}}" for n in range(10))
    thin = "fluids=[{name: a, depth: 0.1}, {name: b, depth: %g, density: 900}, {name: c, depth: 0.1, density: 800}]"
    tip = "tank.baffles=[{x: 0.2, bottom: 0, top: %g, thickness: 0.02}]"
    settling = (
        "motion=[{kind: file, path: shaking.csv}]", f"time.end={SHAKING + SETTLING}", "fluids[0].depth=0.08",
        "fluids[1].depth=0.08",
    )  # fmt: skip
    return [
        *[Case(f"density ratio {r:g}, stable", LAYERS % (1000 / r), (), both) for r in (1.001, 10, 1e3, 1e4)],
        *[Case(f"density ratio {r:g}, inverted", LAYERS % (1000 * r), (still,)) for r in (2, 10)],
        *[
            Case(f"density ratio {r:g}, inverted, full tank", LAYERS % 1000, (f"fluids[0].density={1000 / r}", *full),
                 both)
            for r in (10, 1e3, 1e4)
        ],
        *[
            Case(f"kinematic viscosity {a:g} below {b:g}", light,
                 (f"fluids[0].kinematic_viscosity={a}", f"fluids[1].kinematic_viscosity={b}"), both)
            for a, b in viscous
        ],
        Case("viscosity ratio 1e6 and density ratio 1e3", LAYERS % 1,
             ("fluids[0].kinematic_viscosity=1", "fluids[1].kinematic_viscosity=1e-3")),
        *[
            Case(f"surface tension {sigma:g}", light, (f"interfaces[0].surface_tension={sigma}",), both)
            for sigma in (0, 1, 100)
        ],
        Case("surface tension 100, density ratio 1000", LAYERS % 1, ("interfaces[0].surface_tension=100",)),
        Case("surface tension 100, a square drop without gravity", LAYERS % 1000, (
            "gravity=0", still, "interfaces[0].surface_tension=100", "time.end=0.1", "spacing=0.005",
            "fluids=[{name: lower, region: {box: [[0.1, 0.05], [0.3, 0.25]]}}, {name: upper, depth: 0.3}]",
        )),
        Case("surface tension above the range: 200", light, ("interfaces[0].surface_tension=200",)),
        *[Case(f"layer of {n} rows between two", light, (thin % (0.01 * n), "interfaces=[]"), both) for n in (1, 2, 3)],
        Case("layer of 1 row on top", light, ("fluids[1].depth=0.01",), both),
        Case("ten layers of two rows", light, (f"fluids=[{layers}]", "interfaces=[]"), both),
        *[Case(f"baffle tip {what} an interface", light, (tip % top,), both)
          for what, top in (("at", 0.1), ("a row below", 0.09), ("half a row above", 0.105))],
        *[Case(f"preset papers, gradient {g}", light, ("scheme.preset=papers", f"scheme.gradient={g}"))
          for g in ("sum", "min")],
        *[Case(f"outputs 1e-9 s apart, density ratio {r:g}", LAYERS % (1000 / r), outputs=0.01) for r in (1.25, 1000)],
        Case("outputs 1e-9 s apart, density ratio 10, inverted, full tank", LAYERS % 1000, (
            "fluids[0].density=100", *full,
        ), both, outputs=0.01),
        Case("shaken and settled, ratio 1.25", light, settling, both),
        Case("shaken and settled, ratio 1000", LAYERS % 1, (*settling, "spacing=0.005")),
    ]  # fmt: skip


GROUPS = {"One liquid": cases, "Several liquids": layered_cases}


def attempt(case, directory):
    """Run one case on the ranks of this process.

    Parameters
    ----------
    case : Case
    directory : path
        Of the states that `write_states` wrote.

    Returns
    -------
    verdict : {"survived", "refused", "failed"}
    str
        Why, or with what figures.
    """
    os.chdir(directory)
    try:
        sim = Simulation(parse_job(case.job, case.changes), Domain())
    except InputError as error:
        return "refused", str(error)
    try:
        return judge(sim, case.settled, case.outputs)
    except DivergedError as error:
        return "failed", str(error)
    finally:
        sim.close()


def judge(sim, settled, outputs):
    """March to the end, and look at what must not happen."""
    end, worst, fault = sim.job.time.end, {"energy": -math.inf, "volume": 0.0, "beyond": 0.0}, None
    shortest, most = math.inf, STEPS.get(sim.domain.size, FEWEST)
    allowed = sim.job.courant * sim.l0 / max(supplied_speed(sim), 1e-300)
    start, times = None, output_times(end, outputs)
    until = next(times)
    while sim.time < end and sim.step_number < most and fault is None:
        sim.step(until)
        start = start or (surface_energy(sim), volume(sim) if settled == 0.0 else 0.0)
        last = sim.time >= end or sim.step_number >= most
        if sim.time < until:  # a step to an output may be short
            shortest = min(shortest, sim.dt / allowed)
        else:
            until = next(times, end)
        if last or sim.step_number % LOOK_EVERY == 0:
            fault = look(sim, worst, sim.time >= settled, *start)
    if fault is None and shortest < SHORTEST:
        fault = f"a step of {shortest:.1g} of the Courant number's"
    figures = (
        f"{sim.totals['fluid']} particles, {sim.step_number} steps, energy {worst['energy']:+.1%}, "
        f"volume {worst['volume']:+.1%}"
    )
    if sim.fraction is not None:
        strayed = sim.fraction[: sim.particles.liquid] < 0.5
        figures += f", strayed {sim.domain.sum(float(np.count_nonzero(strayed))) / sim.totals['fluid']:.1%} at the end"
    return ("survived", figures) if fault is None else ("failed", f"{fault} at {sim.time:.3g} s; {figures}")


def output_times(end, every):
    """Times that steps reach exactly, s: before the end, pairs of outputs 1e-9 s apart."""
    if every is not None:
        for at in np.arange(every, end - 0.5 * every, every):
            yield float(at)
            yield float(at) + 1e-9
    yield end


def look(sim, worst, settled, surface, expanded):
    """Find a fault in the present state, or None.

    The volume counts where it has settled, beyond that of the start, ``expanded``: the lattice does not fit every
    baffle. What the interfaces lose of their energy at the start, ``surface``, is supplied.
    """
    fault = broken_state(sim)
    if fault:
        return fault
    worst["energy"] = max(worst["energy"], energy_gain(sim, surface))
    change = volume(sim) - expanded if settled else 0.0
    worst["volume"] = max(worst["volume"], change, key=abs)
    if worst["energy"] > MOST:
        return "more energy than was supplied"
    return "the volume changed" if abs(change) > MOST else None


def supplied_speed(sim):
    """Greatest speed that the initial state, gravity over the tank's diagonal, the motion and tension can give, m/s.

    Tension draws in a film of one spacing at sqrt(2 sigma / (rho l0)) (Taylor and Culick).
    """
    size, frames = sim.job.tank.size, [sim.motion.at(t) for t in np.linspace(0.0, sim.job.time.end, 50)]
    reach = math.hypot(*size)
    p = sim.particles
    start = float(np.linalg.norm(p.velocity[: p.liquid], axis=1).max(initial=0.0))
    force = max(np.linalg.norm(f.force) + reach * np.linalg.norm(f.alpha) for f in frames)
    turn = max(np.linalg.norm(f.omega) for f in frames)
    tables = (sim.liquids.tension, sim.liquids.surface_tension)
    tension = max(0.0 if table is None else float(table.max()) for table in tables)
    film = math.sqrt(2.0 * tension / (float(sim.liquids.density.min()) * sim.l0))
    return sim.domain.max(start) + math.sqrt(2.0 * force * reach) + turn * reach + film


def on_ranks(names, ranks, directory):
    """Run cases one after the other under mpirun; after one that ends all ranks, the rest is started anew.

    Yields
    ------
    tuple of str
        Name, verdict and why, as of `attempt`.
    """
    env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    while names:
        command = ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, __file__, "--part", directory, *names]
        process = subprocess.Popen(command, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for line in process.stdout:
            if line.startswith(VERDICT):
                yield names.pop(0), *json.loads(line.removeprefix(VERDICT))
        said = process.stderr.read().strip().splitlines()
        if process.wait() and names:
            yield names.pop(0), "failed", " ".join(said[-3:])


def main():
    """Run the matrix, or with --part one case in the processes of mpirun."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="cases to run; all if none is given")
    parser.add_argument("--group", choices=GROUPS, help="the group of cases to run; all by default")
    parser.add_argument("--part", metavar="DIRECTORY", help=argparse.SUPPRESS)
    options = parser.parse_args()
    failed = 0
    for group, make in GROUPS.items():
        matrix = [case for case in make() if not options.names or case.name in options.names]
        if options.group in (None, group) and matrix:
            failed += run_group(group, matrix, options)
    sys.exit(failed > 0)


def run_group(group, matrix, options):
    """Run cases of a group, and write its part of the results if these are all; how many runs failed."""
    if options.part:
        for case in matrix:
            verdict = attempt(case, options.part)
            if Domain().rank == 0:
                print(VERDICT + json.dumps(verdict), flush=True)
        return 0
    rows = []
    with tempfile.TemporaryDirectory() as directory:
        write_states(Path(directory))
        for ranks in sorted({ranks for case in matrix for ranks in case.ranks}):
            mine = [case for case in matrix if ranks in case.ranks]
            names = [case.name for case in mine]
            done = on_ranks(names, ranks, directory) if ranks > 1 else ((c.name, *attempt(c, directory)) for c in mine)
            for name, verdict, why in done:
                rows.append((name, ranks, verdict, " ".join(why.replace("|", "/").split())))
                print(f"{name:40} {ranks} rank(s)  {verdict:9} {rows[-1][3]}", flush=True)
        os.chdir(ROOT)
    order = [case.name for case in matrix]
    rows.sort(key=lambda row: (order.index(row[0]), row[1]))
    counts = {verdict: sum(row[2] == verdict for row in rows) for verdict in ("survived", "refused", "failed")}
    total = f"{len(rows)} runs: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    print(total)
    if not options.names:
        write_results(group, rows, total)
    return counts["failed"]


def write_results(group, rows, total):
    """Write the table of a group, with what made it, and keep those of the others."""
    path = ROOT / "jobs" / "extremes" / "results.md"
    before = path.read_text().split("## ")[1:] if path.is_file() else []
    parts = {part.splitlines()[0]: "## " + part.strip() for part in before}
    parts[group] = "\n".join([
        f"## {group}", "", f"{total}.", "",
        f"`make extremes` at {provenance()}. What survived means is said in `run.py`; energy and volume are the worst "
        "of the run.",
        "", "| case | ranks | result | |", "|---|---|---|---|",
        *(f"| {name} | {ranks} | {verdict} | {why} |" for name, ranks, verdict, why in rows),
    ])  # fmt: skip
    path.write_text("\n\n".join(["# Extremes", *(parts[name] for name in GROUPS if name in parts)]) + "\n")


if __name__ == "__main__":
    main()
