"""Random scenes against what must always hold: ``make hunt``, results in ``jobs/hunt/results.md``.

A seed makes a scene (`scenes.make_scene`), and anyone can write it out and run it: ``python jobs/hunt/hunt.py --seed 17
--write DIRECTORY``, then ``python -m parmps DIRECTORY/scene_17.yaml``. What the checks refuse must be refused before it
starts. What they accept must run, and

- have finite values, lose no particle, and let none through a wall, at every sample;
- gain less than 1 % of energy from nowhere, and keep its volume within 2 %, but for the papers' scheme, which is
  kept as a baseline and does neither;
- stay still where nothing may move: from 0.2 s on no speed above 0.01 sqrt(g h), pressure within 2 % of hydrostatic,
  nothing put back from walls;
- go on from a checkpoint bit for bit;
- be mirrored by the mirrored job, and be the same on one rank and on three, within 1e-6 spacings after some steps.
  Not mirrored are the papers' scheme in tanks with baffles, where a dummy in the middle of a plate has the pressure of
  one of its two faces, and tanks whose particles start at other places when mirrored, as along curved walls.
"""

import argparse
import copy
import math
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from parmps.checkpoint import read_header, read_slabs
from parmps.domain import Domain
from parmps.errors import InputError, ParmpsError, StoppedError
from parmps.interrupt import WALL_LIMIT
from parmps.loader import load_job, parse_job
from parmps.particles import FLUID
from parmps.run import Run
from parmps.simulation import Simulation

ROOT = Path(__file__).resolve().parents[2]

sys.path[:0] = [str(ROOT / "jobs"), str(ROOT / "jobs" / "hunt")]

from invariants import broken_state, energy_gain, surface_energy, volume  # noqa: E402
from provenance import provenance  # noqa: E402
from scenes import make_scene  # noqa: E402

MOST_ENERGY, MOST_VOLUME = 0.01, 0.02
STILL_AFTER, STILL_SPEED, STILL_PRESSURE = 0.2, 0.01, 0.02
"""From when on still tanks are judged, s; greatest speed over sqrt(g h); greatest error of the pressure over that at
the floor."""
SAMPLES = 40
"""Looks at a run, at most."""
SHORT = 12
"""Steps after which runs are compared that must be equal but for rounding, which violent flow magnifies."""
SAME = 1e-6
"""Greatest distance between them, in spacings."""
TIGHT = 1e-11
"""Tolerance of the pressure there."""
CPU_SECONDS = 15.0
"""After which a run is looked at no further."""
LIMIT = 300.0
"""Wall time of one scene, s, after which it counts as hanging."""


def examine(scene, directory, cpu_seconds=CPU_SECONDS):
    """Look at all that must hold for a scene on one rank.

    Parameters
    ----------
    scene : Scene
    directory : path-like
        For the job and its results.
    cpu_seconds : float
        As `CPU_SECONDS`.

    Returns
    -------
    verdict : {"holds", "refused", "failed"}
    str
        Why, or with what figures.
    """
    path = scene.write(directory)
    try:
        sim = Simulation(load_job(path), Domain(MPI.COMM_SELF))
    except InputError as error:
        return "refused", str(error)
    figures = ""
    try:
        fault, figures = march(sim, scene, cpu_seconds)
        if not (scene.papers and scene.job["tank"]["baffles"]):
            fault = fault or mirror_fault(scene, path)
        fault = fault or restart_fault(path, SHORT * sim.time / sim.step_number)
    except ParmpsError as error:
        fault = f"{type(error).__name__}: {error}"
    finally:
        sim.close()
    return ("failed", f"{fault}; {figures}") if fault else ("holds", figures)


