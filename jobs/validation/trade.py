"""What accuracy costs: one setting at a time around `balanced`, on three scenes (``make trade``).

usage: python jobs/validation/trade.py [--scene NAME ...] [--limit S] [--report]

Runs are kept as those of run.py are. Writes jobs/validation/trade.csv: scene, setting, error in %, CPU-seconds of
the time loop; postproc/trade.py draws it.
"""

import argparse
import csv

import numpy as np
import run
from results import Results, rms

STEPS = [f"time.max_step={step:g}" for step in (0.016, 0.008, 0.002)]
COURANT = [f"time.cfl={number:g}" for number in (0.8, 0.4, 0.1)]
SCENES = {
    "standing wave": ("standing_wave", "", "centre [%]", (0.04, 0.02, 0.01), STEPS),
    "surge sloshing": ("surge", "0.9", "centre [%]", (0.04, 0.02, 0.01), STEPS),
    "dam break": ("dam_break_front", "", None, (0.0146, 0.0073, 0.00365), COURANT),
}
"""Case, variant, measure that is the error, spacings of which the second is that of the other settings, and steps."""

CHANGES = (
    "scheme.laplacian_radius=3.1",
    "scheme.laplacian_radius=4.01",
    "scheme.ksp_rtol=1e-1",
    "scheme.ksp_rtol=1e-2",
    "scheme.ksp_rtol=1e-4",
    "scheme.ksp_rtol=1e-6",
)


def settings(spacings, steps):
    """Preset, spacing and change of each run."""
    yield from (("balanced", spacing, "") for spacing in spacings)
    yield from ((preset, spacings[1], "") for preset in run.PRESETS if preset != "balanced")
    yield from (("balanced", spacings[1], change) for change in (*steps, *CHANGES))


def error(case, results, measure, finest):
    """Error of a run, %: the case's measure, or without one the front's difference from the finest run's."""
    if measure:
        return abs(case.measure(results)[measure])
    (time, reached), (when, wanted) = case.history(results), case.history(finest)
    before_wall = wanted < case.REACH
    return 100.0 * rms(np.interp(when, time, reached)[before_wall] - wanted[before_wall]) / rms(wanted[before_wall])


def main():
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scene", action="append", choices=SCENES, help="all by default")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds a run may take")
    parser.add_argument("--report", action="store_true", help="run nothing, only write down the runs that are kept")
    options = parser.parse_args()
    rows = []
    for scene, (name, variant, measure, spacings, steps) in SCENES.items():
        case = run.load_case(name)
        runs = [run.Kept(name, case, variant, *setting) for setting in settings(spacings, steps)]
        for one in runs:
            if one.status is None and scene in (options.scene or SCENES) and not options.report:
                one.run(options.limit)
        done = [one for one in runs if one.status == "done"]
        finest = min(done, key=lambda one: one.spacing, default=None)
        for one in done:
            results = Results(one.directory)
            if measure or one is not finest:
                found = error(case, results, measure, finest and Results(finest.directory))
                label = one.change or f"{one.preset}, {one.spacing:g} m"
                rows.append([scene, label, f"{found:.3g}", f"{results.record['cpu_seconds']:.3g}"])
        rows += [[scene, one.change or f"{one.preset}, {one.spacing:g} m", one.status, ""] for one in runs
                 if one.status not in ("done", None)]
    with open(run.HERE / "trade.csv", "w", newline="") as file:
        csv.writer(file).writerows([["scene", "setting", "error [%]", "CPU time [s]"], *rows])


if __name__ == "__main__":
    main()
