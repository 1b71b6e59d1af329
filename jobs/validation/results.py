"""What a finished run left behind, for the measurements of the cases."""

import json
from pathlib import Path

import numpy as np

from parmps.figures.results import read_frame, read_job, read_times
from parmps.particles import FLUID
from parmps.signals import read_signals


class Results:
    """Results of one run.

    Parameters
    ----------
    directory : path-like

    Attributes
    ----------
    record : dict
        run.json.
    job : parmps.scene.Job
        As it was run.
    time : (n,) float64, s
        Of the probe samples.
    """

    def __init__(self, directory):
        self.directory = Path(directory)
        self.record = json.loads((self.directory / "run.json").read_text())
        self.job, self.frames = read_job(directory), read_times(directory)
        self.time, signals = read_signals(self.directory / "probes.csv")
        self._signals = {name: values for name, _, values in signals}

    def probe(self, name):
        """Signal of a probe: (n,) float64."""
        return self._signals[name]

    def probes(self, start):
        """Signals of all probes whose name starts so, in the order of the job: (n, count) float64."""
        return np.stack([values for name, values in self._signals.items() if name.startswith(start)], axis=1)

    def liquid(self, time):
        """Fields of the liquid in the frame nearest to a time: dict of (n, ...) arrays."""
        arrays = read_frame(self.directory, time).arrays
        chosen = arrays["type"] == FLUID
        return {name: values[chosen] for name, values in arrays.items()}

    def first_mode(self):
        """First mode of the elevation in each frame, from the centre of the liquid: (frames,) float64, m.

        The elevation sum a_n cos(n pi x / L) moves the centre by -2 L / (pi^2 h) sum a_n / n^2 over odd n. Without
        any definition of the surface, it gives a_1 + a_3 / 9 + a_5 / 25 + ...
        """
        length, depth = self.job.tank.length, self.job.fluids[0].depth
        centre = np.array([self.liquid(time)["position"][:, 0].mean() for time in self.frames])
        return (length / 2.0 - centre) * np.pi**2 * depth / (2.0 * length)

    def modes(self, numbers):
        """Modes cos(m pi x / L) cos(n pi y / B) of the elevation of a box in each frame: (frames, modes) float64, m.

        The mean of a mode's shape over the liquid is its share of the elevation over the depth, without any
        definition of the surface: 1/2 of it where one of m and n is 0, 1/4 where none is.

        Parameters
        ----------
        numbers : sequence of (m, n)
        """
        (length, width, _), depth = self.job.tank.size, self.job.fluids[0].depth
        rows = []
        for time in self.frames:
            x, y, _ = self.liquid(time)["position"].T
            shapes = [np.cos(m * np.pi * x / length) * np.cos(n * np.pi * y / width) for m, n in numbers]
            rows.append([shape.mean() for shape in shapes])
        return depth * np.array(rows) * [2.0 if 0 in pair else 4.0 for pair in numbers]


def rms(values):
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def read_reference(path):
    """Read a table whose head is lines that begin with #: (rows, columns) float64."""
    return np.loadtxt(path, delimiter=",", comments="#", ndmin=2)