def march(sim, scene, cpu_seconds):
    """Run to the end and look at the invariants of each sample; the first fault, and figures."""
    end, began = sim.job.time.end, time.process_time()
    every = max(sim.job.output.probes_every, end / SAMPLES)
    worst = {"energy": -math.inf, "volume": 0.0, "speed": 0.0, "pressure": 0.0}
    fault, surface, expanded = None, None, 0.0
    for number in range(1, math.ceil(end / every * (1.0 - 1e-9)) + 1):
        until = min(number * every, end)
        while sim.time < until:
            sim.step(until)
            if surface is None:
                surface, expanded = surface_energy(sim), volume(sim)
        fault = look(sim, scene, worst, surface, expanded)
        if fault or time.process_time() - began > cpu_seconds:
            break
    words = f"{sim.totals['fluid']} particles, {sim.step_number} steps, {sim.time:.3g} s, energy {worst['energy']:+.1%}"
    words += f", volume {worst['volume']:+.1%}"
    if scene.still:
        words += f", speed {worst['speed']:.2%}, pressure {worst['pressure']:.2%}"
    return fault, words


def look(sim, scene, worst, surface, expanded):
    """Find a fault in the present state, or None."""
    fault = broken_state(sim)
    worst["energy"] = max(worst["energy"], energy_gain(sim, surface))
    worst["volume"] = max(worst["volume"], volume(sim) - expanded, key=abs)
    if fault or scene.papers:
        return fault
    if worst["energy"] > MOST_ENERGY:
        return f"energy from nowhere at {sim.time:.3g} s"
    if abs(worst["volume"]) > MOST_VOLUME:
        return f"the volume changed at {sim.time:.3g} s"
    if not scene.still:
        return None
    if sim.put_back:
        return f"{sim.put_back} particles of still liquid put back from walls by {sim.time:.3g} s"
    if sim.time < STILL_AFTER:
        return None
    depth = sum(sim.job.depths)
    p = sim.particles
    speed = float(np.linalg.norm(p.velocity[: p.liquid], axis=1).max()) / math.sqrt(sim.job.gravity * depth)
    worst["speed"] = max(worst["speed"], speed)
    worst["pressure"] = max(worst["pressure"], pressure_error(sim))
    if worst["speed"] > STILL_SPEED:
        return f"still liquid moves at {sim.time:.3g} s"
    return f"pressure not hydrostatic at {sim.time:.3g} s" if worst["pressure"] > STILL_PRESSURE else None


def pressure_error(sim):
    """Greatest difference from hydrostatic pressure, over that at the floor; in full tanks but for a constant."""
    job, p = sim.job, sim.particles
    top = np.cumsum(job.depths)
    bottom = top - np.array(job.depths)
    z = p.position[: p.liquid, 2, None]
    weight = sim.liquids.density * job.gravity
    error = p.pressure[: p.liquid] - np.clip(top - z, 0.0, top - bottom) @ weight
    if job.full:
        error -= np.median(error)
    return float(np.abs(error).max() / (weight @ job.depths))


def short_run(job, domain):
    """Take some steps with a tight tolerance.

    Returns
    -------
    position : (n, 3) float64, m
        Of all ranks' liquid, in the order of its numbers.
    start : (n, 3) float64, m
    spacing : float, m
    """
    sim = Simulation(job, domain)

    def liquid():
        p = sim.particles
        own = p.kind[: p.liquid] == FLUID
        number = np.concatenate(domain.gather(p.id[: p.liquid][own]))
        return np.concatenate(domain.gather(p.position[: p.liquid][own]))[np.argsort(number)]

    try:
        start = liquid()
        while sim.step_number < SHORT and sim.time < job.time.end:
            sim.step(job.time.end)
        return liquid(), start, sim.l0
    finally:
        sim.close()


def tight(scene, path, data=None):
    """The job of a scene, or other data in its place, with the tight tolerance."""
    data = copy.deepcopy(data or scene.job)
    scheme = data["scheme"] if isinstance(data["scheme"], dict) else {"preset": data["scheme"]}
    data |= {"scheme": scheme | {"ksp_rtol": TIGHT}, "probes": []}  # which may lie in a mirrored baffle
    return parse_job(scene._replace(job=data).text, file=path)


