"""A report of a run or a sweep, to be sent to a colleague: one HTML page, pictures included, or a PDF.

A section is a title with its content: a figure, a table (rows of cells, the first its header), or text that keeps its
lines.
"""

import base64
import html
import io
import json
import textwrap
from pathlib import Path

import numpy as np

import parmps
from parmps.campaign import results_path
from parmps.errors import InputError
from parmps.figures.charts import draw_sweep, read_table
from parmps.figures.curves import draw_histories, draw_phases, draw_spectra
from parmps.figures.results import read_job, read_times
from parmps.figures.snapshots import draw_snapshots, make_view
from parmps.figures.style import new_figure
from parmps.figures.tables import aligned, forcing, peak_rows, peak_table
from parmps.loader import job_text
from parmps.motion import forcing_period
from parmps.output import write_text
from parmps.report import timer_table
from parmps.signals import LEAST_SAMPLES, principal, read_signals
from parmps.slabs import output_errors

SNAPSHOTS = 4
PAGE_LINES, PAGE_COLUMNS = 60, 120
"""Of a page of text in a PDF."""
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1000px; margin: 2em auto; padding: 0 1em; color: #222; }
h1 { font-size: 1.6em; } h2 { font-size: 1.2em; margin-top: 2em; border-bottom: 1px solid #ccc; }
img { max-width: 100%; } pre { background: #f5f5f5; padding: 1em; overflow-x: auto; font-size: 13px; }
table { border-collapse: collapse; font-size: 13px; display: block; overflow-x: auto; }
td, th { padding: 0.2em 0.8em; border-bottom: 1px solid #ddd; text-align: right; white-space: nowrap; }
td:first-child, th:first-child { text-align: left; }
"""


def run_sections(directory, reference=None):
    """Put the report of a run together.

    Parameters
    ----------
    directory : path-like
        Its output directory.
    reference : path-like, optional
        Table of signals to draw beside the run's.

    Returns
    -------
    title : str
    sections : list of tuple
        Title (str) and content.
    directory : Path
        Where the report belongs.

    Raises
    ------
    InputError
        If the results cannot be read.
    """
    directory = Path(directory)
    job, times = read_job(directory), read_times(directory)
    sections = _record(directory)
    if (directory / "probes.csv").exists() and job.probes:
        time, signals = read_signals(directory / "probes.csv")
        signals = principal(signals)
        known = None if reference is None else read_signals(reference)
        omega = forcing(job)
        sections.append(("Probes", draw_histories({"run": (time, signals)}, known)))
        enough = len(time) >= LEAST_SAMPLES
        note = f": amplitude and phase at the motion's {omega:g} rad/s" if omega else ""
        if enough:
            sections.append((f"Peaks{note}", peak_table(peak_rows(time, signals, omega, forcing_period(job.motion)))))
            sections.append(("Spectra", draw_spectra(time, signals, [omega] if omega else [])))
        if enough and omega and omega * time[-1] > 4.0 * np.pi:
            sections.append(("Phases", draw_phases(time, signals, omega)))
    moments = np.unique(np.linspace(0, len(times) - 1, SNAPSHOTS).round().astype(int))
    for field in ("pressure", "speed"):
        picture = draw_snapshots(directory, make_view(directory, field), times[moments])
        sections.append((f"Snapshots: {field}", picture))
    sections.append(("Job", job_text(job)))
    return job.title or "Run", sections, directory


def sweep_sections(sweep):
    """Put the report of a sweep together.

    Parameters
    ----------
    sweep : Sweep

    Returns
    -------
    title : str
    sections : list of tuple
        Title (str) and content.
    directory : Path
        Where the report belongs.

    Raises
    ------
    InputError
        If its table or a reference cannot be read.
    """
    header, rows = read_table(results_path(sweep))
    sections = [*draw_sweep(sweep).items(), ("Results", [header, *rows])]
    return sweep.title or "Sweep", sections, results_path(sweep).parent


def _record(directory):
    """Summarise run.json, if the run has come to an end, and its timers."""
    try:
        record = json.loads((directory / "run.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return [("Run", "The run has not ended yet.\n")]
    except (OSError, ValueError) as error:
        raise InputError("", f"{directory / 'run.json'}: cannot be read: {error}") from None
    rows = [
        ["run", f"parmps {record['versions']['parmps']}"],
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
    return [("Run", rows), ("Time", timer_table(record["stage_seconds"], record["wall_seconds"]))]


def write_html(path, title, sections):
    """Write a report as one page that needs no other file.

    Parameters
    ----------
    path : path-like
    title : str
    sections : list of tuple
        As `run_sections` returns them; the figures are closed.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    name = html.escape(title)
    body = "\n".join(f"<h2>{html.escape(heading)}</h2>\n{_element(content)}" for heading, content in sections)
    write_text(
        path,
        f'<!DOCTYPE html>\n<html lang="en">\n<head><meta charset="utf-8"><title>{name}</title>'
        f"<style>{STYLE}</style></head>\n<body>\n<h1>{name}</h1>\n{body}\n"
        f"<p>Made by parmps {parmps.__version__}.</p>\n</body>\n</html>\n",
    )
    return path


def _element(content):
    """Write the content of a section as HTML."""
    if isinstance(content, str):
        return f"<pre>{html.escape(content)}</pre>"
    if isinstance(content, list):
        return _table(content)
    return _picture(content)


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


def write_pdf(path, title, sections):
    """Write a report as a PDF, with a page for each section, or more for a long text.

    Parameters
    ----------
    path, title, sections
        As of `write_html`.

    Returns
    -------
    Path

    Raises
    ------
    OutputError
        If it cannot be written.
    """
    from matplotlib import pyplot
    from matplotlib.backends.backend_pdf import PdfPages

    with output_errors(path), PdfPages(path, metadata={"Title": title}) as pages:
        for heading, content in sections:
            written = isinstance(content, (str, list))
            for figure in _text_pages(f"{title}: {heading}", content) if written else [content]:
                pages.savefig(figure)
                pyplot.close(figure)
    return path


def _text_pages(heading, content):
    """Set a table or a text on pages."""
    text = aligned(content) if isinstance(content, list) else content
    lines = [part for line in text.splitlines() for part in textwrap.wrap(line, PAGE_COLUMNS) or [""]]
    for first in range(0, len(lines), PAGE_LINES):
        part = lines[first : first + PAGE_LINES]
        figure = new_figure(1.0 + 0.16 * len(part))
        style = {"va": "top", "parse_math": False}
        top = 1.0 - 0.3 / figure.get_figheight()
        figure.text(0.04, top, heading, fontsize="x-large", **style)
        top -= 0.4 / figure.get_figheight()
        figure.text(0.04, top, "\n".join(part), family="monospace", fontsize=8.0, linespacing=1.4, **style)
        yield figure
