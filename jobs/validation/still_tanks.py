"""Random tanks with baffles whose water is at rest, and has to stay so.

usage: python jobs/validation/still_tanks.py [--first N] [--count N] [--every SECONDS ...]

Each seed is a tank of a shape, with one to three baffles anywhere that a job file may have them, filled to a share of
10 to 100 %. For 0.25 s with outputs every so many seconds, the script prints the greatest speed from 0.2 s on over
sqrt(g h), the greatest error of the pressure over that at the bottom, and how many particles walls put back.
"""

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from parmps.domain import Domain  # noqa: E402
from parmps.errors import DivergedError, InputError  # noqa: E402
from parmps.loader import parse_job  # noqa: E402
from parmps.simulation import Simulation  # noqa: E402

G = 9.81
SHAPES = ("cylinder 2D", "prism 2D", "cylinder 3D", "prism 3D", "sphere 3D", "stl 3D")
SPEED, PRESSURE = 0.01, 0.02
"""Limits of the speed over sqrt(g h), and of the pressure's error over that at the bottom."""
BEGIN, END = 0.2, 0.25
"""s."""


def scene(seed, directory):
    """Job of a seed that the checks allow.

    Parameters
    ----------
    seed : int
    directory : path
        For surfaces.

    Returns
    -------
    dict
    """
    shape, dimension = SHAPES[seed % len(SHAPES)].split()
    dimension = int(dimension[0])
    rng = np.random.default_rng(seed)
    while True:
        job = {"gravity": G, "time": {"end": 1.0}, "dimension": dimension}
        height = rng.uniform(0.3, 2.0)
        across = height * rng.uniform(0.6, 2.0)
        length = height * rng.uniform(0.5, 1.5)
        tank = {"shape": shape, "size": [across, height] if dimension == 2 else [length, across, height]}
        if shape in ("cylinder", "sphere"):
            round_axes = 3 if shape == "sphere" else 2
            tank["size"][-round_axes:] = [height] * round_axes
        if shape == "prism":
            tank["chamfer"] = {
                end: [tank["size"][-2] * rng.uniform(0.05, 0.5), height * rng.uniform(0.05, 0.5)]
                for end in ("bottom", "top")
                if end == "bottom" or rng.random() < 0.5
            }
        if shape == "stl":
            tank["surface"] = gable(Path(directory) / f"{seed}.stl", tank["size"], rng.uniform(0.2, 0.8))
        rows = rng.uniform(12, 32) if dimension == 2 else rng.uniform(9, 14)
        spacing = height / rows
        tank["baffles"] = [plate(rng, tank["size"], spacing) for _ in range(rng.integers(1, 4))]
        fill = 1.0 if rng.random() < 0.1 else rng.uniform(0.1, 0.95)
        job |= {"spacing": float(f"{spacing:.4g}"), "tank": tank, "fluids": [{"name": "water", "fill": fill}]}
        try:
            if parse_job(yaml.safe_dump(job)).depths[0] > 5 * spacing:
                return job
        except InputError:
            pass


def gable(path, size, share):
    """Write the surface of a house with a gable roof over a keel, and return its path."""
    length, across, height = size
    keel, eaves = 0.3 * height * share, height * (1.0 - 0.4 * share)
    section = [(0.5 * across, 0.0), (across, keel), (across, eaves), (0.5 * across, height), (0.0, eaves), (0.0, keel)]
    corners = [(x, y, z) for x in (0.0, length) for y, z in section]
    n = len(section)
    faces = [(0, k + 1, k) for k in range(1, n - 1)] + [(n, n + k, n + k + 1) for k in range(1, n - 1)]
    for k in range(n):
        after = (k + 1) % n
        faces += [(k, after, n + k), (after, n + after, n + k)]
    lines = ["solid tank"]
    for face in faces:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += ["vertex {:.9g} {:.9g} {:.9g}".format(*corners[corner]) for corner in face]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid tank"]))
    return str(path)


