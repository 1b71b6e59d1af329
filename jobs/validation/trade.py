"""What accuracy costs, in several scenes (``make trade``).

usage: python jobs/validation/trade.py [--scene NAME ...] [--limit S] [--report]

Every preset at several spacings, and at the middle one `balanced` with one setting changed at a time: reach of the
Laplacian, time step, tolerance of the pressure solver, rebuild rule of its multigrid hierarchy. Runs are kept as those
of run.py are, on one rank. Writes

- jobs/validation/trade.csv, one line a run: what was set, its error, the error of the wave's amplitude where there is
  one, and CPU-seconds of the time loop, less those of the shortest run; postproc/trade.py draws it, and finds the
  fronts and the presets on them;
- parmps/trade.csv, what ``plan`` tells expected errors and costs from: the presets alone.
"""

import argparse
import csv
from typing import NamedTuple

import numpy as np
import run
from provenance import provenance
from results import Results, rms

COLUMNS = [
    "scene", "preset", "change", "dimension", "spacing [m]", "rows", "particles", "steps", "error [%]",
    "amplitude [%]", "CPU time [s]", "note",
]  # fmt: skip
TABLE = ("scene", "preset", "dimension", "rows", "particles", "steps", "error [%]", "CPU time [s]")
"""Columns of the package's table."""


class Scene(NamedTuple):
    """One scene of the study.

    Attributes
    ----------
    case, variant : str
        Of the validation.
    changes : tuple of str
        What is changed in it: no bound of the step but those of the scheme, and a shorter run.
    depth : float, m
        Of the liquid, or height of the column.
    spacings : tuple of float, m
        Of the presets, coarsest first.
    papers : tuple of float, m
        Of the papers' scheme, which is too dear for the others.
    knobs : float or None
        Spacing at which settings are changed one at a time.
    measure : function
        Error and error of the amplitude or None, %, of the case, a run's results and those of the finest run.
    """

    case: str
    variant: str
    changes: tuple
    depth: float
    spacings: tuple
    papers: tuple
    knobs: float | None
    measure: callable


def wave_errors(case, results, _):
    """Rms of the first mode's difference from potential flow over its rms, and the worst amplitude of a period."""
    found = case.measure(results)
    return found["centre [%]"], found["amplitude [%]"]


def sloshing_errors(case, results, _):
    """Rms of the gauge's difference from nonlinear potential flow over its rms, and the worst amplitude of a period."""
    time, eta = results.time, results.probe("gauge") - results.job.fluids[0].depth
    flow, omega = case.potential(results.job, float(time[-1]), len(time)), results.job.motion[0].omega
    amplitudes = run.load_case("standing_wave").amplitudes
    periods = int(time[-1] * omega / (2.0 * np.pi))
    ratio = amplitudes(time, eta, omega, periods) / amplitudes(time, flow, omega, periods) - 1.0
    return 100.0 * rms(eta - flow) / rms(flow), 100.0 * float(ratio[np.abs(ratio).argmax()])


def front_errors(case, results, finest):
    """Rms of the front's difference from the finest run's over its rms."""
    (time, reached), (when, wanted) = case.history(results), case.history(finest)
    before_wall = wanted < case.REACH
    difference = np.interp(when, time, reached) - wanted
    return 100.0 * rms(difference[before_wall]) / rms(wanted[before_wall]), None


def rest_errors(case, results, _):
    """Rms of the pressure's difference from hydrostatics over that on the floor."""
    return case.measure(results)["pressure [% of rho g h]"], None


GAUGES = ", ".join(f"{{name: eta{n}, kind: elevation, at: [{0.125 + 0.25 * n}, 0.1]}}" for n in range(4))
SCENES = {
    "standing wave": Scene(
        "standing_wave", "", ("output.probes_every=0.06",), 0.5,
        (0.0625, 0.04, 0.02, 0.01), (0.04, 0.02828, 0.02), 0.02, wave_errors,
    ),
    "resonant sloshing": Scene(
        "faltinsen", "", ("time.end=5", "output.probes_every=0.05"), 0.6,
        (0.06, 0.04, 0.02, 0.01), (0.06, 0.04, 0.02), 0.02, sloshing_errors,
    ),
    "dam-break front": Scene(
        "dam_break_front", "", (), 0.292, (0.0146, 0.0073, 0.00365), (0.0146,), 0.0073, front_errors,
    ),
    "water at rest": Scene(
        "rest", "plain", ("time.end=5",), 0.25, (0.025, 0.01, 0.005), (0.025,), 0.01, rest_errors,
    ),
    "standing wave, 3D": Scene(
        "standing_wave", "",
        ("output.probes_every=0.06", "dimension=3", "tank.size=[1.0, 0.2, 0.7]", f"probes=[{GAUGES}]"), 0.5,
        (0.05, 0.03333), (), None, wave_errors,
    ),
}  # fmt: skip

