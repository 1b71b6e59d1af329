"""The plot commands on results with known content."""

import contextlib
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.optimize import brentq

from parmps import cli
from parmps.figures.curves import draw_histories, draw_phases, draw_spectra
from parmps.figures.results import run_names
from parmps.figures.snapshots import View, draw_snapshots, make_view
from parmps.loader import parse_job
from parmps.output import ParticleFile
from parmps.signals import read_signals
from parmps.table import ProbeTable

COMMANDS = Path(__file__).parent.parent / "postproc"
SPACING = 0.01
JOB = """
title: Tilted
dimension: {dimension}
spacing: 0.01
tank: {{size: {size}, baffles: [{{x: 0.4, bottom: 0.0, top: 0.1, thickness: 0.02}}]}}
fluids: [{{name: brine, depth: 0.1}}, {{name: water, depth: 0.15}}]
motion: [{{kind: pitch, amplitude_deg: 10, omega: 6.469, phase_deg: 0, centre: {centre}}}]
time: {{end: 3.0}}
probes: [{{name: P1, kind: pressure, at: {at}}}]
"""


def plot(*arguments):
    """Run the command in this process; its exit status."""
    with pytest.raises(SystemExit) as end, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["parmps", "plot", *map(str, arguments)])
        cli.main()
    return end.value.code


def write_probes(directory, seconds=10.0, factor=1.0):
    signals = ["P1 [Pa]", "P2 [Pa]", "eta_left [m]", "eta_right [m]"]
    loads = ["load.Fx [N/m]", "load.Fz [N/m]", "load.My [N m/m]"]
    table = ProbeTable(directory / "probes.csv", signals + loads)
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
        job = JOB.format(dimension=2, size="[0.8, 0.5]", centre="[0.4, 0.0]", at="[0.0, 0.05]")
        position = position[:, [0, 2]]
    else:
        size = f"[0.8, {width * SPACING}, 0.5]"
        job = JOB.format(dimension=3, size=size, centre="[0.4, 0.0, 0.0]", at="[0.0, 0.0, 0.05]")
    n = len(position)
    ParticleFile.create(directory / "particles.vtkhdf", n, 3, {"job": job})
    with contextlib.closing(ParticleFile(directory / "particles.vtkhdf")) as file:
        for frame in range(3):
            velocity = np.zeros_like(position)
            velocity[:, 0] = position[:, -1]
            arrays = {
                "id": np.arange(n),
                "type": np.where(inside, 0, np.where(wall, 1, 2)),
                "fluid": np.where(position[:, -1] > 0.1, 1, 0),
                "surface": np.abs(surface - position[:, -1]) < SPACING,
                "position": position,
                "velocity": velocity,
                "pressure": (frame + 1) * np.where(inside, 9800.0 * (surface - position[:, -1]), 0.0),
            }
            file.write(frame, 0, arrays)
            file.commit(frame, 0.1 * frame)


def is_picture(path):
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000


@pytest.fixture
def results(tmp_path):
    write_probes(tmp_path, 3.0)
    write_particles(tmp_path)
    return tmp_path


def test_histories_show_the_run_and_the_reference(tmp_path):
    (tmp_path / "other").mkdir()
    write_probes(tmp_path, 3.0)
    write_probes(tmp_path / "other", 2.0, 0.9)
    run, other = read_signals(tmp_path / "probes.csv"), read_signals(tmp_path / "other" / "probes.csv")
    figure = draw_histories({"a": run}, other)
    assert len(figure.axes) == 5  # pressure, height, force x, force z, moment
    assert len(draw_histories({"a": (run[0], run[1] + [("load.tank.Fx", "N/m", run[1][4][2])])}, other).axes) == 5
    baffles = [(name.replace("load", "load.baffle1"), unit, values) for name, unit, values in run[1][4:]]
    panels = draw_histories({"a": (run[0], run[1] + baffles)}).axes
    assert [len(panel.lines) for panel in panels] == [2, 2, 1, 1, 1, 1, 1, 1]
    assert panels[3].get_ylabel() == "Force per width x\non baffles\n[N/m]"
    panel = figure.axes[0]
    assert panel.get_ylabel() == "Pressure\n[kPa]"
    lines = {line.get_label(): line for line in panel.lines}
    assert list(lines) == ["P1", "P2", "P1 (reference)", "P2 (reference)"]
    np.testing.assert_allclose(lines["P1"].get_ydata(), run[1][0][2] * 1e-3)
    np.testing.assert_allclose(lines["P1 (reference)"].get_xdata(), other[0])
    assert lines["P1 (reference)"].get_color() == "black"
    assert panel.get_xlim() == (0.0, run[0][-1])
    both = draw_histories({"a": run, "b": other}).axes[1].lines
    assert [line.get_label() for line in both] == ["eta_left, a", "eta_right, a", "eta_left, b", "eta_right, b"]
    colours, styles = [line.get_color() for line in both], [line.get_linestyle() for line in both]
    assert colours[0] == colours[1] != colours[2] == colours[3] and styles[0] == styles[2] != styles[1] == styles[3]


