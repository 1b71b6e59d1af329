"""Files of recorded motions: what is read, and what is refused with which message."""

import time as clock

import numpy as np
import pytest

from parmps.errors import InputError
from parmps.records import read_motion_file

ROWS = "0,0\n1,1\n2,0\n3,1\n"
TABULATED = """4
(
(0 ((0 0 0) (0 0 0)))
(1.0 ((0.1 0.2 -0.3)
  (1 2.5 -3)))
(2.0 ((0 0 0) (4 5 6)))
(3 ((7 8 9) (0 0 0)))
)
"""


def written(tmp_path, text):
    path = tmp_path / "motion.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return str(path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ["line 1", "time [s]"]),
        (ROWS, ["line 1", "unknown column '0'"]),
        ("time [s]\n0\n1\n2\n3\n", ["line 1", "at least one motion"]),
        ("surge [m],heave [m]\n" + ROWS, ["line 1", "time [s]"]),
        ("time [s],surge\n" + ROWS, ["unknown column 'surge'", "did you mean 'surge [m]'"]),
        ("time [s],roll [rad]\n" + ROWS, ["did you mean 'roll [deg]'"]),
        ("time [s],surge [m],surge [m]\n" + ROWS, ["'surge [m]' is given twice"]),
        ("time [s]|surge [m]\n0|1\n", ["line 1", "time [s]|surge [m]"]),
        ("time [s],surge [m]\n0,0\n1,x\n2,0\n3,1\n", ["line 3", "'surge [m]'", "'x'", "number"]),
        ("time [s],surge [m]\n0,0\n1,nan\n2,0\n3,1\n", ["line 3", "'nan'"]),
        ("time [s],surge [m]\n0,0\n1,inf\n2,0\n3,1\n", ["line 3", "'inf'"]),
        ("time [s],surge [m]\n0,0\n1,1e300\n2,0\n3,1\n", ["line 3", "at most 1e+06"]),
        ("time [s],surge [m]\n0,0\n1,1_0\n2,0\n3,1\n", ["line 3", "'1_0'"]),
        ("time [s],surge [m]\n0,0\n1\n2,0\n3,1\n", ["line 3", "got 1 values", "must be 2"]),
        ("time [s],surge [m]\n0;0\n1;1\n", ["line 2", "got 1 values", "separated by commas", "must be 2"]),
        ("time [s],surge [m]\n0,0\n1,1\n1,0\n3,1\n", ["line 4", "'time [s]'", "must grow"]),
        ("time [s];surge [m]\n0,5;0\n1;0.5\n", ["lines 2 and 3", "decimal commas and points"]),
        ("time [s],surge [m]\n0,0\n", ["got 1 rows", "at least 2"]),
        (b"time [s],surge [m]\n0,1\n1,\xff\n", ["line 3", "'\xff'"]),
        (b"time [s],surge [m]\n0,1\n\0\0\0", ["zero bytes"]),
        (TABULATED.replace("(4 5 6)", "(4 5)"), ["line 6", "(4 5)", "(time ((surge sway heave) (roll pitch yaw)))"]),
        (TABULATED.replace("(2.0 (", "here (2.0 ("), ["line 6", "'here'"]),
        (TABULATED.replace("2.5", "2,5"), ["line 4", "'pitch [deg]'", "'2,5'"]),
    ],
)
def test_bad_motion_files_are_refused(tmp_path, text, expected):
    path = written(tmp_path, text)
    with pytest.raises(InputError) as refusal:
        read_motion_file(path, "motion[2].path")
    for part in ["motion[2].path", path, *expected]:
        assert part in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    "text",
    [
        "time [s],pitch [deg],surge [m]\n0,0,1.5\n1,0.25,-2e-3\n2.5,0,0\n",
        "time [s];pitch [deg];surge [m]\n0;0;1.5\n1;0.25;-2e-3\n2.5;0;0\n",
        "time [s];pitch [deg];surge [m]\n0;0;1,5\n1;0,25;-2e-3\n2,5;0;0\n",
        "time [s]\tpitch [deg]\tsurge [m]\n0\t0\t1,5\n1\t0,25\t-0,002\n2,5\t0\t0\n",
        "time [s] pitch [deg]   surge [m]\n  0 0 1.5\n 1 0.25 -2E-3\n2.5 0 0\n",
        '"time [s]" "pitch [deg]" "surge [m]"\n0 0 1.5\n1 0.25 -2E-3\n2.5 0 0\n',
        '"time [s]","pitch [deg]","surge [m]"\n"0","0","1.5"\n"1","0.25","-2e-3"\n"2.5","0","0"\n',
        "time [s],pitch [deg],surge [m],\n0,0,1.5,\n1,0.25,-2e-3,\n2.5,0,0,\n",
        "time [s],pitch [deg],surge [m]\n0,0,1.5,\n1,0.25,-2e-3,\n2.5,0,0,\n",
        "time [s],pitch [deg],surge [m]\n0.0D0,0,1.5d+00\n1,0.25,-2.0D-3\n2.5,0,0\n",
        "# time [s] pitch [deg] surge [m]\n0 0 1.5\n1 0.25 -2E-3\n2.5 0 0\n",
        b"\xef\xbb\xbf# 0.5 Hz\r\nsurge [m], time [s], pitch  [deg]\r\n1.5,0,0\r\n\r\n # a\r\n-2e-3,1,0.25\r\n0,2.5,0",
        "# dérive\ntime [s],pitch [deg],surge [m]\n0,0,1.5\n1,0.25,-2e-3\n2.5,0,0\n".encode("latin-1"),
        "time [s],pitch [deg],surge [m]\r0,0,1.5\r1,0.25,-2e-3\r2.5,0,0\r",
        "time [s],pitch [deg],surge [m]\n0,0,1.5\n1,0.25,-2e-3\n2.5,0,0\n".encode("utf-16"),
    ],
)
def test_tables_as_loggers_and_spreadsheets_write_them(tmp_path, text):
    table = read_motion_file(written(tmp_path, text))
    np.testing.assert_array_equal(table.time, [0, 1, 2.5])
    assert set(table.columns) == {"pitch", "surge"}
    np.testing.assert_array_equal(table.columns["pitch"], [0, 0.25, 0])
    np.testing.assert_array_equal(table.columns["surge"], [1.5, -2e-3, 0])
    assert not table.outer


