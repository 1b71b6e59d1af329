"""The command ``plot``: what each of its kinds takes from the command line, draws and writes."""

import argparse
import csv
import io
from pathlib import Path

from parmps.errors import InputError
from parmps.figures.style import save
from parmps.motion import forcing_period
from parmps.output import write_text
from parmps.signals import LEAST_SAMPLES, find_signal, principal, read_signals


def add_commands(parser):
    """Add the kinds of figures to the parser of ``plot``.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        Its arguments then have ``draw``, a function that takes them and returns the exit status.
    """
    kinds = parser.add_subparsers(dest="kind", metavar="KIND", required=True)

    def add(name, draw, about, example="out/job", source="DIR"):
        line = f"example: {parser.prog} {name} {example}"
        description = about[0].upper() + about[1:] + "."
        plain = argparse.RawDescriptionHelpFormatter
        command = kinds.add_parser(name, help=about, description=description, epilog=line, formatter_class=plain)
        command.set_defaults(draw=draw)
        command.add_argument("source", metavar=source, help="directory of a run" if source == "DIR" else None)
        return command

    command = add(
        "probes",
        _probes,
        "signals of the probes over time, into DIR/probes.png",
        "out/job --signals P1 P2 --reference measured.csv",
    )
    command.add_argument("others", metavar="DIR", nargs="*", help="more runs to draw in the same panels")
    command.add_argument("--reference", metavar="FILE.csv", help="signals to draw beside them, as in probes.csv")
    _add_signals(command)
    command.add_argument("--show", action="store_true", help="open a window as well")
    about = "the particles at one or more times, into DIR/particles_FIELD.png"
    command = add("particles", _particles, about, "out/job --time 1 2 3 --field speed")
    command.add_argument("--time", metavar="T", type=float, nargs="+", default=[None], help="s; the last if not given")
    _add_view(command)
    about = "all particles of a 3D run in its tank, into DIR/space_FIELD.png; needs PyVista"
    command = add("space", _space, about, "out/job --time 1.5 --field speed")
    command.add_argument("--time", metavar="T", type=float, help="s; the last if not given")
    _add_colours(command)
    about = "amplitude spectra of the signals, into DIR/spectra.png"
    command = add("spectra", _spectra, about, "out/job --begin 2")
    _add_signals(command)
    about = "table of peaks and phases, into DIR/peaks.csv, and the cycles over their phase, into DIR/phases.png"
    command = add("peaks", _peaks, about)
    _add_signals(command)
    about = "an animation of the particles, into DIR/particles_FIELD.gif"
    command = add("animation", _animation, about, "out/job --rate 20 --end 5")
    _add_view(command)
    command.add_argument("--begin", metavar="T", type=float, help="s")
    command.add_argument("--end", metavar="T", type=float, help="s")
    command.add_argument("--rate", metavar="N", type=float, default=10.0, help="frames a second (default 10)")
    command.add_argument("--format", choices=("gif", "mp4"), default="gif", help="mp4 needs ffmpeg")
    about = "a figure a measure of a sweep, beside its results.csv"
    add("sweep", _sweep, about, "sweep.yaml", "SWEEP.yaml")
    about = "one HTML page of a run or a sweep, report.html in its directory, or a PDF"
    command = add("report", _report, about, source="DIR|SWEEP.yaml")
    command.add_argument("--reference", metavar="FILE.csv", help="of a run: signals to draw beside its own")
    command.add_argument("--format", choices=("html", "pdf"), default="html", help="pdf: a page a section")


def _add_signals(command):
    command.add_argument("--signals", metavar="NAME", nargs="+", help="these alone, such as P1 or load.Fx")
    command.add_argument("--begin", metavar="T", type=float, help="s")
    command.add_argument("--end", metavar="T", type=float, help="s")


def _add_colours(command):
    command.add_argument("--field", choices=("pressure", "speed", "fluid", "surface"), default="pressure")
    command.add_argument("--frame", choices=("earth", "tank"), default="earth", help="tank: moving with it")


def _add_view(command):
    _add_colours(command)
    command.add_argument("--across", metavar="Y", type=float, help="m; 3D: place of the slice, the middle by default")