def test_runs_are_told_apart_by_what_differs(tmp_path):
    job = JOB.format(dimension=2, size="[0.8, 0.5]", centre="[0.4, 0.0]", at="[0.0, 0.05]")
    jobs = {
        "low": job.replace("depth: 0.15", "depth: 0.12"),
        "high": job.replace("depth: 0.15", "depth: 0.2"),
        "first": job.replace("Tilted", "one baffle"),
        "second": job.replace("Tilted", "two baffles"),
        "same": job.replace("depth: 0.15", "depth: 0.12"),
    }
    for name, text in jobs.items():
        (tmp_path / name).mkdir()
        ParticleFile.create(tmp_path / name / "particles.vtkhdf", 1, 1, {"job": text})

    def names(*directories):
        return run_names([tmp_path / name for name in directories])

    assert names("low", "high") == ["depth = 0.12", "depth = 0.2"]
    assert names("first", "second") == ["one baffle", "two baffles"]
    assert names("low", "same") == [str(tmp_path / "low"), str(tmp_path / "same")]
    assert names("low", "nowhere") == [str(tmp_path / "low"), str(tmp_path / "nowhere")]
    for name in ("low", "high"):
        write_probes(tmp_path / name, 1.0)
    assert plot("probes", tmp_path / "low", tmp_path / "high") == 0
    assert is_picture(tmp_path / "low" / "probes.png")


def test_spectra_and_phases_show_the_motion(tmp_path):
    write_probes(tmp_path, 10.0)
    time, signals = read_signals(tmp_path / "probes.csv")
    panel = draw_spectra(time, signals[2:3], [6.469]).axes[0]
    line = panel.lines[0]
    assert line.get_xdata()[np.argmax(line.get_ydata())] == pytest.approx(6.469 / (2 * np.pi), abs=0.02)
    assert panel.lines[1].get_xdata()[0] == pytest.approx(6.469 / (2 * np.pi))
    panel = draw_phases(time, signals[2:3], 6.469).axes[0]
    mean = panel.lines[-2]
    assert mean.get_xdata()[np.argmax(mean.get_ydata())] == pytest.approx(90.0, abs=10.0)
    # for the first 5 s the wave grows with time: t sin(omega t) is greatest where tan(omega t) = -omega t
    roots = [brentq(lambda x: np.tan(x) + x, a * np.pi + 0.01, a * np.pi + 1.5) for a in (0.5, 2.5)]
    crests = np.degrees(roots) % 360.0
    np.testing.assert_allclose(panel.lines[-1].get_xdata()[:2], crests, atol=1.0)
    np.testing.assert_allclose(panel.lines[-1].get_xdata()[2:], 90.0, atol=5.0)


