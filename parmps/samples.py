"""Samples: one row of all probes at each sampling time.

Gauges are read at that time. Loads are means over the interval around it, from the middle between it and the sample
before to the middle between it and the next one. The value of a step counts for the time that is nearer to it than to
any other step: there is no lag, and the sum over all samples of mean times interval is that over all steps, however
far apart the samples are. The first and the last interval are halves. So a row is known when the next sample is taken.

A rank keeps the sums of its own wall particles step by step, and the ranks add them up once a sample.
"""

import numpy as np

from parmps.loads import Loads

MOST_STEPS = 256
"""Steps that are kept at most until the ranks add up their sums."""
SLIVER = 1e-9
"""Share of a step that an interval must have of it: less is rounding where an interval ends midway between steps."""


class Interval:
    """What the loads were so far in the interval around a sample.

    Parameters
    ----------
    elapsed : float
        s.
    integral, highest : (signals,) float64
        Of the values over that time, and of them.
    """

    def __init__(self, elapsed, integral, highest):
        self.elapsed = elapsed
        self.integral, self.highest = np.array(integral), np.array(highest)

    @classmethod
    def empty(cls, signals):
        """One that has not begun."""
        return cls(0.0, np.zeros(signals), np.full(signals, -np.finfo(float).max))

    def add(self, seconds, values):
        """Add a time with these values."""
        self.elapsed += seconds
        self.integral += seconds * values
        np.maximum(self.highest, values, out=self.highest)

    def state(self):
        """What makes an equal one: a list that JSON keeps to the last digit."""
        return [self.elapsed, self.integral.tolist(), self.highest.tolist()]


class Samples:
    """Rows of ``probes.csv``.

    Parameters
    ----------
    probes : list
        As made by `parmps.probes.build_probes`.
    domain : Domain
    particles : Particles
    schedule : object
        ``after(time)`` gives the time of the next sample, s.
    viscous : bool
        Whether friction acts on walls.

    Raises
    ------
    InputError
        On all ranks: no particle measures a probe.
    """

    def __init__(self, probes, domain, particles, schedule, viscous):
        self.probes, self.domain, self.schedule = probes, domain, schedule
        self.gauges = [probe for probe in probes if hasattr(probe, "value")]
        self.loads = Loads([probe for probe in probes if not hasattr(probe, "value")], domain, viscous)
        self.loads.bind(particles)
        self.signals = sum(load.signals for load in self.loads.loads)
        self.pending, self.sampled = None, None
        self.time, self.value = None, np.zeros(self.signals)
        self.now, self.later = Interval.empty(self.signals), Interval.empty(self.signals)
        self._steps = []

    @property
    def columns(self):
        """Titles of the columns and what they are: dict of str to str."""
        return {title: meaning for probe in self.probes for title, meaning in probe.columns.items()}

    def step(self, time, particles, density, frame, friction):
        """Take notice of a step; collective now and then.

        Parameters
        ----------
        time : float
            Of the fields, s; nothing happens where it has been seen.
        particles, density, frame, friction
            As in `Loads.sums`.
        """
        if not self.signals or time == (self._steps[-1][0] if self._steps else self.time):
            return
        self._steps.append((time, frame, self.loads.sums(particles, density, frame, friction)))
        if len(self._steps) == MOST_STEPS:
            self.flush()

    def flush(self):
        """Add up what the ranks keep; collective."""
        if not self._steps:
            return
        times, frames, sums = zip(*self._steps, strict=True)
        self._steps = []
        sums = self.domain.sum(np.array(sums).ravel()).reshape(len(times), -1)
        edge = np.inf if self.sampled is None else 0.5 * (self.sampled + self.schedule.after(self.sampled))
        for time, value in zip(times, self.loads.values(sums, frames), strict=True):
            if self.time is not None:
                middle = 0.5 * (self.time + time)
                self._spread(self.time, middle, self.value, edge)
                self._spread(middle, time, value, edge)
            self.time, self.value = time, value

    def _spread(self, begin, end, value, edge):
        """Add a part of a step to the interval of the last sample, and what is beyond its edge to the next one."""
        sliver = SLIVER * (end - begin)
        if min(end, edge) - begin > sliver:
            self.now.add(min(end, edge) - begin, value)
        if end - max(begin, edge) > sliver:
            self.later.add(end - max(begin, edge), value)

    def take(self, time, state):
        """Take a sample; collective.

        Parameters
        ----------
        time : float
            s.
        state : object
            For the gauges; see `parmps.gauges`.

        Returns
        -------
        list of (float, list of float)
            Time and values of the rows that are whole now.
        """
        if time == self.sampled:
            return []
        self.flush()
        rows = self.rows()
        if self.sampled is not None:
            self.now, self.later = self.later, Interval.empty(self.signals)
        parts = [gauge.partial(state) for gauge in self.gauges]
        sums = self.domain.sum(np.concatenate([*parts, [0.0]]))
        ends = np.cumsum([len(part) for part in parts])
        pieces = np.split(sums, ends)[:-1]
        self.pending = [gauge.value(piece).tolist() for gauge, piece in zip(self.gauges, pieces, strict=True)]
        self.sampled = time
        return rows

    def rows(self):
        """Rows of the last sample with what is known of its interval; there is none before the first sample.

        Returns
        -------
        list of (float, list of float)
        """
        if self.pending is None:
            return []
        begun = self.now.elapsed > 0.0
        mean, highest = (self.now.integral / self.now.elapsed, self.now.highest) if begun else (self.value, self.value)
        gauges, values, at = iter(self.pending), [], 0
        for probe in self.probes:
            if hasattr(probe, "value"):
                values += next(gauges)
                continue
            part = slice(at, at + probe.signals)
            values += [*mean[part], *(highest[part] if probe.peaks else [])]
            at += probe.signals
        return [(self.sampled, values)]

    def forget_row(self):
        """Leave the last sample's row to those who have it, and go on with the next one."""
        self.pending = None

    def state(self):
        """What a restart needs to go on, once all is added up: a dict that JSON keeps to the last digit."""
        return {
            "columns": list(self.columns),
            "pending": self.pending,
            "sampled": self.sampled,
            "time": self.time,
            "value": self.value.tolist(),
            "now": self.now.state(),
            "later": self.later.state(),
        }

    def restore(self, state):
        """Go on from a state; probes that it does not know have no value until their first sample of their own.

        Parameters
        ----------
        state : dict
            As returned by `state`.
        """
        self._steps = []
        titles = state["columns"]
        known = [probe for probe in self.probes if set(probe.columns) <= set(titles)]
        known.sort(key=lambda probe: titles.index(next(iter(probe.columns))))
        gauges, loads = ([p for p in known if hasattr(p, "value") == instant] for instant in (True, False))
        self.sampled, self.time = state["sampled"], state["time"]
        if state["pending"] is not None:
            values = dict(zip(map(id, gauges), state["pending"], strict=True))
            self.pending = [values.get(id(gauge), [np.nan] * len(gauge.columns)) for gauge in self.gauges]
        begins = dict(zip(map(id, loads), np.cumsum([0, *(load.signals for load in loads)]), strict=False))
        places = np.concatenate([
            begins[id(load)] + np.arange(load.signals) if id(load) in begins else np.full(load.signals, -1)
            for load in self.loads.loads
        ] or [np.empty(0)]).astype(int)

        def signals(values):
            return np.append(values, np.nan)[places]

        self.value = signals(state["value"])
        self.now, self.later = (Interval(t, signals(a), signals(b)) for t, a, b in (state["now"], state["later"]))