@pytest.mark.parametrize("head", ["", "/* a\nb */\n// c\n", "FoamFile\n{\n    version 2.0;\n}\n"])
def test_openfoam_tables(tmp_path, head):
    table = read_motion_file(written(tmp_path, head + TABULATED))
    assert table.outer
    np.testing.assert_array_equal(table.time, [0, 1, 2, 3])
    found = np.array([table.columns[kind] for kind in ("surge", "sway", "heave", "roll", "pitch", "yaw")])
    np.testing.assert_array_equal(found[:, 1], [0.1, 0.2, -0.3, 1, 2.5, -3])
    np.testing.assert_array_equal(found[:, 3], [7, 8, 9, 0, 0, 0])


def test_a_file_is_read_again_when_it_has_changed(tmp_path):
    first = read_motion_file(written(tmp_path, "time [s],surge [m]\n" + ROWS))
    assert read_motion_file(str(tmp_path / "motion.csv")) is first
    then = read_motion_file(written(tmp_path, "time [s],surge [m]\n0,0\n1,1\n2,0\n3,15\n"))
    assert then.columns["surge"][-1] == 15


def test_oversized_motion_file_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("parmps.records.MAX_FILE_BYTES", 2**20)
    path = written(tmp_path, b"0" * (2**20 + 1))
    with pytest.raises(InputError, match="at most 1 MiB"):
        read_motion_file(path)


def test_large_files_are_read_in_microseconds_a_row(tmp_path):
    rows = "".join(f"{k / 1000:.3f},{k % 7},{k % 5}.25\n" for k in range(100_000))
    path = written(tmp_path, "time [s],surge [m],roll [deg]\n" + rows)
    start = clock.process_time()
    assert len(read_motion_file(path).time) == 100_000
    assert clock.process_time() - start < 2.0