def test_snapshots_show_the_tank_where_it_is_and_share_one_scale(results):
    """At t = 0.2 s the tank is turned by 10 sin(6.469 0.2) = 9.6 degrees, its right end down."""
    view = make_view(results, "pressure")
    figure = draw_snapshots(results, view, [0.0, 0.2])
    first, second = figure.axes[:2]
    assert first.get_xlim() == second.get_xlim() and first.get_ylim() == second.get_ylim()
    assert first.collections[0].get_clim() == second.collections[0].get_clim()
    assert first.get_title(loc="left") == "t = 0.000 s"
    assert second.get_title(loc="left") == "t = 0.200 s, tank turned by +9.6°"
    tank, baffle = (patch.get_xy() for patch in second.patches)
    angle = np.radians(10 * np.sin(6.469 * 0.2))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    corners = np.array([[0.0, 0.0], [0.8, 0.0], [0.8, 0.5], [0.0, 0.5]])
    np.testing.assert_allclose(tank[:4], [0.4, 0.0] + (corners - [0.4, 0.0]) @ turn.T, atol=1e-12)
    np.testing.assert_allclose(np.ptp(first.patches[1].get_xy(), axis=0), [0.02, 0.1], atol=1e-12)
    assert baffle[1, 1] < baffle[0, 1]
    shown = second.collections[0]
    with h5py.File(results / "particles.vtkhdf") as file:
        liquid = np.sum(file["VTKHDF/PointData/type"][: file["VTKHDF/NumberOfPoints"][0]] == 0)
    assert len(shown.get_offsets()) == len(shown.get_array()) == liquid
    still = draw_snapshots(results, make_view(results, "pressure", earth=False), [0.2]).axes[0]
    np.testing.assert_allclose(still.patches[0].get_xy()[:4], corners)


@pytest.mark.parametrize(("field", "width"), [("fluid", 1), ("surface", 3)])
def test_particles(tmp_path, field, width, capsys):
    write_particles(tmp_path, width)
    assert plot("particles", tmp_path, "--field", field, "--time", "0.02", "0.1", "0.2") == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / f"particles_{field}.png")
    assert is_picture(tmp_path / f"particles_{field}.png")


