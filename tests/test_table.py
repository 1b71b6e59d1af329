"""The table of signals: lines that are whole, and a restart that knows which of them belong to its checkpoint."""

import contextlib

import numpy as np
import pytest

from parmps.errors import OutputError
from parmps.table import ProbeTable, kept_lines

COLUMNS = ["P1 [Pa]", "eta, left [m]"]
TIMES = [float(time) for time in np.cumsum(np.full(20, 0.1))]


def read_table(path):
    return np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2)


def write(table, times):
    for time in times:
        table.write(time, [time / 3.0, -time])


def test_a_table_can_be_read_while_it_grows(tmp_path):
    path = tmp_path / "probes.csv"
    table = ProbeTable(path, COLUMNS)
    for step in range(3):
        table.write(0.1 * step, [np.float64(1 / 3), 1e-12])
        assert read_table(path).shape == (step + 1, 3)
    table.close()
    assert path.read_text().splitlines()[0] == 'time [s],P1 [Pa],"eta, left [m]"'
    assert np.array_equal(read_table(path)[:, 0], 0.1 * np.arange(3))
    np.testing.assert_allclose(read_table(path)[:, 1], 1 / 3, rtol=1e-9)


@pytest.fixture
def stopped(tmp_path):
    """A table of 15 rows, of which 10 belong to the checkpoint, and what that knows."""
    path = tmp_path / "probes.csv"
    with contextlib.closing(ProbeTable(path, COLUMNS)) as table:
        write(table, TIMES[:10])
        mark = table.mark()
        write(table, TIMES[10:15])
    return path, mark


def resume(path, columns, mark):
    return contextlib.closing(ProbeTable(path, columns, kept_lines(path, columns, mark)))


def test_a_restarted_table_is_that_of_an_unbroken_run(tmp_path, stopped):
    path, mark = stopped
    with path.open("a") as file:
        file.write("1.6,7")  # torn by a power failure
    with resume(path, COLUMNS, mark) as table:
        assert table.mark() == mark
        write(table, TIMES[10:])
        last = table.mark()
    with contextlib.closing(ProbeTable(tmp_path / "unbroken.csv", COLUMNS)) as table:
        write(table, TIMES)
        assert table.mark() == last
    assert path.read_bytes() == (tmp_path / "unbroken.csv").read_bytes()


def test_before_the_first_row_there_is_the_header(tmp_path):
    path = tmp_path / "probes.csv"
    with contextlib.closing(ProbeTable(path, COLUMNS)) as table:
        mark = table.mark()
        write(table, TIMES)
    with resume(path, COLUMNS, mark):
        assert len(path.read_text().splitlines()) == 1


def test_new_signals_are_nan_up_to_the_checkpoint_and_old_ones_stay(stopped):
    path, mark = stopped
    before = read_table(path)
    more = ["new [m]", *COLUMNS]
    for _ in range(2):  # again after a kill before the next checkpoint
        with resume(path, more, mark) as table:
            table.write(TIMES[10], [1.0, 2.0, 3.0])
            later = table.mark()
    rows = read_table(path)
    assert np.isnan(rows[:10, 1]).all()
    np.testing.assert_array_equal(rows[:10, [0, 2, 3]], before[:10])
    np.testing.assert_array_equal(rows[10], [TIMES[10], 1.0, 2.0, 3.0])
    with resume(path, more, later), pytest.raises(OutputError, match=r"lacks the column new \[m\]"):
        ProbeTable(path, COLUMNS).close()
        kept_lines(path, more, later)
    with contextlib.closing(ProbeTable(path, more, [])) as table:
        write_more = [[TIMES[row], [np.nan, TIMES[row] / 3.0, -TIMES[row]]] for row in range(10)]
        for time, values in write_more:
            table.write(time, values)
    with resume(path, COLUMNS, mark):  # without the new signals after all
        np.testing.assert_array_equal(read_table(path), before[:10])


DAMAGE = {
    "rows lost": (lambda text: text[: text.index("0.7")], r"has 6 of the 10 .* after t = 0\.6 s up to t = 1 s are m"),
    "torn": (lambda text: text[: text.index("0.7") + 8], r"has 6 of the 10 rows"),
    "NUL bytes at the end": (lambda text: text[: text.index("0.7")] + "\0" * 200, r"has 6 of .*, NUL bytes are in the"),
    "NUL bytes inside": (lambda text: text.replace("-0.5", "\0\0\0\0"), "holds NUL bytes in row 5 of the 10"),
    "a row lost": (lambda text: text.replace("0.5,0.1666666667,-0.5\n", ""), r"has a gap from t = 0\.4 to 0\.6 s"),
    "a value changed": (lambda text: text.replace("-0.5", "-0.6"), r"was changed: its 10 rows up to t = 1 s"),
    "a time changed": (lambda text: text.replace("\n0.5,", "\n0.45,"), "was changed|has a gap"),
    "no number": (lambda text: text.replace("\n0.5,", "\nhalf,"), "was changed"),
    "a cell more": (lambda text: text.replace("-0.5", "-0.5,1"), "was changed"),
    "a column renamed": (lambda text: text.replace("P1", "P2"), r"lacks the column P1 \[Pa\]"),
    "empty": (lambda text: "", "has no header"),
}


@pytest.mark.parametrize("case", DAMAGE)
def test_what_is_not_what_the_checkpoint_left_is_named_and_stays(stopped, case):
    path, mark = stopped
    change, message = DAMAGE[case]
    path.write_text(change(path.read_text()))
    before = path.read_bytes()
    with pytest.raises(OutputError, match=rf"probes\.csv: {message}.*; with --out DIR"):
        kept_lines(path, COLUMNS, mark)
    assert path.read_bytes() == before


def test_a_table_that_is_missing_or_no_file_is_refused(stopped):
    path, mark = stopped
    path.unlink()
    with pytest.raises(OutputError, match="No such file"):
        kept_lines(path, COLUMNS, mark)
    path.mkdir()
    with pytest.raises(OutputError, match="not a regular file"):
        kept_lines(path, COLUMNS, mark)


def test_a_line_that_does_not_fit_leaves_the_lines_before(small_disk):
    path = small_disk / "probes.csv"
    with contextlib.closing(ProbeTable(path, COLUMNS)) as table:
        with pytest.raises(OutputError, match="No space left"):
            for step in range(100_000):
                table.write(step, [1 / 3, 2 / 3])
        assert path.read_bytes().endswith(b"\n")
        assert len(read_table(path)) == step
        mark = table.mark()
    assert len(kept_lines(path, COLUMNS, mark)) == step