def mirrored(scene):
    """The job of a scene with x reversed."""
    job = copy.deepcopy(scene.job)
    length = job["tank"]["size"][0]
    for baffle in job["tank"]["baffles"]:
        if "x" in baffle:
            baffle["x"] = length - baffle["x"]
        if "left" in baffle:
            baffle["left"], baffle["right"] = length - baffle["right"], length - baffle["left"]
        for low, high in baffle.get("openings", []) if "left" in baffle else []:
            low[0], high[0] = length - high[0], length - low[0]
    for fluid in job["fluids"]:
        region = fluid.get("region", {})
        if "box" in region:
            low, high = region["box"]
            low[0], high[0] = length - high[0], length - low[0]
        for ball in (region[name] for name in ("disc", "ball") if name in region):
            ball["centre"][0] = length - ball["centre"][0]
    for law in job["motion"]:
        turned = ("surge", "pitch", "yaw") + (("roll",) if job["dimension"] == 2 else ())
        for key in ("amplitude", "amplitude_deg") if law["kind"] in turned else ():
            if key in law:
                law[key] = -law[key]
        if "centre" in law:
            law["centre"][0] = length - law["centre"][0]
    initial = job["initial"]
    if initial != "rest" and initial["kind"] == "velocity":
        initial["value"][0] *= -1.0
    elif initial != "rest" and initial["mode"] % 2:
        initial["amplitude"] *= -1.0
    return job


def mirror_fault(scene, path):
    """Tell how a short run differs from the mirror image of that of the mirrored job, where both start alike."""
    alone = Domain(MPI.COMM_SELF)
    here, start, l0 = short_run(tight(scene, path), alone)
    there, begun, _ = short_run(tight(scene, path, mirrored(scene)), alone)
    if len(here) != len(there):
        return None
    length = scene.job["tank"]["size"][0]
    flip = np.array([-1.0, 1.0, 1.0])
    apart, pair = cKDTree(start).query(begun * flip + [length, 0.0, 0.0])
    if apart.max() > SAME * l0:
        return None
    error = np.abs(there * flip + [length, 0.0, 0.0] - here[pair]).max() / l0
    return f"{error:.1g} spacings from the mirrored job" if error > SAME else None


def ranks_fault(scene, path, comm):
    """Tell how a short run on all ranks differs from that on one."""
    job = tight(scene, path)
    many, _, l0 = short_run(job, Domain(comm))
    one = short_run(job, Domain(MPI.COMM_SELF))[0] if comm.rank == 0 else None
    one = comm.bcast(one)
    error = np.abs(many - one).max() / l0
    return f"{error:.1g} spacings between one and {comm.size} ranks" if error > SAME else None


class StopAt:
    """Asks a run to stop at a time, s, as a wall limit would."""

    def __init__(self, time):
        self._time, self.run = time, None

    def request(self):
        """See `parmps.interrupt.Interrupt`."""
        return WALL_LIMIT if self.run.simulation.time >= self._time else 0


def restart_fault(path, span):
    """Tell how a run that was stopped and went on differs from one that was not.

    Parameters
    ----------
    path : Path
        Of the job.
    span : float
        Simulated time of the runs, s.
    """
    span = float(f"{span:.3g}")
    half = 0.5 * span
    overrides = [f"time.end={span}", f"output.probes_every={half / 2}", f"output.particles_every={half}"]
    job = load_job(path, [*overrides, f"output.checkpoint_every={half}"])
    results = []
    for parts in (1, 2):
        directory = path.parent / f"parts_{parts}"
        for part in range(parts):
            stop = StopAt(half if part < parts - 1 else math.inf)
            stop.run = Run(job, Domain(MPI.COMM_SELF), directory, directory if part else None, stop)
            try:
                stop.run.go()
            except StoppedError:
                pass
            finally:
                stop.run.close()
        file = directory / "checkpoint.h5"
        arrays = read_slabs(file, range(len(read_header(file).slabs)))
        order = np.argsort(arrays["id"])
        results.append(({name: a[order] for name, a in arrays.items()}, (directory / "probes.csv").read_bytes()))
    (whole, table), (parted, again) = results
    differ = [name for name, values in whole.items() if not np.array_equal(values, parted[name], equal_nan=True)]
    if differ:
        return f"{', '.join(differ)} differ after a restart"
    return None if table == again else "samples differ after a restart"