def test_a_picture_in_space_needs_pyvista_and_a_3d_run(results, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    assert plot("space", results) == 2
    assert capsys.readouterr().err == "parmps: error: pictures in space need PyVista: pip install pyvista\n"


def test_a_picture_in_space(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    write_particles(tmp_path, 8)
    for field in ("pressure", "fluid"):
        assert plot("space", tmp_path, "--field", field) == 0
        assert np.ptp(pyvista.read(tmp_path / f"space_{field}.png").point_data.active_scalars) > 200


def test_peaks_and_spectra_commands(results, capsys):
    assert plot("peaks", results) == 0
    header, first, *_ = (results / "peaks.csv").read_text().splitlines()
    assert header.startswith("signal,unit,mean,min,max,at [s],mean of peaks,cycle [s],amplitude,phase [deg]")
    assert float(first.split(",")[7]) == pytest.approx(2 * np.pi / 6.469, rel=0.1)
    assert is_picture(results / "phases.png")
    assert "mean of peaks" in capsys.readouterr().out
    assert plot("spectra", results, "--signals", "P1", "load.Fx", "--begin", 1) == 0
    assert is_picture(results / "spectra.png")


def test_animation(results):
    assert plot("animation", results, "--field", "speed", "--rate", 5) == 0
    from PIL import Image

    with Image.open(results / "particles_speed.gif") as film:
        assert film.n_frames == 3
        assert film.info["duration"] == 200


def test_a_report_holds_all_pictures_itself(results):
    assert plot("report", results) == 0
    page = (results / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 5  # probes, spectra, phases, pressure, speed
    assert "<h1>Tilted</h1>" in page and "eta_left" in page and "src=\"http" not in page
    assert "has not ended yet" in page


def test_a_report_may_be_a_pdf_with_a_page_a_section(results):
    assert plot("report", results, "--format", "pdf") == 0
    data = (results / "report.pdf").read_bytes()
    assert data.startswith(b"%PDF-") and data.rstrip().endswith(b"%%EOF")
    assert data.count(b"/Type /Page ") == 9  # run, probes, peaks, spectra, phases, two snapshots, job on two


def test_titles_stand_as_they_are(results):
    """Dollar signs begin no formula."""
    view = make_view(results, "pressure")
    view.job = view.job.model_copy(update={"title": r"costs $5 or $\bad"})
    figure = draw_snapshots(results, view, [0.0])
    figure.savefig(results / "title.png")
    assert figure.get_suptitle() == view.job.title


@pytest.mark.parametrize(
    ("baffle", "spans"),
    [
        ("x: 0.4, bottom: 0.0, top: 0.3", [(0.0, 0.3)]),
        ("x: 0.4, bottom: 0.0, top: 0.3, width: [0.3, 0.4]", []),
        ("x: 0.4, bottom: 0.0, top: 0.3, openings: [[[0.05, 0.1], [0.15, 0.2]]]", [(0.0, 0.1), (0.2, 0.3)]),
        ("x: 0.4, bottom: 0.0, top: 0.3, openings: [[[0.2, 0.1], [0.3, 0.2]]]", [(0.0, 0.3)]),
        ("z: 0.2, left: 0.1, right: 0.7, openings: [[[0.2, 0.05], [0.3, 0.15]]]", [(0.1, 0.2), (0.3, 0.7)]),
        ("x: 0.4, ring: 0.05", [(0.0, 0.05), (0.35, 0.4)]),
        ("x: 0.4, ring: 0.12", [(0.0, 0.4)]),
        ("z: 0.2, ring: 0.05", [(0.0, 0.05), (0.75, 0.8)]),
    ],
)
def test_baffles_are_drawn_as_the_slice_cuts_them(baffle, spans):
    job = parse_job(
        f"dimension: 3\nspacing: 0.02\ntank: {{size: [0.8, 0.4, 0.4], baffles: [{{thickness: 0.02, {baffle}}}]}}\n"
        "fluids: [{name: water, depth: 0.2}]\ntime: {end: 1.0}\n"
    )
    along = 2 if "x:" in baffle else 0
    drawn = [(solid[:, along].min(), solid[:, along].max()) for solid in View(job, "speed", True, 0.1).solids]
    np.testing.assert_allclose(drawn, spans, atol=1e-12)


def test_a_surface_is_drawn_as_the_slice_cuts_it(tmp_path):
    creation = pytest.importorskip("trimesh.creation")
    creation.icosphere(4, 0.2).export(tmp_path / "ball.stl")
    job = parse_job(
        f"dimension: 3\nspacing: 0.05\ntank: {{shape: stl, size: [0.4, 0.4, 0.4], surface: {tmp_path / 'ball.stl'}}}\n"
        "fluids: [{name: water, depth: 0.2}]\ntime: {end: 1.0}\n"
    )
    edges = View(job, "speed", True, 0.1).edges
    radius = np.hypot(edges[..., 0] - 0.2, edges[..., 2] - 0.2)
    np.testing.assert_allclose(radius, np.sqrt(0.2**2 - 0.1**2), rtol=0.01)


@pytest.mark.filterwarnings("error::UserWarning")
def test_a_signal_that_is_nought_and_too_few_samples(tmp_path, capsys):
    write_particles(tmp_path)
    rows = "".join(f"{0.1 * n},0\n" for n in range(8))
    (tmp_path / "probes.csv").write_text(f"time [s],dry [m]\n{rows}")
    assert [plot(kind, tmp_path) for kind in ("probes", "spectra", "peaks", "report")] == [0] * 4
    (tmp_path / "probes.csv").write_text("time [s],dry [m]\n0,0\n1,0\n")
    assert [plot(kind, tmp_path) for kind in ("probes", "spectra", "peaks", "report")] == [0, 2, 2, 0]
    assert "2 samples from 0 s to 1 s of a run to 1 s; at least 4 are needed" in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, "time [s]\n0\n1\n", "time [s],P1 [Pa]\n", "time [s],P1 [Pa]\n0,text\n"])
def test_probes_that_cannot_be_drawn_give_one_message(tmp_path, content, capsys):
    if content:
        (tmp_path / "probes.csv").write_text(content)
    assert plot("probes", tmp_path) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"parmps: error: {tmp_path / 'probes.csv'}") and error.count("\n") == 1


def test_particles_without_a_frame_give_one_message(tmp_path, capsys):
    job = JOB.format(dimension=2, size="[0.8, 0.5]", centre="[0.4, 0.0]", at="[0.0, 0.05]")
    ParticleFile.create(tmp_path / "particles.vtkhdf", 1, 1, {"job": job})
    assert plot("particles", tmp_path) == 2
    assert capsys.readouterr().err == f"parmps: error: {tmp_path / 'particles.vtkhdf'} has no frame yet\n"


