"""What samples of a signal are: the steps that they and their times were rounded to, and errors beyond that."""

import numpy as np

LEVELS = 8
"""Distinct values that show a resolution: of random ones, 1 in 10^6 sets of as many are multiples of a common step."""
JUMPS = 4
"""Different distances of successive values, in their common step, that show a converter."""
MANY = 50
"""Samples of which a correlation tells something."""
DIGITS = 9
"""Significant digits that still are rounding; more are full precision."""
STEP_TOLERANCE = 0.05
"""How near to multiples of a common step the steps between values must be, in that step."""
ROUNDING_SHARE = 0.003
"""Share of the greatest second difference up to which that of the rounding is left in."""
EXACT = 10.0
"""Expected second difference of rounding errors, in the greatest found, beyond which samples are exact."""


def resolution(values):
    """Find the step that each value was rounded to.

    Looked for are decimals, those of each power of ten by themselves, so that significant digits are found as well;
    single precision; and one step for all values, as that of an analogue-to-digital converter.

    Parameters
    ----------
    values : (n,) float64

    Returns
    -------
    (n,) float64
        0 where no step is found.
    """
    quanta, step = _decimals(values), common_step(np.unique(values))
    single = np.spacing(np.abs(values).astype(np.float32)).astype(float)
    if not quanta.any() and np.all(np.abs(values - values.astype(np.float32)) <= STEP_TOLERANCE * single):
        quanta = single
    if step <= 10.0 * quanta.max():
        return quanta
    # steps of a converter rather than decimals; so have straight lines, but from sample to sample always the same
    jumps = np.unique(np.rint(np.abs(np.diff(values)) / step))
    return np.full(len(values), step) if len(jumps) >= JUMPS else quanta


def _decimals(values):
    """Last decimal of each value, (n,); 0 where values have too many digits.

    A magnitude with too few distinct values to tell has the last decimal of the next smaller one.
    """
    size = np.abs(values)
    with np.errstate(divide="ignore"):
        decade = np.floor(np.log10(size))
    quanta, step = np.zeros(len(values)), 0.0
    for each in np.unique(decade[size > 0.0]):
        group = decade == each
        levels = np.unique(size[group])
        if len(levels) >= LEVELS:
            for digit in range(int(each), int(each) - DIGITS, -1):
                counts = levels * 10.0**-digit
                if np.all(np.abs(counts - np.rint(counts)) <= 1e-6):
                    step = 10.0**digit
                    break
            else:
                return np.zeros(len(values))
        quanta[group] = step
    if step > 0.0:
        quanta[quanta == 0.0] = quanta[quanta > 0.0].min()
    return quanta


def common_step(levels):
    """Find the step of which the differences between values are multiples.

    Parameters
    ----------
    levels : (n,) float64
        Growing.

    Returns
    -------
    float
        0.0 if there is none, or too few levels to tell.
    """
    if len(levels) < LEVELS:
        return 0.0
    steps = np.diff(levels)
    for part in range(1, 11):  # the least step may be of several units
        unit = steps.min() / part
        counts = np.rint(steps / unit)
        unit = steps.sum() / counts.sum()
        if np.all(np.abs(steps - counts * unit) <= STEP_TOLERANCE * unit):
            return float(unit)
    return 0.0


def steady_clock(time):
    """Undo the rounding of times that a steady clock gave.

    Parameters
    ----------
    time : (n,) float64, s
        Growing.

    Returns
    -------
    (n,) float64, s
        Multiples of one interval, some of which may be missing, if the times are those rounded to their resolution;
        else the times as they are.
    """
    steps = np.diff(time)
    interval = np.mean(steps[steps < 1.5 * np.median(steps)])
    count = np.concatenate([[0.0], np.cumsum(np.rint(steps / interval))])
    interval, start = np.polyfit(count, time, 1)
    steady = start + interval * count
    off = np.abs(time - steady)
    if off.max() <= 1e-6 * interval or np.any(np.diff(count) < 1.0):
        return time
    # half the resolution, and what the line may be wrong by
    return steady if np.all(off <= 0.6 * resolution(time)) else time


def rounding_matters(time, values, quanta):
    """Whether second differences of samples are to some part those of their rounding.

    Parameters
    ----------
    time, values, quanta : (n,) float64
        Samples, and the steps that they were rounded to.

    Returns
    -------
    bool
    """
    if len(time) < LEVELS or not quanta.any():
        return False
    step = np.diff(time)
    before, after = 1.0 / step[:-1], 1.0 / step[1:]
    half = 0.5 * (step[:-1] + step[1:])
    # rounding errors are spread evenly: their deviation is the step / sqrt(12)
    error = quanta[1:-1] * np.sqrt((before**2 + after**2 + (before + after) ** 2) / 12.0) / half
    found = np.abs(second_differences(time, values)).max()
    return bool(ROUNDING_SHARE * found < error.max() < found * EXACT)  # else not even the rounding is there


def second_differences(time, values):
    """Find the second derivative of the parabola through each three samples.

    Parameters
    ----------
    time, values : (n,) float64

    Returns
    -------
    (n - 2,) float64
    """
    slope = np.diff(values) / np.diff(time)
    return 2.0 * np.diff(slope) / (time[2:] - time[:-2])


def scatter(time, values):
    """Estimate what independent errors of samples are, by second differences of changing sign.

    Those of a smooth curve are alike from sample to sample; those of independent errors have a correlation of -2/3
    with the next, and a variance six times that of the errors.

    Parameters
    ----------
    time, values : (n,) float64

    Returns
    -------
    float
        Standard deviation, 0 where there is no sign of such errors.
    """
    if len(time) < MANY:
        return 0.0
    bend = second_differences(time, values)
    if bend[1:] @ bend[:-1] > -0.5 * (bend @ bend):
        return 0.0
    size = bend * 0.5 * np.diff(time)[1:] * (time[2:] - time[:-2])
    return float(np.sqrt(np.mean(size**2) / 6.0))