def plate(rng, size, spacing):
    """A baffle anywhere: standing or lying, from wall to wall or not, up to three spacings thick."""
    thickness = float(spacing * rng.uniform(0.3, 3.0))
    along = 0 if rng.random() < 0.6 else 1  # across the length, or lying
    up, side = size[-1], size[0]
    reach = up if along == 0 else side
    low, high = sorted(rng.uniform(0.0, reach, 2))
    ends = rng.random()
    low, high = (0.0 if ends < 0.4 else low), (reach if ends > 0.8 else high)
    if high - low < 2.0 * spacing:
        low, high = 0.0, 0.5 * reach
    place = rng.uniform(thickness / 2, (side if along == 0 else up) - thickness / 2)
    names = ("x", "bottom", "top") if along == 0 else ("z", "left", "right")
    baffle = dict(zip(names, map(float, (place, low, high)), strict=True), thickness=thickness)
    if len(size) == 3 and rng.random() < 0.5:
        ends = sorted(rng.uniform(0.0, size[1], 2))
        if ends[1] - ends[0] > 2.0 * spacing:
            baffle["width"] = [float(end) for end in ends]
    return baffle


def measure(job, every, end=END):
    """Run a job of still water, and tell how still it stays.

    Parameters
    ----------
    job : dict
    every : float
        Time between outputs, s.
    end : float
        s.

    Returns
    -------
    speed, pressure : float
        Greatest from `BEGIN` on, over sqrt(g h) and over rho g h.
    put_back : int
    fluid : int
        Particles.
    """
    job = parse_job(yaml.safe_dump(job))
    sim = Simulation(job, Domain())
    depth, speed, error = job.depths[0], 0.0, 0.0
    output = 0
    try:
        while sim.time < end - 1e-9:
            if sim.time >= (output + 1) * every - 1e-9:
                output += 1
            sim.choose_step(min((output + 1) * every, end))
            sim.solve()
            p = sim.particles
            liquid = slice(0, p.liquid)
            if sim.time >= BEGIN - 1e-9:
                speed = max(speed, np.linalg.norm(p.velocity[liquid], axis=1).max())
                error = max(error, np.abs(pressure_error(sim, depth)).max())
            sim.move()
        return speed / np.sqrt(G * depth), error, sim.put_back, sim.totals["fluid"]
    finally:
        sim.close()


def pressure_error(sim, depth):
    """Error of the liquid's pressure over that at the bottom.

    In compartments that do not reach up to the surface the level of the pressure is that of the compartment alone.
    """
    p = sim.particles
    head = p.pressure[: p.liquid] / (1000.0 * G) + p.position[: p.liquid, 2] - depth
    first, last, other = sim.pairs.wet
    count = last[: p.liquid].astype(np.int64) - first[: p.liquid]
    i = np.repeat(np.arange(p.liquid), count)
    j = np.concatenate([other[a:b] for a, b in zip(first[: p.liquid], last[: p.liquid], strict=False)])
    among = j < p.liquid
    graph = coo_matrix((np.ones(among.sum()), (i[among], j[among])), (p.liquid, p.liquid))
    parts, label = connected_components(graph, directed=False)
    for part in range(parts):
        here = label == part
        if p.position[: p.liquid][here, 2].max() < depth - sim.l0 or sim.job.full:
            head[here] -= np.median(head[here])
    return head / depth


def main():
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--every", type=float, nargs="+", default=[0.005, 0.02, 0.1])
    options = parser.parse_args()
    bad = 0
    with tempfile.TemporaryDirectory() as directory:
        for seed in range(options.first, options.first + options.count):
            job = scene(seed, directory)
            for every in options.every:
                try:
                    speed, error, put_back, fluid = measure(job, every)
                    fine = speed < SPEED and error < PRESSURE and put_back == 0
                    found = f"{fluid:6d}  speed {speed:8.4f}  pressure {100 * error:8.2f} %  put back {put_back:5d}"
                except DivergedError as error:
                    fine, found = False, str(error)
                bad += not fine
                shape, fill = job["tank"]["shape"], job["fluids"][0]["fill"]
                mark = "" if fine else "  <--"
                tank = f"{seed:3d} {shape:8s} {job['dimension']}D {100 * fill:3.0f} %"
                print(f"{tank}  {every:5g} s {found}{mark}", flush=True)
    print(f"{bad} fail")


if __name__ == "__main__":
    main()