@pytest.mark.parametrize(
    ("name", "picture"), [("plot_probes", "probes.png"), ("plot_particles", "particles_speed.png")]
)
def test_the_scripts_are_the_same_commands(results, name, picture):
    options = ["--field", "speed"] if name == "plot_particles" else []
    command = [sys.executable, COMMANDS / f"{name}.py", results, *options]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr, done.stdout) == (0, "", f"{results / picture}\n")
    assert is_picture(results / picture)


def test_trade_draws_the_pareto_front_and_tells_the_prices(tmp_path):
    """Of a scene whose error is 4e4 (l0 / m)^2 % at a cost of 1e-3 (m / l0)^2 s; `papers` loses 100 l0 / m of ln A."""
    lines = ["# made up", "scene,preset,change,spacing [m],rows,error [%],amplitude [%],CPU time [s],note"]
    for l0, rows in ((0.04, 10), (0.02, 20), (0.01, 40)):
        error, cost = 4e4 * l0**2, 1e-3 / l0**2
        lines.append(f"wave,balanced,,{l0},{rows},{error},{error},{cost},")
        lines.append(f"wave,papers,,{l0},{rows},90,{100 * (np.exp(-100 * l0) - 1)},{10 * cost},")
        if l0 == 0.02:
            lines.append(f"wave,fast,,{l0},{rows},{1.4 * error},{error},{0.5 * cost},")
            lines.append(f"wave,accurate,,{l0},{rows},{0.5 * error},{error},{1.5 * cost},")
            lines.append(f"wave,balanced,scheme.gamma=1,{l0},{rows},{3 * error},{error},{3 * cost},")
    lines.append("wave,balanced,scheme.broken=1,0.02,20,,,,diverged at t = 1 s")
    (tmp_path / "trade.csv").write_text("\n".join(lines) + "\n")
    command = [sys.executable, COMMANDS / "trade.py", tmp_path / "trade.csv"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    table = (tmp_path / "trade.md").read_text()
    assert "| wave | 20 | accurate | 8.00 | 16.00 | 3.8 | front |" in table
    assert "| wave | 20 | gamma=1 | 48.00 | 16.00 | 7.5 |  |" in table
    assert "diverged at t = 1 s" in table
    for preset in ("fast", "balanced", "accurate"):
        assert f"- `{preset}` is what the rule chooses." in table
    # 5 % of error at l0^2 = 5 / 4e4; 5 % of amplitude lost by `papers` at 100 l0 = -ln 0.95, 1e-2 / l0^2 s
    assert "| wave | 8 (between 20 rows (16.0 %) and 40 (4.0 %)) | 3.8e+04 (extrapolated to 780 rows" in table
    assert (tmp_path / "trade.png").stat().st_size > 5000


@pytest.mark.parametrize(
    ("tank", "across", "low", "high"),
    [
        ("{shape: cylinder, size: [0.8, 0.4, 0.4]}", 0.2, [0.0, 0.0], [0.8, 0.4]),
        ("{shape: cylinder, size: [0.8, 0.4, 0.4]}", 0.08, [0.0, 0.04], [0.8, 0.36]),
        ("{shape: sphere, size: [0.4, 0.4, 0.4]}", 0.08, [0.04, 0.04], [0.36, 0.36]),
        ("{shape: prism, size: [0.8, 0.4, 0.4], chamfer: {bottom: [0.1, 0.2]}}", 0.05, [0.0, 0.1], [0.8, 0.4]),
    ],
)
def test_the_tank_is_drawn_as_the_slice_cuts_it(tank, across, low, high):
    job = parse_job(
        f"dimension: 3\nspacing: 0.02\ntank: {tank}\nfluids: [{{name: water, depth: 0.2}}]\ntime: {{end: 1.0}}\n"
    )
    outline = View(job, "speed", True, across).outline[:, [0, 2]]
    np.testing.assert_allclose(outline.min(axis=0), low, atol=1e-12)
    np.testing.assert_allclose(outline.max(axis=0), high, atol=1e-12)