def _table(directory, arguments, least=LEAST_SAMPLES):
    """Signals of a run in the window asked for: those asked for, or all that repeat no other; enough samples."""
    time, signals = read_signals(Path(directory) / "probes.csv")
    if not signals:
        raise InputError("", f"{Path(directory) / 'probes.csv'} has no signals: the job has no probes")
    signals = [find_signal(signals, name) for name in arguments.signals] if arguments.signals else principal(signals)
    begin = time[0] if arguments.begin is None else arguments.begin
    end = time[-1] if arguments.end is None else arguments.end
    inside = (time >= begin) & (time <= end)
    if inside.sum() < least:
        found = f"{inside.sum()} samples from {begin:g} s to {end:g} s of a run to {time[-1]:g} s"
        raise InputError("", f"{found}; at least {least} are needed")
    return time[inside], [(name, unit, values[inside]) for name, unit, values in signals]


def _say(*paths):
    print("\n".join(map(str, paths)))
    return 0


def _probes(arguments):
    from parmps.figures.curves import draw_histories
    from parmps.figures.results import run_names

    directories = list(dict.fromkeys([arguments.source, *arguments.others]))
    tables = [_table(directory, arguments, 2) for directory in directories]
    runs = dict(zip(run_names(directories), tables, strict=True))
    reference = None if arguments.reference is None else read_signals(arguments.reference)
    figure = draw_histories(runs, reference, arguments.show)
    if arguments.show:
        from matplotlib import pyplot

        pyplot.show()
    return _say(save(figure, Path(arguments.source) / "probes.png"))


def _particles(arguments):
    from parmps.figures.snapshots import draw_snapshots, make_view

    view = make_view(arguments.source, arguments.field, arguments.frame == "earth", arguments.across)
    figure = draw_snapshots(arguments.source, view, arguments.time)
    return _say(save(figure, Path(arguments.source) / f"particles_{arguments.field}.png"))


def _space(arguments):
    from parmps.figures.snapshots import make_view
    from parmps.figures.space import draw_space

    view = make_view(arguments.source, arguments.field, arguments.frame == "earth")
    path = Path(arguments.source) / f"space_{arguments.field}.png"
    return _say(draw_space(arguments.source, view, arguments.time, path))


def _animation(arguments):
    from parmps.figures.snapshots import animate, make_view

    if not 0.1 <= arguments.rate <= 100.0:
        raise InputError("--rate", f"got {arguments.rate:g}, must be from 0.1 to 100 frames a second")
    view = make_view(arguments.source, arguments.field, arguments.frame == "earth", arguments.across)
    path = Path(arguments.source) / f"particles_{arguments.field}.{arguments.format}"
    animate(arguments.source, view, path, arguments.rate, arguments.begin, arguments.end)
    return _say(path)


def _spectra(arguments):
    from parmps.figures.curves import draw_spectra
    from parmps.figures.results import read_job
    from parmps.figures.tables import forcing

    omega = forcing(read_job(arguments.source))
    figure = draw_spectra(*_table(arguments.source, arguments), [omega] if omega else [])
    return _say(save(figure, Path(arguments.source) / "spectra.png"))


def _peaks(arguments):
    from parmps.figures.curves import draw_phases
    from parmps.figures.results import read_job
    from parmps.figures.tables import aligned, forcing, peak_rows, peak_table

    job, (time, signals) = read_job(arguments.source), _table(arguments.source, arguments)
    omega = forcing(job)
    table = peak_table(peak_rows(time, signals, omega, forcing_period(job.motion)))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(table)
    paths = [Path(arguments.source) / "peaks.csv"]
    write_text(paths[0], text.getvalue())
    if omega:
        paths.append(save(draw_phases(time, signals, omega), Path(arguments.source) / "phases.png"))
    print(aligned(table))
    return _say(*paths)


def _sweep(arguments):
    from parmps.figures.charts import save_sweep
    from parmps.sweep import load_sweep

    return _say(*save_sweep(load_sweep(arguments.source)[0]))


def _report(arguments):
    from parmps.figures.page import run_sections, sweep_sections, write_html, write_pdf
    from parmps.sweep import load_sweep

    if arguments.source.endswith((".yaml", ".yml")):
        title, sections, directory = sweep_sections(load_sweep(arguments.source)[0])
    else:
        title, sections, directory = run_sections(arguments.source, arguments.reference)
    write = {"html": write_html, "pdf": write_pdf}[arguments.format]
    return _say(write(directory / f"report.{arguments.format}", title, sections))