def hunt(seed, ranks=3):
    """Examine the scene of a seed in processes of its own; seed, description, verdict and why."""
    scene = make_scene(seed)
    with tempfile.TemporaryDirectory() as directory:
        fork = multiprocessing.get_context("fork")  # the kernels are loaded once
        answer = fork.SimpleQueue()
        child = fork.Process(target=_answer, args=(seed, directory, answer))
        child.start()
        child.join(LIMIT)
        if child.is_alive():
            child.kill()
            child.join()
            verdict, why = "failed", f"runs for more than {LIMIT:g} s"
        elif answer.empty():
            verdict, why = "failed", f"crashed with exit status {child.exitcode}"
        else:
            verdict, why = answer.get()
        if verdict == "holds" and ranks > 1:
            fault = _on_ranks(scene, directory, ranks)
            verdict, why = ("failed", f"{fault}; {why}") if fault else (verdict, why)
    return seed, scene.description, verdict, " ".join(why.replace("|", "/").split())


def _answer(seed, directory, answer):
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # runs tell what they do
    answer.put(examine(make_scene(seed), directory))


def _on_ranks(scene, directory, ranks):
    """Compare ranks in processes of mpirun; the fault."""
    command = ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, __file__, "--part", directory]
    env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    try:
        done = subprocess.run(
            [*command, "--seed", str(scene.seed)], env=env, capture_output=True, text=True, timeout=LIMIT, check=False
        )
    except subprocess.TimeoutExpired:
        return f"{ranks} ranks run for more than {LIMIT:g} s"
    if done.returncode:
        return f"{ranks} ranks fail: " + " ".join(done.stderr.strip().splitlines()[-3:])
    return done.stdout.strip()


def main():
    """Run the scenes, or write one out."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0:300", metavar="FIRST:END", help="the scenes to run (default 0:300)")
    parser.add_argument("--seed", type=int, help="run one scene alone")
    parser.add_argument("--write", metavar="DIRECTORY", help="write the scene of --seed there instead of running it")
    parser.add_argument("--part", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.part:
        fault = ranks_fault(make_scene(options.seed), Path(options.part) / "scene.yaml", MPI.COMM_WORLD)
        if fault and MPI.COMM_WORLD.rank == 0:
            print(fault)
        return
    if options.write:
        print(make_scene(options.seed).write(options.write))
        return
    seeds = [options.seed] if options.seed is not None else range(*map(int, options.seeds.split(":")))
    rows = []
    for seed in seeds:
        rows.append(hunt(seed))
        print("{:4} {}: {}: {}".format(*rows[-1]), flush=True)
    if options.seed is None:
        write_results(rows)
    sys.exit(any(row[2] == "failed" for row in rows))


def write_results(rows):
    """Write the table."""
    counts = {verdict: sum(row[2] == verdict for row in rows) for verdict in ("holds", "refused", "failed")}
    total = f"{len(rows)} scenes: " + ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
    print(total)
    (ROOT / "jobs" / "hunt" / "results.md").write_text("\n".join([
        "# Hunt", "", f"{total}.", "",
        f"`make hunt` at {provenance()}. What must hold is said in `hunt.py`; energy, volume, speed and",
        "pressure are the worst of the run.",
        "", "| seed | scene | verdict | |", "|---|---|---|---|",
        *(f"| {seed} | {description} | {verdict} | {why} |" for seed, description, verdict, why in rows),
    ]) + "\n")  # fmt: skip


if __name__ == "__main__":
    main()
