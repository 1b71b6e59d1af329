"""A report of a run or a sweep as one HTML page, pictures included, to be sent to a colleague."""

import base64
import html
import io
import json
from pathlib import Path

import numpy as np

import parmps
from parmps.campaign import results_path
from parmps.errors import InputError
from parmps.figures.charts import draw_sweep, read_table
from parmps.figures.curves import draw_histories, draw_phases, draw_spectra
from parmps.figures.results import read_job, read_times
from parmps.figures.snapshots import draw_snapshots, make_view
from parmps.figures.tables import forcing, peak_rows, peak_table
from parmps.loader import job_text
from parmps.output import write_text
from parmps.report import timer_table
from parmps.signals import read_signals

SNAPSHOTS = 4
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1000px; margin: 2em auto; padding: 0 1em; color: #222; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ccc; }
img { max-width: 100%; } pre { background: #f5f5f5; padding: 1em; overflow-x: auto; font-size: 13px; }
table { border-collapse: collapse; font-size: 13px; display: block; overflow-x: auto; }
td, th { padding: 0.2em 0.8em; border-bottom: 1px solid #ddd; text-align: right; white-space: nowrap; }
td:first-child, th:first-child { text-align: left; }
"""


def write_run_page(directory, reference=None):
    """Write the report of a run.

    Parameters
    ----------
    directory : path-like
        Its output directory.
    reference : path-like, optional
        Table of signals to draw beside the run's.

    Returns
    -------
    Path
        ``report.html`` in the directory.

    Raises
    ------
    InputError
        If the results cannot be read.
    OutputError
        If the page cannot be written.
    """
    directory = Path(directory)
    job, times = read_job(directory), read_times(directory)
    parts = [_record(directory)]
    if (directory / "probes.csv").exists() and job.probes:
        time, signals = read_signals(directory / "probes.csv")
        known = None if reference is None else read_signals(reference)
        omega = forcing(job)
        parts += [_section("Probes", _picture(draw_histories({"run": (time, signals)}, known)))]
        table = peak_table(peak_rows(time, signals, omega))
        note = f"Amplitude and phase at the motion's {omega:g} rad/s." if omega else "The motion is no sine."
        parts += [_section("Peaks", f"<p>{note}</p>" + _table(table))]
        if len(time) > 2:
            parts += [_section("Spectra", _picture(draw_spectra(time, signals, [omega] if omega else [])))]
        if omega and omega * time[-1] > 4.0 * np.pi:
            parts += [_section("Phases", _picture(draw_phases(time, signals, omega)))]
    moments = np.unique(np.linspace(0, len(times) - 1, SNAPSHOTS).round().astype(int))
    for field in ("pressure", "speed"):
        picture = draw_snapshots(directory, make_view(directory, field), times[moments])
        parts.append(_section(f"Snapshots: {field}", _picture(picture)))
    parts.append(_section("Job", f"<pre>{html.escape(job_text(job))}</pre>"))
    return _write(directory / "report.html", job.title or "Run", parts)


def write_sweep_page(sweep):
    """Write the report of a sweep.

    Parameters
    ----------
    sweep : Sweep

    Returns
    -------
    Path
        ``report.html`` in its directory.

    Raises
    ------
    InputError
        If its table or a reference cannot be read.
    OutputError
        If the page cannot be written.
    """
    parts = []
    for picture in draw_sweep(sweep):
        data = base64.b64encode(picture.read_bytes()).decode()
        parts.append(_section(picture.stem, f'<img alt="figure" src="data:image/png;base64,{data}">'))
    header, rows = read_table(results_path(sweep))
    parts.append(_section("Results", _table([header, *rows])))
    return _write(results_path(sweep).with_name("report.html"), sweep.title or "Sweep", parts)


def _record(directory):
    """Summarise run.json, if the run has come to an end, and its timers."""
    try:
        record = json.loads((directory / "run.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return "<p>The run has not ended yet.</p>"
    except (OSError, ValueError) as error:
        raise InputError("", f"{directory / 'run.json'}: cannot be read: {error}") from None
    rows = [
        ["status", record["status"]],
        ["simulated", f"{record['simulated_seconds']:g} s in {record['steps']} steps"],
        ["wall time", f"{record['wall_seconds']:.1f} s on {record['ranks']} rank(s)"],
        ["particles", ", ".join(f"{count} {kind}" for kind, count in record["particles"].items())],
        ["time step", f"{record['time_step']['min'] * 1e3:.3g} to {record['time_step']['max'] * 1e3:.3g} ms"],
        ["iterations a step", f"{record['ksp']['iterations_mean']:.1f}"],
        ["energy drift", f"{record['energy_drift']:+.2%}"],
    ]
    if record["volume_drift"] is not None:
        rows.append(["volume drift", f"{record['volume_drift']:+.2%}"])
    timers = html.escape(timer_table(record["stage_seconds"], record["wall_seconds"]))
    return _table([["run", f"parmps {record['versions']['parmps']}"], *rows]) + _section("Time", f"<pre>{timers}</pre>")


def _section(title, content):
    return f"<h2>{html.escape(title)}</h2>\n{content}"


def _table(rows):
    lines = []
    for number, row in enumerate(rows):
        tag = "td" if number else "th"
        lines.append("<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in row) + "</tr>")
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _picture(figure):
    """Put a figure into the page itself, and close it."""
    from matplotlib import pyplot

    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=110)
    pyplot.close(figure)
    return f'<img alt="figure" src="data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}">'


def _write(path, title, parts):
    name = html.escape(title)
    body = "\n".join(parts)
    write_text(
        path,
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{name}</title>'
        f"<style>{STYLE}</style></head>\n<body>\n<h1>{name}</h1>\n{body}\n"
        f"<p>Made by parmps {parmps.__version__}.</p>\n</body>\n</html>\n",
    )
    return path
