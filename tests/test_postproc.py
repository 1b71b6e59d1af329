"""The plot commands on results with known content."""

import contextlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from parmps.output import ParticleFile, ProbeTable

COMMANDS = Path(__file__).parent.parent / "postproc"
SPACING = 0.01


def plot(name, *arguments):
    command = [sys.executable, COMMANDS / f"{name}.py", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def write_probes(directory, seconds=10.0, factor=1.0):
    signals = ["P1 [Pa]", "P2 [Pa]", "eta_left [m]", "eta_right [m]"]
    loads = ["load force x [N/m]", "load force z [N/m]", "load moment y [N m/m]"]
    table = ProbeTable.create(directory / "probes.csv", signals + loads)
    with contextlib.closing(table):
        for time in np.arange(0.0, seconds, 0.005):
            wave = factor * np.sin(6.469 * time) * min(time, 5.0) / 5.0
            noise = 20 * np.sin(517.0 * time)
            pressure = [2000.0 + 600 * wave + noise, 500.0 + 400.0 * max(wave, -0.8) ** 2]
            load = [150.0 * wave, -1960.0 - 100.0 * wave**2, 20.0 * wave]
            table.write(time, [*pressure, 0.25 + 0.08 * wave, 0.25 - 0.07 * wave, *load])


def write_particles(directory, width=1):
    """A tilted water surface over a layer of brine, 0.8 m long, walls of one layer and two dummy layers."""
    ranges = np.arange(-3, 83), np.arange(width), np.arange(-3, 53)
    cells = np.stack(np.meshgrid(*ranges, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = (cells[:, 0] >= 0) & (cells[:, 0] < 80) & (cells[:, 2] >= 0) & (cells[:, 2] < 50)
    wall = (cells[:, [0, 2]] >= -1).all(1) & (cells[:, 0] <= 80) & (cells[:, 2] <= 50)
    position = (cells + 0.5) * SPACING
    surface = 0.25 + 0.25 * (position[:, 0] - 0.4)
    keep = ~inside | (position[:, 2] < surface)
    position, inside, wall, surface = position[keep], inside[keep], wall[keep], surface[keep]
    if width == 1:
        position = position[:, [0, 2]]
    n = len(position)
    ParticleFile.create(
        directory / "particles.vtkhdf",
        n,
        3,
        {"job": f"spacing: {SPACING}\nfluids: [{{name: brine}}, {{name: water}}]\n"},
    )
    with contextlib.closing(ParticleFile.open(directory / "particles.vtkhdf")) as file:
        for frame in range(2):
            velocity = np.zeros_like(position)
            velocity[:, 0] = position[:, -1]
            arrays = {
                "id": np.arange(n),
                "type": np.where(inside, 0, np.where(wall, 1, 2)),
                "fluid": np.where(position[:, -1] > 0.1, 1, 0),
                "surface": np.zeros(n),
                "position": position,
                "velocity": velocity,
                "pressure": np.where(inside, 9800.0 * (surface - position[:, -1]), 0.0),
            }
            file.write(frame, 0, arrays)
            file.commit(frame, 0.1 * frame)


def is_picture(path):
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000


def test_probes_with_a_reference(tmp_path):
    (tmp_path / "reference").mkdir()
    write_probes(tmp_path, 3.0)
    write_probes(tmp_path / "reference", 2.0, 0.9)
    done = plot("plot_probes", tmp_path, "--reference", tmp_path / "reference" / "probes.csv")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == str(tmp_path / "probes.png")
    assert is_picture(tmp_path / "probes.png")


@pytest.mark.parametrize("content", [None, "time [s],P1 [Pa]\n", "time [s],P1 [Pa]\n0,text\n"])
def test_probes_that_cannot_be_drawn_give_one_message(tmp_path, content):
    if content:
        (tmp_path / "probes.csv").write_text(content)
    done = plot("plot_probes", tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(("field", "width"), [("pressure", 1), ("speed", 3), ("fluid", 1)])
def test_particles(tmp_path, field, width):
    write_particles(tmp_path, width)
    done = plot("plot_particles", tmp_path, "--field", field, "--time", "0.02")
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip() == str(tmp_path / f"particles_{field}.png")
    assert is_picture(tmp_path / f"particles_{field}.png")


def test_particles_without_a_frame_give_one_message(tmp_path):
    ParticleFile.create(tmp_path / "particles.vtkhdf", 1, 1, {})
    done = plot("plot_particles", tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"plot_particles: {tmp_path / 'particles.vtkhdf'} has no frame yet\n"


def test_trade_draws_the_pareto_front(tmp_path):
    rows = ["scene,setting,error [%],CPU time [s]", "wave,coarse,8,1", "wave,fine,1,10", "wave,poor,9,5"]
    (tmp_path / "trade.csv").write_text("\n".join([*rows, "wave,broken,diverged at t = 1 s,"]) + "\n")
    done = plot("trade", tmp_path / "trade.csv")
    assert done.returncode == 0, done.stderr
    table = (tmp_path / "trade.md").read_text()
    assert "| coarse | 8.00 | 1.0 | front |" in table
    assert "| fine | 1.00 | 10.0 | front |" in table
    assert "| poor | 9.00 | 5.0 |  |" in table
    assert "diverged at t = 1 s" in table
    assert (tmp_path / "trade.png").stat().st_size > 5000
