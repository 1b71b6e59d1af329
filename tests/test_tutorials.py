"""Every tutorial job runs; here for a few steps, with a checkpoint and a picture at the end."""

import json
from pathlib import Path

import pytest

from parmps.domain import Domain
from parmps.figures.snapshots import draw_snapshots, make_view
from parmps.loader import load_job
from parmps.run import Run

TUTORIALS = sorted((Path(__file__).parents[1] / "jobs" / "tutorials").glob("*.yaml"))


@pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)
def test_tutorial(path, tmp_path):
    job = load_job(path, ["time.end=0.02"])
    assert job.output.directory == str(path.parents[2] / "out" / "tutorials" / path.stem)
    run = Run(job, Domain(), tmp_path)
    try:
        run.go()
    finally:
        run.close()
    assert json.loads((tmp_path / "run.json").read_text())["status"] == "done"
    assert (tmp_path / "checkpoint.h5").exists()
    figure = draw_snapshots(tmp_path, make_view(tmp_path, "speed"), [0.0, 0.02])
    assert len(figure.axes) == 3


def test_there_is_one_for_every_feature_in_their_order():
    assert [path.stem[0] for path in TUTORIALS] == [str(n) for n in range(1, len(TUTORIALS) + 1)]