CHANGES = (
    "scheme.laplacian_radius=3.1",
    "scheme.steady_step=0.4",
    "scheme.courant=0.2",
    "scheme.courant=0.8",
    "scheme.ksp_rtol=1e-2",
    "scheme.ksp_rtol=1e-4",
    "scheme.ksp_rtol=1e-5",
    "scheme.hierarchy_excess=5",
    "scheme.hierarchy_excess=400",
    "scheme.courant=0.8 scheme.steady_step=0.4",
    "scheme.courant=0.2 scheme.steady_step=0.125 scheme.ksp_rtol=1e-5",
)
"""What is changed in `balanced`, as for ``--set``; the last two go further than `fast` and `accurate`."""


REPEATS = 2
"""More runs of each preset at the spacing of the changes: the least of the CPU times is the cost, since other programs
that run on the machine only add to it."""

TIMES = f"CPU times of the presets at the spacing of the changes are the least of {1 + REPEATS} runs."


def settings(scene):
    """Preset, spacing and change of each run of a scene: the finest `balanced` first, which others may refer to."""
    finest = scene.spacings[-1]
    yield "balanced", finest, ""
    for preset in ("balanced", "fast", "accurate"):
        for spacing in scene.spacings:
            # the finest of the dearest preset would take as long as all the others
            if (preset, spacing) != ("balanced", finest) and (preset != "accurate" or spacing != finest):
                yield preset, spacing, ""
    yield from (("papers", spacing, "") for spacing in scene.papers)
    if scene.knobs:
        yield from (("balanced", scene.knobs, change) for change in CHANGES)


def start_up(name, scene, case, limit):
    """CPU-seconds before the first steps, such as for loading the compiled kernels.

    Parameters
    ----------
    name : str
        Of the scene.
    scene : Scene
    case : module
    limit : float or None
        Seconds a run may take; None to run nothing.

    Returns
    -------
    float
        Those of a run until the first sample.
    """
    short = (*scene.changes, "time.end=0.01", "output.probes_every=0.01")
    label = f"start-{name}"
    kept = run.Kept(scene.case, case, scene.variant, "balanced", scene.spacings[0], short, label)
    if kept.status is None and limit is not None:
        # they compile, where the code is new; what they take then does not count
        for preset in ("papers", "balanced"):
            run.Kept(scene.case, case, scene.variant, preset, scene.spacings[0], short, label).run(limit)
        kept.run(limit)
    return Results(kept.directory).record["cpu_seconds"] if kept.status == "done" else 0.0


def rows_of(name, scene, runs, before):
    """Lines of trade.csv from the runs of a scene that are kept, less the CPU-seconds before their first steps."""
    case, finest = runs[0][0].case, runs[0][0]
    for kept, change, again in runs:
        if kept.status is None:
            continue
        row = {"scene": name, "preset": kept.preset, "change": change, "spacing [m]": f"{kept.spacing:g}"}
        if kept.status != "done":
            yield row | {"note": kept.status}
            continue
        results = Results(kept.directory)
        record = results.record
        same = [Results(each.directory).record for each in again if each.status == "done"]
        seconds = min(each["cpu_seconds"] for each in (record, *same))
        error, amplitude = (None, None)
        if finest.status == "done":
            error, amplitude = scene.measure(case, results, Results(finest.directory))
        yield row | {
            "dimension": results.job.dimension,
            "rows": f"{scene.depth / kept.spacing:.3g}",
            "particles": record["particles"]["total"],
            "steps": record["steps"],
            "error [%]": "" if not error else f"{error:.3g}",  # a reference has no error
            "amplitude [%]": "" if amplitude is None else f"{amplitude:.3g}",
            "CPU time [s]": f"{max(seconds - before, 0.01):.3g}",
        }


def write(path, columns, rows, comment=()):
    """Write a table."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {line}\n" for line in comment)
        writer = csv.DictWriter(file, columns, restval="", extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def main():
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", action="append", choices=SCENES, help="all by default")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds a run may take")
    parser.add_argument("--report", action="store_true", help="run nothing, only write down the runs that are kept")
    options = parser.parse_args()
    rows = []
    for name, scene in SCENES.items():
        case = run.load_case(scene.case)
        runs = []
        for preset, spacing, change in settings(scene):
            changes = (*scene.changes, *change.split())
            labels = ["-".join(filter(None, ["trade", name, change]))]
            if spacing == scene.knobs and not change:
                labels += [f"{labels[0]}-again-{number}" for number in range(REPEATS)]
            kept, *again = (run.Kept(scene.case, case, scene.variant, preset, spacing, changes, at) for at in labels)
            runs.append((kept, change, again))
        running = name in (options.scene or SCENES) and not options.report
        before = start_up(name, scene, case, options.limit if running else None)
        for kept, _, again in runs:
            for each in (kept, *again):
                if running and each.status is None:
                    each.run(options.limit)
        rows += rows_of(name, scene, runs, before)
    write(run.HERE / "trade.csv", COLUMNS, rows, [f"`make trade` at {provenance()} {TIMES}"])
    presets = [row for row in rows if row.get("error [%]") and not row["change"]]
    write(run.ROOT / "parmps" / "trade.csv", TABLE, presets, [f"Measured by jobs/validation/trade.py, {provenance()}."])


if __name__ == "__main__":
    main()
