"""Curves with two continuous derivatives through recorded samples, which have a resolution.

A logger rounds what it records. A curve through the rounded samples has the rounding's second derivative, which is that
of the motion many times over: 5 um at 1000 Hz are 10 m/s2. Where rounding matters, the curve is the smoothest that
stays within half the resolution of every sample; elsewhere it is a cubic spline through them, held back where samples
are too far apart to determine it.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BSpline, CubicSpline, PPoly
from scipy.sparse import diags
from scipy.sparse.linalg import splu

from parmps.rounding import resolution, rounding_matters, scatter, second_differences

DEGREE = 5
EVEN = 0.1
"""Residual of a coarse curve, in half the resolution, below which samples are not rounded."""
LOOSE = 1.5
"""Residual of a least-squares fit, in half the resolution, from which its knots are too few. The residual of the true
curve is at most 1, and a fit by so many samples a knot as there are is less than half of that away from it."""
SAMPLES_A_KNOT = 16
"""Samples of each interval of knots that a least-squares fit looks at."""
SMOOTH = 0.1
"""Weight of roughness: that of a least-squares spline with as few knots as can be counts as much as this share of half
the resolution does at each sample. Of 0.01 to 100 this gives the least error of displacement and, over all, of
acceleration: 0.2 to 1.2 % in sines of 4.5 rad/s with a few tens of steps of their rounding, at 20 to 1000 Hz."""
GAP_STEPS = 4.0
"""Median intervals of samples from which a longer one is a gap."""
ASTRAY = 0.1
"""Share of the range of samples by which a curve may leave it."""
GAP_ROWS = 100_000
"""Samples that all gaps get, at most."""
PARTS = 4
"""Parts of each interval of knots of which the samples furthest off are looked at."""
NEAR = 0.8
"""How far off they are at least, in half the resolution."""
ROUNDS = 10
"""Times that more samples are looked at."""
SIGN = np.array([[1.0], [-1.0]])
"""Of the upper and the lower bound."""
STEPS = 40
"""Steps of the predictor-corrector method, which takes some 12, until a curve is taken not to exist."""
CLOSE = 1e-3
"""Share of the sum to be least that a curve may have too much."""
EVEN_STEPS = 2.0
"""How much longer than those beside it an interval may be in which a curve turns."""
BACK = 0.55
"""Share of the bend of samples at a turn by which those before and after may bend back: half in a sine of six samples
a period with one at its peak, all where a motion stops and goes on."""
SWING = 0.02
"""Share of the neighbouring steps by which a spline may pass the samples beside it without a reason in them."""
SLOPE = 1.25
"""Slope where samples are too few, at most, in the lesser of the slopes beside it: two such ends with no curvature
make a quintic monotone, since its Bernstein coefficients are."""


class Curve:
    """A piecewise quintic with two continuous derivatives.

    Parameters
    ----------
    time : (n,) float64, s
        Growing.
    values : (n,) float64
    rests : bool
        Whether what is recorded rests at its first value before.

    Attributes
    ----------
    resolution : float
        Greatest step that the samples were rounded to, where the curve allows for it; else 0.
    scatter : float
        Deviation of the samples from any smooth curve, which the curve follows and should not; 0 if there is none.
    swing : tuple of float or None
        Time and value to which a spline through the samples would have swung without a reason in them, and the lesser
        and greater value of the samples beside.
    """

    def __init__(self, time, values, rests=False):
        quanta = resolution(values)
        nodes, self.swing, self.scatter = None, None, 0.0
        if rounding_matters(time, values, quanta):
            nodes = _rounded(time, values, quanta, rests)
        self.resolution = float(quanta.max()) if nodes is not None else 0.0
        if nodes is None:
            first = (1, 0.0) if rests else "not-a-knot"
            spline = CubicSpline(time, values, bc_type=(first, "not-a-knot"))
            nodes = Nodes(time, values, spline(time, 1), spline(time, 2))
            nodes, self.swing = restrained(nodes)
            self.scatter = scatter(time, values)
        self.nodes = nodes
        self._pieces = _polynomials(nodes)
        self._orders = [self._pieces.derivative(order) if order else self._pieces for order in range(3)]

    def __call__(self, t):
        """Value and its first two derivatives at times t (s); (3, ...) float64."""
        return np.array([order(t) for order in self._orders])


class Nodes(NamedTuple):
    """Where the pieces of a curve meet.

    Attributes
    ----------
    time : (n,) float64, s
    value, slope, curvature : (n,) float64
        Of the curve there.
    """

    time: np.ndarray
    value: np.ndarray
    slope: np.ndarray
    curvature: np.ndarray


def _polynomials(nodes):
    """The quintics that have value, slope and curvature of the nodes at both ends."""
    step = np.diff(nodes.time)
    a, b, c = nodes.value[:-1], nodes.slope[:-1] * step, 0.5 * nodes.curvature[:-1] * step**2
    # what the rest must add to value, slope and half the curvature at the other end
    value = nodes.value[1:] - (a + b + c)
    slope = nodes.slope[1:] * step - (b + 2.0 * c)
    bend = 0.5 * nodes.curvature[1:] * step**2 - c
    third, fourth = 10 * value - 4 * slope + bend, -15 * value + 7 * slope - 2 * bend
    fifth = 6 * value - 3 * slope + bend
    powers = np.arange(DEGREE, -1, -1)[:, None]
    return PPoly(np.array([fifth, fourth, third, c, b, a]) / step**powers, nodes.time)


# The smooth curve within the resolution


def _rounded(time, values, quanta, rests):
    """Nodes of the smoothest curve within half a step of each sample; None where the samples do not determine one."""
    if rests:  # the rest before belongs to what is recorded
        count = min(2 * SAMPLES_A_KNOT, len(time))
        ahead = time[0] - (time[1] - time[0]) * np.arange(count, 0, -1)
        time = np.concatenate([ahead, time])
        values = np.concatenate([np.full(count, values[0]), values])
        quanta = np.concatenate([np.full(count, quanta[0]), quanta])
    level = values.mean()
    values, half = values - level, 0.5 * quanta
    cuts, curve = _coarse(time, values, half)
    if np.abs(curve(time) - values).max() < EVEN * half.max():
        return None  # the steps are those of the motion
    # no gap is as long as the motion takes to turn, unless the curve goes astray in one
    steps, least = np.diff(time), GAP_STEPS * np.median(np.diff(time))
    spare = ASTRAY * np.ptp(values) + half.max()
    for longest in (max(np.median(np.diff(time[cuts])), least), least):
        filled = time, values, half
        if np.any(steps > longest):
            filled = _filled(*filled, steps > longest)
            cuts, curve = _coarse(*filled)
        nodes = _within(*filled, cuts, curve)
        if nodes is None:
            break
        between = _polynomials(nodes)(nodes.time[:-1, None] + np.diff(nodes.time)[:, None] * np.arange(4) / 4)
        if between.min() > values.min() - spare and between.max() < values.max() + spare:
            return nodes._replace(value=nodes.value + level)
    return None


def _within(time, values, half, cuts, curve):
    """Nodes of the smooth curve within a band around samples; None where they do not determine one."""
    while _told(cuts, time):
        cuts = _halved(cuts, np.ones(len(cuts) - 1, bool))
        curve, within = smoothest(time, values, half, cuts, curve)
        if within:
            knots = time[cuts]
            return Nodes(knots, *(curve(knots, order) for order in range(3)))
    return None


def _filled(time, values, half, gaps):
    """Put samples of a monotone curve into gaps between samples."""
    step = max(np.median(np.diff(time)), np.diff(time)[gaps].sum() / GAP_ROWS)
    more = np.concatenate([np.arange(time[k] + step, time[k + 1], step) for k in np.flatnonzero(gaps)])
    between = _polynomials(Nodes(time, values, _lesser_slopes(time, values), np.zeros(len(time))))(more)
    all_times, order = np.unique(np.concatenate([time, more]), return_index=True)
    return all_times, np.append(values, between)[order], np.append(half, np.interp(more, time, half))[order]


def _halved(cuts, which):
    """Indices of knots with the intervals marked cut in two."""
    middle = (cuts[:-1] + cuts[1:]) // 2
    return np.unique(np.concatenate([cuts, middle[which]]))


def _knots(ends):
    """Knots of a spline with whole ends."""
    return np.concatenate([[ends[0]] * DEGREE, ends, [ends[-1]] * DEGREE])


def _told(cuts, time):
    """Whether half of the samples tell the other half: if not, it is not rounding that makes them uneven."""
    return 2 * (len(cuts) + DEGREE - 1) <= len(time)


def _coarse(time, values, half):
    """A least-squares spline near enough to the samples, or with too many knots; indices of its knots, and itself."""
    cuts = np.array([0, len(time) - 1])
    while True:
        share = np.arange(SAMPLES_A_KNOT) / SAMPLES_A_KNOT
        rows = np.unique((cuts[:-1, None] + np.diff(cuts)[:, None] * share).astype(int))
        rows = np.append(rows, len(time) - 1)
        knots = _knots(time[cuts])
        basis = BSpline.design_matrix(time[rows], knots, DEGREE)
        weight = half[rows] ** -2
        normal = basis.T @ diags(weight) @ basis
        rough = _roughness(knots)
        rough *= 1e-9 * normal.diagonal().mean() / rough.diagonal().mean()  # for intervals with too few samples
        curve = BSpline(knots, _solver(normal + rough)(basis.T @ (weight * values[rows])), DEGREE)
        worst = np.maximum.reduceat(np.abs(curve(time) - values) / half, cuts[:-1])
        split = (worst > LOOSE) & (np.diff(cuts) > 1)
        if not split.any() or not _told(cuts, time):
            return cuts, curve
        cuts = _halved(cuts, split)


def _solver(matrix):
    """Solver of a symmetric banded system, where what nothing determines is zero."""
    least = 1e-13 * matrix.diagonal().mean()
    matrix = (matrix + diags(np.full(matrix.shape[0], least))).tocsc()
    return splu(matrix, permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True}).solve


def _roughness(knots):
    """Matrix of the integral of the fifth derivative squared, by coefficients of a spline."""
    to_fifth, count = diags(np.ones(len(knots) - DEGREE - 1)), len(knots) - DEGREE - 1
    for degree in range(DEGREE, 0, -1):
        knots, span = knots[1:-1], knots[degree + 1 : -1] - knots[1 : -degree - 1]
        rate = diags([-degree / span, degree / span], [0, 1], (count - 1, count))
        to_fifth, count = rate @ to_fifth, count - 1
    return to_fifth.T @ diags(np.diff(knots)) @ to_fifth


def smoothest(time, values, half, cuts, guess):
    """Find the smooth spline within a band around samples.

    It has the least sum of squares of what it is off and of roughness, the integral of the fifth derivative squared:
    that of lower ones would bend the ends, where it leaves them zero. The bounds of few samples hold the rest, so that
    only those are looked at, and then those that the curve passes.

    Parameters
    ----------
    time, values, half : (n,) float64
        Samples, and half the height of the band at each.
    cuts : (m,) int
        Indices of the samples at which the spline has knots.
    guess : BSpline
        One near the samples.

    Returns
    -------
    BSpline
        The guess, if no spline is within the band.
    bool
        Whether one is.
    """
    knots = _knots(time[cuts])
    basis = diags(1.0 / half) @ BSpline.design_matrix(time, knots, DEGREE)
    steps = np.diff(guess.t)
    fifth = guess((guess.t[:-1] + 0.5 * steps), DEGREE)
    length = time[-1] - time[0]
    # what the fifth Chebyshev polynomial has that spans the band: less is the roughness of no curve that is seen
    least = length * (1920.0 * half.min() * (2.0 / length) ** 5) ** 2
    weight = SMOOTH * len(time) / max(np.sum(steps * fifth**2), least)
    target = values / half
    square, pull = basis.T @ basis + weight * _roughness(knots), basis.T @ target
    share = np.arange(PARTS) / PARTS
    starts = np.unique((cuts[:-1, None] + np.diff(cuts)[:, None] * share).astype(int))
    part = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(time)))
    rows, off = starts, guess(time) / half - target
    for _ in range(ROUNDS):
        worst = (off == np.minimum.reduceat(off, starts)[part]) | (off == np.maximum.reduceat(off, starts)[part])
        rows = np.union1d(rows, np.flatnonzero(worst & (np.abs(off) > NEAR)))
        found = _least_within(square, pull, basis[rows], target[rows])
        if found is None:
            break
        off = basis @ found - target
        if np.abs(off).max() <= 1.0 + 1e-9:
            return BSpline(knots, found, DEGREE), True
    return guess, False


def _least_within(square, pull, basis, target):
    """Minimise x S x / 2 - p x where |B x - y| <= 1, by a predictor-corrector method; None if it fails.

    (Mehrotra's: Nocedal and Wright, Numerical Optimization, section 16.6, with slacks for both bounds.)
    """
    x = _solver(square)(pull)
    slack = np.maximum(1.0 - SIGN * (basis @ x - target), 0.1)
    force = np.ones_like(slack)
    for _ in range(STEPS):
        primal = 1.0 - SIGN * (basis @ x - target) - slack
        dual = square @ x - pull + basis.T @ (SIGN * force).sum(axis=0)
        mean = (slack * force).mean()
        if np.abs(primal).max() < 1e-9 and mean <= CLOSE:
            return x
        solve = _solver(square + basis.T @ diags((force / slack).sum(axis=0)) @ basis)
        step = partial(_newton, solve, basis, primal, dual, slack, force)
        _, change_slack, change_force = step(0.0)
        length = min(_room(slack, change_slack), _room(force, change_force), 1.0)
        ahead = ((slack + length * change_slack) * (force + length * change_force)).mean()
        change, change_slack, change_force = step(mean * (ahead / mean) ** 3 - change_slack * change_force)
        length = min(0.99 * _room(slack, change_slack), 0.99 * _room(force, change_force), 1.0)
        x, slack, force = x + length * change, slack + length * change_slack, force + length * change_force
    return None


def _newton(solve, basis, primal, dual, slack, force, aim):
    """Changes of the solution, the slacks and their forces towards slack x force = aim."""
    more = (aim - slack * force - force * primal) / slack
    change = solve(-dual - basis.T @ (SIGN * more).sum(axis=0))
    change_slack = primal - SIGN * (basis @ change)
    return change, change_slack, (aim - slack * force - force * change_slack) / slack


def _room(values, change):
    """Share of a change at which the first of positive values vanishes."""
    falling = change < 0.0
    return (-values[falling] / change[falling]).min() if falling.any() else np.inf


# Samples that are too far apart


def restrained(nodes):
    """Hold a spline back where its samples do not determine it.

    Between two samples a spline may turn if the samples around bend as a turn does, and twice as far as both parabolas
    through three of them; all else comes from samples further away, across a corner of the motion. There slopes become
    at most 1.25 of the lesser beside them and curvatures zero, so that the curve is monotone between such samples and
    rests where they rest. (Of the kind of Dougherty, Edelman and Hyman, Math. Comp. 52, 1989, with the spline kept
    elsewhere.)

    Parameters
    ----------
    nodes : Nodes
        Of a spline through samples, its nodes.

    Returns
    -------
    Nodes
    tuple of float or None
        Time and value of the furthest that the spline went too far, and the lesser and greater value of the nodes
        beside; None if it nowhere did.
    """
    time, value, slope, curvature = nodes
    low, high = np.minimum(value[:-1], value[1:]), np.maximum(value[:-1], value[1:])
    allowed = _turns(time, value)
    share = np.linspace(0.0, 1.0, 9)[1:-1]
    at = time[:-1, None] + np.diff(time)[:, None] * share
    lesser = _lesser_slopes(time, value)
    held, swing = np.zeros(len(time), bool), None
    while True:
        between = _polynomials(Nodes(time, value, slope, curvature))(at)
        over = np.maximum(between.max(axis=1) - high - allowed[1], low - between.min(axis=1) - allowed[0])
        passed = over > 1e-9 * np.ptp(value)
        if swing is None and passed.any():
            k = np.argmax(over)
            far = np.argmax(np.maximum(between[k] - high[k], low[k] - between[k]))
            swing = tuple(map(float, (at[k, far], between[k, far], low[k], high[k])))
        new = (np.append(passed, False) | np.append(False, passed)) & ~held
        if not new.any():
            return Nodes(time, value, slope, curvature), swing
        held |= new
        slope, curvature = np.where(held, lesser, slope), np.where(held, 0.0, curvature)


def _turns(time, value):
    """How far a curve may fall below and rise above the samples at the ends of each interval, (2, n - 1)."""
    near, step = np.abs(np.diff(value)), np.diff(time)
    if len(time) < 4:
        return np.zeros((2, len(step)))
    bend = second_differences(time, value)
    # the ends have no three samples around them and bend as their neighbours do, if those agree
    first, last = (np.where(end * beside > 0.0, end, 0.0) for end, beside in (bend[:2], bend[:-3:-1]))
    bend = np.concatenate([[first], bend, [last]])
    even = step <= EVEN_STEPS * np.maximum(*_beside(step))
    spare = SWING * np.maximum(near, np.maximum(*_beside(near)))
    turns = []
    for sign in (1.0, -1.0):
        low, high = sign * bend[:-1], sign * bend[1:]
        before, after = np.append(low[:1], low[:-1]), np.append(high[1:], high[-1:])
        # a motion that turns does so for more than two samples; one that stops and goes bends back at once
        reason = even & (np.minimum(low, high) > 0.0)
        reason &= np.minimum(before, after) >= -BACK * np.maximum(low, high)
        fall = np.maximum(np.minimum(low, high), 0.0) * 0.5 * step**2
        # a parabola through both ends passes them by (c - |d|)^2 / 4 c, if it turns between them
        most = 2.0 * np.maximum(fall - near, 0.0) ** 2 / (4.0 * np.maximum(fall, 1e-300)) + spare
        turns.append(np.where(reason, most, 0.0))
    return np.array(turns)


def _beside(values):
    """Values of the intervals before and after; the own where there is none."""
    return np.append(values[:1], values[:-1]), np.append(values[1:], values[-1:])


def _lesser_slopes(time, value):
    """Slope at each sample with which quintics are monotone: by the slopes beside, none where they differ in sign."""
    slope = np.diff(value) / np.diff(time)
    before, after = np.append(slope[:1], slope), np.append(slope, slope[-1:])
    mean = 0.5 * (before + after)
    least = SLOPE * np.minimum(np.abs(before), np.abs(after))
    return np.where(before * after > 0.0, np.clip(mean, -least, least), 0.0)
