"""Speed of the main job on one rank and on two: ``make bench``, results in ``jobs/benchmarks/results.md``.

Runs jobs/sloshing.yaml in memory (nothing is written but the table), alternating between one rank and two,
and takes the median of several windows of steps after a warm-up, so that compilation is out. Times are given
as core-microseconds per particle and step, and as multiples of a product with the step's own pressure matrix,
which depends less on the machine. With ``--spacings`` it runs the 3D tank jobs/lng_tank.yaml at these spacings
instead, for results_3d.md.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
JOB, TANK = ROOT / "jobs" / "sloshing.yaml", ROOT / "jobs" / "lng_tank.yaml"

sys.path.insert(0, str(ROOT / "jobs"))

from provenance import provenance  # noqa: E402


def measure(steps, windows, warm_up, spacing):
    """Run windows of steps on the ranks of this process; return what rank 0 found."""
    from parmps.domain import Domain
    from parmps.loader import load_job
    from parmps.simulation import Simulation

    domain = Domain()
    program = _memory()
    sim = Simulation(load_job(JOB) if spacing is None else load_job(TANK, [f"spacing={spacing}"]), domain)
    every = sim.job.output.probes_every

    def march(count):
        for _ in range(count):
            sim.step(sim.time + every)

    march(warm_up)
    results, memory = [], [_memory()]
    for _ in range(windows):
        before, iterations = dict(sim.seconds), sim.iterations
        domain.barrier()
        start = time.perf_counter()
        march(steps)
        domain.barrier()
        wall = time.perf_counter() - start
        stages = {name: domain.sum(sim.seconds[name] - before[name]) / domain.size for name in before}
        product = sim.solver.multiply_seconds(50)
        results.append(
            {
                "wall": wall / steps,
                "pressure": stages["pressure"] / wall,
                "outside": 1.0 - sum(stages.values()) / wall,
                "product": product,
                "iterations": (sim.iterations - iterations) / steps,
            }
        )
        memory.append(_memory())
    particles = sim.totals["total"]
    peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - program
    found = {"ranks": domain.size, "particles": particles, "windows": results, "memory": memory}
    return found | {"peak": domain.sum(float(peak)) / particles}, domain.rank


def _memory():
    """Resident memory now, bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()


def run(ranks, options, spacing=None):
    """Measure in a process of its own under mpirun: the main job, or the tank at a spacing."""
    command = ["mpirun", "--oversubscribe", "-n", str(ranks), sys.executable, __file__, "--measure"]
    command += [f"--steps={options.steps}", f"--windows={options.windows}", f"--warm-up={options.warm_up}"]
    command += [] if spacing is None else [f"--spacings={spacing}"]
    env = os.environ | {"OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(done.stderr)
    return json.loads(done.stdout.splitlines()[-1])


def summary(runs):
    """Medians over the windows of several runs on the same number of ranks."""
    windows = [window for one in runs for window in one["windows"]]
    median = {name: statistics.median(window[name] for window in windows) for name in windows[0]}
    ranks, particles = runs[0]["ranks"], runs[0]["particles"]
    median["core_us"] = 1e6 * median["wall"] * ranks / particles
    median["peak"] = statistics.median(one["peak"] for one in runs)
    median["products"] = statistics.median(window["wall"] / window["product"] for window in windows)
    return median


ROWS = (
    ("core-microseconds per particle and step", "core_us", "{:.2f}"),
    ("step, ms", "wall", "{:.1f}"),
    ("step, in products with its own matrix", "products", "{:.0f}"),
    ("share of the pressure equation", "pressure", "{:.0%}"),
    ("share outside the stages (Python, time step)", "outside", "{:.0%}"),
    ("solver iterations a step", "iterations", "{:.1f}"),
    ("peak memory beside the program's, bytes a particle", "peak", "{:.0f}"),
)


def table(one, two, particles, what):
    """The results as lines of Markdown."""
    lines = [f"{what}, {particles} particles:", "", "| | 1 rank | 2 ranks |", "|---|---|---|"]
    scale = {"wall": 1e3}
    for name, key, form in ROWS:
        values = [form.format(each[key] * scale.get(key, 1)) for each in (one, two)]
        lines.append(f"| {name} | {values[0]} | {values[1]} |")
    lines.append(f"| faster than one rank | 1 | {one['wall'] / two['wall']:.2f} |")
    return lines


def compare(options, spacing=None):
    """Measure one rank and two in turn; return the table."""
    runs = {1: [], 2: []}
    for _ in range(options.rounds):
        for ranks, done in runs.items():
            done.append(run(ranks, options, spacing))
    what = "Main job" if spacing is None else f"{TANK.relative_to(ROOT)} at a spacing of {1e3 * spacing:g} mm"
    return table(summary(runs[1]), summary(runs[2]), runs[1][0]["particles"], what)


def main():
    """Run the benchmark, or with --measure one part of it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100, help="steps a window")
    parser.add_argument("--windows", type=int, default=2, help="windows a run")
    parser.add_argument("--warm-up", type=int, default=60, help="steps before the first window")
    parser.add_argument("--rounds", type=int, default=2, help="runs on one rank and on two, in turn")
    parser.add_argument("--memory", type=int, metavar="STEPS", help="only tell how memory grows over so many steps")
    parser.add_argument("--spacings", type=float, nargs="+", metavar="M", help="run the 3D tank at these spacings")
    parser.add_argument("--measure", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.measure:
        found, rank = measure(options.steps, options.windows, options.warm_up, (options.spacings or [None])[0])
        if rank == 0:
            print(json.dumps(found))
        return
    if options.memory:
        options.steps, options.windows = options.memory // 5, 5
        memory = [f"{value / 2**20:.0f}" for value in run(1, options)["memory"]]
        print(f"MiB after the warm-up and every {options.steps} steps: {', '.join(memory)}")
        return
    lines = []
    for spacing in options.spacings or [None]:
        lines += [*compare(options, spacing), ""]
    lines += [
        f"`{'make bench' if not options.spacings else ' '.join(sys.argv)}` at {provenance()}. "
        f"Medians of {options.rounds * options.windows} windows of {options.steps} steps.",
    ]
    text = "\n".join(lines) + "\n"
    (ROOT / "jobs" / "benchmarks" / ("results_3d.md" if options.spacings else "results.md")).write_text(text)
    print(text)


if __name__ == "__main__":
    main()
