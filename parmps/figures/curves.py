"""Curves of signals: histories, spectra, and cycles laid over each other; one panel a quantity."""

import numpy as np

from parmps.figures.style import COLOURS, LINES, REFERENCE, finish_panel, new_figure, panel_key, scaled_label
from parmps.signals import peaks, spectrum

SPECTRUM_RANGE = 6.0
"""A spectrum is drawn up to so many times the greatest frequency of the motion, or of its highest line."""
SPECTRUM_DECADES = 4.0


def _panels(tables, height, **options):
    """Make a figure with a panel for each quantity of some signals; yields each with its key as well."""
    keys = sorted({panel_key(name, unit) for signals in tables for name, unit, _ in signals})
    figure = new_figure(1.0 + height * len(keys), options.pop("show", False))
    panels = figure.subplots(len(keys), 1, squeeze=False, **options)[:, 0]
    return figure, list(zip(keys, panels, strict=True))


def _of_panel(signals, key):
    return [signal for signal in signals if panel_key(signal[0], signal[1]) == key]


def draw_histories(runs, reference=None, show=False):
    """Draw signals over time.

    Parameters
    ----------
    runs : dict of str to tuple
        Time (n,) in s and signals, as `parmps.signals.read_signals` returns them, by the name of the run. Of several
        runs, each has its colour, and each signal of a panel its line style; of one run, each signal has its colour.
    reference : tuple, optional
        Time and signals to draw beside them, in black.
    show : bool
        Whether the figure is to be shown in a window.

    Returns
    -------
    matplotlib.figure.Figure
    """
    extra = [] if reference is None else [reference]
    tables = [signals for _, signals in (*runs.values(), *extra)]
    figure, panels = _panels(tables, 2.2, sharex=True, show=show)
    for key, panel in panels:
        shown = [values for signals in tables for _, _, values in _of_panel(signals, key)]
        scale, label = scaled_label(key, max(np.nanmax(np.abs(values), initial=0.0) for values in shown))
        names = list(dict.fromkeys(name for _, signals in runs.values() for name, _, _ in _of_panel(signals, key)))
        for number, (run, (time, signals)) in enumerate(runs.items()):
            for name, _, values in _of_panel(signals, key):
                place = names.index(name)
                colour = COLOURS[(number if len(runs) > 1 else place) % len(COLOURS)]
                line = LINES[place % len(LINES)] if len(runs) > 1 else LINES[number]
                title = f"{name}, {run}" if len(runs) > 1 else name
                panel.plot(time, scale * values, line, color=colour, linewidth=1.2, label=title)
        for time, signals in extra:
            for line, (name, _, values) in zip(LINES[1:] * len(signals), _of_panel(signals, key), strict=False):
                panel.plot(time, scale * values, line, label=f"{name} (reference)", **REFERENCE)
        panel.set_ylabel(label)
        finish_panel(panel)
    first, last = (f(time[at] for time, _ in runs.values()) for f, at in ((min, 0), (max, -1)))
    panels[-1][1].set_xlabel("Time [s]")
    panels[-1][1].set_xlim(first, max(last, first + 1e-9))
    figure.align_ylabels()
    return figure


def draw_spectra(time, signals, omegas=()):
    """Draw the amplitude spectra of signals.

    Parameters
    ----------
    time : (n,) float64
        s.
    signals : list of tuple
        As `parmps.signals.read_signals` returns them.
    omegas : sequence of float
        Frequencies of the tank's motion to mark, rad/s.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, panels = _panels([signals], 2.2, sharex=True)
    lines = {id(values): spectrum(time, values) for _, _, values in signals}
    marks = [omega / (2.0 * np.pi) for omega in omegas]
    highest = [frequency[np.argmax(amplitude)] for frequency, amplitude in lines.values()]
    for key, panel in panels:
        mine = _of_panel(signals, key)
        largest = max(lines[id(values)][1].max() for _, _, values in mine)
        scale, label = scaled_label(key, largest)
        for colour, (name, _, values) in zip(COLOURS * len(mine), mine, strict=False):
            frequency, amplitude = lines[id(values)]
            shown = np.maximum(scale * amplitude, 1e-30)  # a signal that is nought has a logarithm, too
            panel.semilogy(frequency, shown, color=colour, linewidth=1.2, label=name)
        top = max(scale * largest, 1e-12)
        panel.set_ylim(top * 10.0**-SPECTRUM_DECADES, 2.0 * top)
        for number, mark in enumerate(marks):
            panel.axvline(mark, color="0.5", linestyle="--", linewidth=1.0, label=None if number else "motion")
        panel.set_ylabel(f"Amplitude of\n{label[0].lower()}{label[1:]}".replace("\n[", " ["))
        finish_panel(panel)
    panels[-1][1].set_xlabel("Frequency [Hz]")
    limit = SPECTRUM_RANGE * max([*marks, *highest])
    panels[-1][1].set_xlim(0.0, min(limit, frequency[-1]) if limit > 0.0 else frequency[-1])
    figure.align_ylabels()
    return figure


def draw_phases(time, signals, omega):
    """Draw signals over the phase of the motion: all cycles in pale, their mean, and the peak of each cycle.

    Parameters
    ----------
    time : (n,) float64
        s.
    signals : list of tuple
        As `parmps.signals.read_signals` returns them.
    omega : float
        Of the tank's motion, rad/s; its displacement is amplitude sin(omega t + phase_deg).

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, panels = _panels([signals], 2.4, sharex=True)
    turn = omega * time / (2.0 * np.pi)
    bins = np.linspace(0.0, 1.0, 61)
    middle = 0.5 * (bins[1:] + bins[:-1])
    for key, panel in panels:
        mine = _of_panel(signals, key)
        scale, label = scaled_label(key, max(np.abs(values).max() for _, _, values in mine))
        for colour, (name, _, values) in zip(COLOURS * len(mine), mine, strict=False):
            for cycle in range(int(turn[0]), int(turn[-1]) + 1):
                part = (turn >= cycle) & (turn <= cycle + 1)
                panel.plot(360.0 * (turn[part] - cycle), scale * values[part], color=colour, alpha=0.25, linewidth=0.7)
            at = np.digitize(turn % 1.0, bins) - 1
            count = np.bincount(at, minlength=60)[:60]
            with np.errstate(invalid="ignore"):
                mean = np.bincount(at, values, 60)[:60] / count
            panel.plot(360.0 * middle, scale * mean, color=colour, linewidth=2.0, label=name)
            moments, heights = peaks(time, values, 2.0 * np.pi / omega)
            phase = 360.0 * ((omega * moments / (2.0 * np.pi)) % 1.0)
            panel.plot(phase, scale * heights, "o", markersize=4, color=colour, markeredgecolor="white")
        panel.set_ylabel(label)
        finish_panel(panel)
    panels[-1][1].set(xlabel="Phase of the motion, omega t [deg]", xlim=(0.0, 360.0), xticks=range(0, 361, 60))
    figure.align_ylabels()
    return figure
