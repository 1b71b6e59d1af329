"""Probes on made-up states: hydrostatic pressure and force, height of flat, sloped and disturbed surfaces."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from parmps.domain import Domain
from parmps.loader import parse_job
from parmps.loads import Loads
from parmps.motion import FrameState, Motion
from parmps.particles import FLUID, WALL
from parmps.probes import build_probes
from parmps.tank import place

POST = "{x: 0.4, bottom: 0.0, top: 0.15, thickness: 0.006}"
G, RHO = 9.8, 1000.0


def make_job(probes, size=(0.8, 0.5), depth=0.25, spacing=0.004, baffles=""):
    return parse_job(
        f"dimension: {len(size)}\nspacing: {spacing}\ntank: {{size: {list(size)}, baffles: [{baffles}]}}\n"
        f"fluids: [{{name: water, depth: {depth}}}]\ntime: {{end: 1.0}}\nprobes: [{probes}]\n"
    )


def upright(force):
    """Frame of a tank at rest."""
    return FrameState(np.eye(3), np.zeros(3), np.zeros(3), np.array(force), np.zeros(3), np.zeros(3))


def hydrostatic(p, depth, force=(0.0, 0.0, -G)):
    """Pressure rho force . (x - surface), the surface through the height depth at the origin."""
    force = np.array(force)

    def pressure(x):
        return RHO * (x @ force - depth * force[2])

    wet = pressure(p.position + p.depth[:, None] * p.normal) > 0
    return SimpleNamespace(
        position=p.position,
        velocity=np.zeros_like(p.position),
        pressure=np.where(wet, pressure(p.position), 0.0),
        kind=p.kind,
        fluid=p.fluid,
        surface=np.zeros(len(p.kind), bool),
        normal=p.normal,
        depth=p.depth,
        spacing=p.spacing,
        frame=upright(force),
        density=RHO,
        friction=None,
    )


def cut(state, part):
    whole = {name: v for name, v in vars(state).items() if name in ("frame", "spacing", "density", "friction")}
    return SimpleNamespace(**{name: v[part] for name, v in vars(state).items() if name not in whole}, **whole)


def sorted_by_kind(state):
    """Particles as a rank has them: fluid, then walls, then dummies."""
    order = np.argsort(state.kind, kind="stable")
    names = "position", "normal", "depth", "pressure", "kind", "fluid"
    arrays = {name: getattr(state, name)[order] for name in names}
    liquid = np.count_nonzero(state.kind == FLUID)
    return SimpleNamespace(**arrays, liquid=liquid, rows=liquid + np.count_nonzero(state.kind == WALL))


def measure(job, state, geometry):
    values = {}
    # halves of the particles, as two ranks would have them
    n = len(state.kind) // 2
    parts = [cut(state, slice(0, n)), cut(state, slice(n, None))]
    for probe in build_probes(job, geometry):
        if hasattr(probe, "value"):
            value = probe.value(probe.partial(parts[0]) + probe.partial(parts[1]))
            titles = probe.columns
        else:
            loads = Loads([probe], Domain())
            loads.bind(sorted_by_kind(state))
            each = [loads.sums(sorted_by_kind(part), np.array([RHO]), state.frame, None) for part in parts]
            value = loads.values(sum(each)[None], [state.frame])[0]
            titles = [title for title in probe.columns if ".max [" not in title]
        values |= dict(zip(titles, value, strict=True))
    return values


@pytest.mark.parametrize("wall", ["half", "line"])
def test_pressure_is_exact_where_hydrostatic(wall):
    points = [(0.0, 0.05), (0.0, 0.003), (0.8, 0.111), (0.31, 0.0)]
    points += [(0.397, 0.1), (0.403, 0.1), (0.4, 0.15), (0.2, 0.1)]
    probes = ", ".join(f"{{name: P{i}, kind: pressure, at: {list(at)}}}" for i, at in enumerate(points))
    probes += ", {name: dry, kind: pressure, at: [0.0, 0.3]}, {name: air, kind: pressure, at: [0.2, 0.4]}"
    job = make_job(probes, baffles=POST)
    p = place(job, wall)
    force = np.array([0.3, 0.0, -G])
    values = measure(job, hydrostatic(p, 0.25, force), p.geometry)
    wanted = [RHO * (np.array([x, 0, z]) @ force + 0.25 * G) for x, z in points]
    np.testing.assert_allclose([values[f"P{i} [Pa]"] for i in range(len(points))], wanted, rtol=1e-9)
    assert values["dry [Pa]"] == values["air [Pa]"] == 0


@pytest.mark.parametrize("size", [(0.4, 0.4), (0.5, 0.4, 0.4), (0.4, 0.4, 0.4)])
def test_pressure_is_exact_on_curved_walls(size):
    """Walls seen from a probe on them fall away from its plane by d^2 / 2R."""
    across = [(0.2 + 0.2 * np.sin(a), 0.2 - 0.2 * np.cos(a)) for a in (0.0, 0.3, 0.8, 1.2)]
    points = [at if len(size) == 2 else (0.2, *at) for at in across]
    probes = ", ".join(f"{{name: P{i}, kind: pressure, at: {[float(x) for x in at]}}}" for i, at in enumerate(points))
    shape = "sphere" if size == (0.4, 0.4, 0.4) else "cylinder"
    job = parse_job(
        f"dimension: {len(size)}\nspacing: 0.05\ntank: {{shape: {shape}, size: {list(size)}}}\n"
        f"fluids: [{{name: water, depth: 0.25}}]\ntime: {{end: 1.0}}\nprobes: [{probes}]\n"
    )
    p = place(job, "half")
    values = measure(job, hydrostatic(p, 0.25), p.geometry)
    np.testing.assert_allclose(list(values.values()), [RHO * G * (0.25 - at[-1]) for at in points], rtol=1e-9)


def test_wall_pressure_is_by_the_body_force_at_the_wall():
    """In a tank that turns, pressure grows towards the wall by rho w^2 r, whatever the body force at the origin."""
    job = make_job("{name: P, kind: pressure, at: [0.8, 0.25]}, {name: load, kind: force}", depth=0.5)
    p = place(job, "half")
    frame = Motion(job.motion, 0.0, 2, job.tank).at(0.0)._replace(omega=np.array([0.0, 30.0, 0.0]))
    state = hydrostatic(p, 0.5)
    state.frame = frame
    state.pressure = 0.5 * RHO * 900.0 * np.sum(p.position**2, axis=1)
    values = measure(job, state, p.geometry)
    # linear over half a spacing
    assert values["P [Pa]"] == pytest.approx(0.5 * RHO * 900.0 * (0.8**2 + 0.25**2), rel=1e-4)
    assert values["load.Fx [N/m]"] == pytest.approx(0.5 * RHO * 900.0 * 0.8**2 * 0.5, rel=1e-4)


def test_pressure_near_the_waterline_is_an_area_average():
    probes = ", ".join(f"{{name: P{i}, kind: pressure, at: [0.0, {0.24 + 0.001 * i:g}]}}" for i in range(21))
    job = make_job(probes)
    p = place(job, "half")
    values = np.array(list(measure(job, hydrostatic(p, 0.25), p.geometry).values()))
    assert (values >= 0).all() and (np.diff(values) <= 0).all()
    assert values[0] == pytest.approx(RHO * G * 0.01, rel=0.01) and values[-1] == 0


def test_pressure_in_3d():
    probe = "{name: P, kind: pressure, at: [0.6, 0.155, 0.05], radius: 0.06}"
    job = make_job(probe, (0.6, 0.31, 0.5), 0.2, 0.02)
    p = place(job, "half")
    assert measure(job, hydrostatic(p, 0.2), p.geometry)["P [Pa]"] == pytest.approx(RHO * G * 0.15)


@pytest.mark.parametrize("wall", ["half", "line"])
def test_force_of_liquid_at_rest_is_its_weight(wall):
    job = make_job("{name: load, kind: force}", baffles=POST)
    p = place(job, wall)
    values = measure(job, hydrostatic(p, 0.25), p.geometry)
    assert list(values) == [
        f"load.{body}{signal}"
        for body in ("", "tank.", "baffle1.")
        for signal in ("Fx [N/m]", "Fz [N/m]", "My [N m/m]")
    ]
    weight = RHO * G * (0.8 * 0.25 - 0.006 * 0.15)
    assert values["load.Fz [N/m]"] == pytest.approx(-weight, rel=0.01)
    assert values["load.baffle1.Fz [N/m]"] == pytest.approx(-RHO * G * 0.1 * 0.006, rel=1e-6)
    for body in ("", "tank.", "baffle1."):
        for name in (f"load.{body}Fx [N/m]", f"load.{body}My [N m/m]"):
            assert values[name] == pytest.approx(0, abs=1e-6 * weight)
    for signal in ("Fx [N/m]", "Fz [N/m]", "My [N m/m]"):
        parts = values[f"load.tank.{signal}"] + values[f"load.baffle1.{signal}"]
        assert values[f"load.{signal}"] == pytest.approx(parts, abs=1e-9 * weight)


@pytest.mark.parametrize("size", [(0.8, 0.5), (0.6, 0.3, 0.5)])
def test_the_point_and_the_axes_of_a_force(size):
    """M' = M + (r - r') x F for another point; components along the earth's axes are those turned with the tank."""
    flat = len(size) == 2
    other = [0.1, 0.2] if flat else [0.1, 0.05, 0.2]
    probes = (
        "{name: a, kind: force}, {name: b, kind: force, frame: earth}, "
        f"{{name: c, kind: force, about: {other}}}"
    )
    baffle = "{name: wall, x: 0.4, bottom: 0.0, top: 0.15, thickness: 0.02}"
    job = make_job(probes, size, 0.2, 0.02, baffle)
    p = place(job, "half")
    state = hydrostatic(p, 0.2, (1.5, 0.0, -G) if flat else (1.5, -0.7, -G))
    turn = Rotation.from_euler("y" if flat else "xyz", 0.3 if flat else [0.2, 0.3, -0.1]).as_matrix()
    state.frame = state.frame._replace(rotation=turn)
    values = measure(job, state, p.geometry)
    titles = list(build_probes(job, p.geometry)[0].columns)
    assert any(title.startswith("a.wall.Fx [") for title in titles)

    def vectors(name, body):
        found = {t.split(" [")[0]: v for t, v in values.items()}
        return [np.array([found.get(f"{name}.{body}{kind}{a}", 0.0) for a in "xyz"]) for kind in "FM"]

    centre = np.array([0.4, 0.0, 0.0] if flat else [0.3, 0.15, 0.0])
    moved = centre - np.array([other[0], 0.0 if flat else other[1], other[-1]])
    for body in ("", "tank.", "wall."):
        force, moment = vectors("a", body)
        np.testing.assert_allclose(vectors("b", body), [turn @ force, turn @ moment], atol=1e-9)
        turned = np.cross(moved, force) * ([0, 1, 0] if flat else 1.0)
        np.testing.assert_allclose(vectors("c", body), [force, moment + turned], atol=1e-9)


def test_force_and_moment_in_3d():
    job = make_job("{name: load, kind: force}", (0.6, 0.3, 0.5), 0.2, 0.01)
    p = place(job, "half")
    tilt = 0.1 * G
    values = measure(job, hydrostatic(p, 0.2, (tilt, 0.0, -G)), p.geometry)
    mass = RHO * 0.6 * 0.3 * 0.2 + RHO * 0.6**2 / 2 * 0.1 * 0.3
    assert values["load.Fx [N]"] == pytest.approx(mass * tilt, rel=0.02)
    assert values["load.Fz [N]"] == pytest.approx(-mass * G, rel=0.005)
    assert values["load.Fy [N]"] == pytest.approx(0, abs=1e-6)
    # the weight acts at the centroid of the wedge on top of the layer
    x, z = (np.repeat(np.linspace(0.0005, 0.5995, 600), 300), np.tile(np.linspace(0.0005, 0.2995, 300), 600))
    inside = z < 0.2 + 0.1 * x
    moment = mass * (z[inside].mean() * tilt + (x[inside].mean() - 0.3) * G)
    assert values["load.My [N m]"] == pytest.approx(moment, rel=0.02)


GAUGES = "{name: a, kind: elevation, at: [0.1]}, {name: b, kind: elevation, at: [0.002]}"


@pytest.fixture(scope="module")
def gauges():
    """Return a function that reads two gauges, one at a wall, and a deep lattice to cut liquid from."""
    job = make_job(GAUGES)
    probes = build_probes(job, place(job, "half").geometry)
    deep = place(make_job(GAUGES, depth=0.448), "half")

    def read(position, row=None):
        row = np.zeros(len(position), bool) if row is None else row
        state = SimpleNamespace(position=position, kind=np.zeros(len(position), np.int8), surface=row)
        return np.array([probe.value(probe.partial(state))[0] for probe in probes])

    return read, deep.position[deep.kind == FLUID]


def test_flat_surface(gauges):
    read, lattice = gauges
    for rows in (1, 2, 5, 62, 100):
        flat = lattice[lattice[:, 2] < 0.004 * rows]
        np.testing.assert_allclose(read(flat), 0.004 * rows, atol=0.02 * 0.004)
        for part in (0.1, 0.3, 0.7):
            lifted = read(flat + [part * 0.004, 0, part * 0.004]) if rows > 10 else read(flat)
            wanted = 0.004 * (rows + (part if rows > 10 else 0))
            assert lifted[0] == pytest.approx(wanted, abs=0.02 * 0.004)
    assert not read(lattice[:0]).any()
    np.testing.assert_allclose(read(lattice[lattice[:, 2] < 0.448]), 0.448, atol=1e-4)


def test_spray_above_does_not_count(gauges):
    read, lattice = gauges
    flat = lattice[lattice[:, 2] < 0.248]
    blob = lattice[(np.abs(lattice[:, 0] - 0.1) < 0.02) & (np.abs(lattice[:, 2] - 0.35) < 0.02)]
    np.testing.assert_allclose(read(np.concatenate([flat, blob])), read(flat), rtol=1e-12)


@pytest.mark.parametrize("slope", [0.0, 0.1, 0.5])
def test_disturbed_and_sloped_surface(gauges, slope):
    """A lattice sheared to a slope, in many phases, and shaken by a tenth of a spacing."""
    read, lattice = gauges
    rng = np.random.default_rng(4)
    flat = lattice[lattice[:, 2] < 0.248]
    errors = []
    for shake in (0.0, 0.1):
        for _ in range(30):
            shift = 0.004 * rng.uniform(-0.5, 0.5, size=2)
            rise = slope * (flat[:, 0] - 0.1) + shift[1]
            moved = flat + np.stack([np.full_like(rise, shift[0]), np.zeros_like(rise), rise], axis=1)
            moved = moved + rng.normal(size=moved.shape) * [1, 0, 1] * shake * 0.004
            level = 0.248 + shift[1] + slope * (np.array([0.1, 0.002]) - shift[0] - 0.1)
            errors.append((read(moved, flat[:, 2] > 0.244) - level) / 0.004)
    errors = np.array(errors)
    # half a spacing is along the normal, here along the columns; the gauge is of a lattice with 0.8 % more
    assert np.abs(errors[:30] - 0.5 * (np.hypot(1.0, slope) - 1.0)).max() < 0.05
    assert np.abs(errors[30:].mean(axis=0)).max() < 0.1
    assert errors[30:].std(axis=0).max() < 0.12


def test_gauges_do_not_care_how_columns_stand(gauges):
    """Columns crowded at the wall, as half a spacing of a wave pushes them there, and rows stretched in a crest."""
    read, lattice = gauges
    flat = lattice[lattice[:, 2] < 0.248]
    row = flat[:, 2] > 0.244
    crowded = flat - [[0.0008, 0, 0]] * np.exp(-flat[:, :1] / 0.008)
    np.testing.assert_allclose(read(crowded, row), 0.248, atol=0.01 * 0.004)
    sloped = crowded + [[0, 0, 0.2]] * crowded[:, :1]
    thickness = 0.002 * np.hypot(1.0, 0.2)
    np.testing.assert_allclose(read(sloped, row), 0.246 + thickness + 0.2 * np.array([0.1, 0.002]), atol=0.01 * 0.004)
    crest = np.array([[0.1, 0, 0.246]]) + (flat - [[0.1, 0, 0.246]]) * [[1 / 1.2, 1, 1.2]]
    assert read(crest, row)[0] == pytest.approx(0.248, abs=0.01 * 0.004)


def test_gauge_beside_and_above_a_baffle():
    places = enumerate((0.39, 0.395, 0.4))
    probes = ", ".join(f"{{name: g{i}, kind: elevation, at: [{x}]}}" for i, x in places)
    job = make_job(probes, baffles=POST)
    p = place(job, "half")
    values = list(measure(job, hydrostatic(p, 0.25), p.geometry).values())
    np.testing.assert_allclose(values, 0.25, atol=0.1 * 0.004)
    # the other side of the baffle is dry below its tip
    left = p.position[(p.kind == FLUID) & (p.position[:, 0] < 0.4) & (p.position[:, 2] < 0.1)]
    state = SimpleNamespace(position=left, kind=np.zeros(len(left), np.int8), surface=np.zeros(len(left), bool))
    gauge = build_probes(make_job("{name: g, kind: elevation, at: [0.405]}", baffles=POST), p.geometry)[0]
    assert gauge.value(gauge.partial(state))[0] == 0


def test_gauge_in_3d():
    job = make_job("{name: g, kind: elevation, at: [0.01, 0.155]}", (0.6, 0.31, 0.5), 0.2, 0.02)
    p = place(job, "half")
    assert measure(job, hydrostatic(p, 0.2), p.geometry)["g [m]"] == pytest.approx(0.2, abs=0.1 * 0.02)


def layered(position, heights, spacing=0.01):
    """State with liquids between given functions of x: number of the first whose top is above the particle."""
    number = np.sum([position[:, 2] > height(position[:, 0]) for height in heights], axis=0)
    n = len(position)
    return SimpleNamespace(
        position=position, velocity=np.zeros((n, 3)), kind=np.full(n, FLUID), fluid=number.astype(np.int8),
        spacing=spacing, frame=upright([0.0, 0.0, -G]), density=RHO, volume=np.full(n, spacing**2),
        compression=np.zeros(n), fraction=np.ones(n),
    )  # fmt: skip


def own_share(position, fluid, spacing, length):
    """Share of the own liquid around each particle, by a smooth weight of 2.1 spacings, with images behind walls."""
    images = [position * [side, 1, 1] + [end, 0, 0] for side, end in ((1, 0.0), (-1, 0.0), (-1, 2.0 * length))]
    trees = cKDTree(position), cKDTree(np.concatenate(images))
    near = trees[0].sparse_distance_matrix(trees[1], 2.1 * spacing, output_type="coo_matrix")
    q = near.data / (2.1 * spacing)
    weight = (1.0 - q) ** 4 * (1.0 + 4.0 * q)
    own = weight * (fluid[near.row] == np.tile(fluid, 3)[near.col])
    return np.bincount(near.row, own, len(fluid)) / np.bincount(near.row, weight, len(fluid))


def three_layer_job(probes):
    fluids = ", ".join(f"{{name: {name}, depth: {d}}}" for name, d in (("a", 0.1), ("b", 0.15), ("c", 0.2)))
    return parse_job(
        f"dimension: 2\nspacing: 0.01\ntank: {{size: [0.8, 0.6]}}\nfluids: [{fluids}]\ntime: {{end: 1.0}}\n"
        f"probes: [{probes}]\n"
    )


@pytest.mark.parametrize("x", [0.0, 0.3, 0.8])
def test_interfaces_between_layers(x):
    pairs = {"ab": "[b, a]", "bc": "[b, c]"}
    probes = ", ".join(f"{{name: {n}, kind: interface, between: {p}, at: [{x}]}}" for n, p in pairs.items())
    job = three_layer_job(probes)
    p = place(job, "half")
    position = p.position[p.kind == FLUID]
    flat = [lambda x: 0.1 + 0 * x, lambda x: 0.25 + 0 * x]
    values = measure(job, layered(position, flat), p.geometry)
    assert values == pytest.approx({"ab [m]": 0.1, "bc [m]": 0.25}, abs=1e-3)
    sloped = [lambda x: 0.1 + 0.1 * (x - 0.4), lambda x: 0.25 - 0.05 * (x - 0.4)]
    values = measure(job, layered(position, sloped), p.geometry)
    assert values == pytest.approx({"ab [m]": sloped[0](x), "bc [m]": sloped[1](x)}, abs=4e-3)
    # a drop of c in b, and one of b in c
    state = layered(position, flat)
    for z, number in ((0.2, 2), (0.35, 1)):
        state.fluid[np.hypot(position[:, 0] - x, position[:, 2] - z) < 0.015] = number
    assert measure(job, state, p.geometry)["bc [m]"] == pytest.approx(0.25, abs=1e-3)
    # where b is missing, its end is where the other one begins or ends
    state = layered(position, [flat[1], flat[1]])
    assert measure(job, state, p.geometry) == pytest.approx({"ab [m]": 0.25, "bc [m]": 0.25}, abs=3e-3)
    assert measure(job, layered(position[:0], flat), p.geometry) == {"ab [m]": 0.0, "bc [m]": 0.0}


WAVES = {
    "flat": lambda x: 0.0 * x,
    "slope 0.02": lambda x: 0.02 * x,
    "slope 0.05": lambda x: 0.05 * x,
    "slope 0.1": lambda x: -0.1 * x,
    "slope 0.3": lambda x: 0.3 * (x - 0.4),
    "40 spacings": lambda x: 0.003 * np.cos(5.0 * np.pi * x),
}


@pytest.mark.parametrize("wave", WAVES)
def test_interfaces_on_distorted_lattices(wave):
    """Rows that a smooth flow has made thick and thin and moved along, with noise of a twentieth of a spacing."""
    places = (0.0, 0.8, 0.33, 0.37)
    probes = ", ".join(f"{{name: i{n}, kind: interface, between: [b, c], at: [{x}]}}" for n, x in enumerate(places))
    job = three_layer_job(probes)
    gauges = build_probes(job, place(job, "half").geometry)
    x, z = (axis.ravel() for axis in np.meshgrid(np.arange(0.005, 0.8, 0.01), np.arange(0.005, 0.45, 0.01)))
    fluid = np.digitize(z, [0.1, 0.25])
    up = z - 0.25  # at 0, the interface stays where it is
    rng = np.random.default_rng(8)
    for noise, most, spread in ((0.0, 0.03, 0.02), (0.05, 0.12, 0.045)):
        errors = []
        for _ in range(24):
            k, q, phase = 2.0 * np.pi / 0.05, np.pi / 0.06, rng.uniform(0.0, 2.0 * np.pi)
            moved = x + 0.01 * rng.uniform(-0.3, 0.3) + 0.002 * q / k * np.cos(q * up) * np.cos(k * x + phase)
            raised = z + 0.002 * np.sin(q * up) * np.sin(k * x + phase)  # keeps the volume to first order
            moved, raised = (values + 0.01 * noise * rng.normal(size=len(x)) for values in (moved, raised))
            position = np.stack([moved, 0.0 * x, raised + WAVES[wave](moved)], axis=1)
            inside = (moved > 0.0) & (moved < 0.8)
            state = layered(position[inside], [])
            state.fluid = fluid[inside]
            state.fraction = own_share(state.position, state.fluid, 0.01, 0.8)
            found = np.concatenate([gauge.value(gauge.partial(state)) for gauge in gauges])
            errors.append((found - 0.25 - WAVES[wave](np.array(places))) / 0.01)
        errors = np.array(errors)
        assert np.abs(errors).max() < most and np.sqrt((errors**2).mean(axis=0)).max() < spread


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_interfaces_of_a_thin_layer(rows):
    """The row beside the one interface of a layer is not taken for that beside the other."""
    pairs = {"ab": "[b, a]", "bc": "[b, c]"}
    probes = ", ".join(f"{{name: {n}, kind: interface, between: {p}, at: [0.3]}}" for n, p in pairs.items())
    job = three_layer_job(probes)
    p = place(job, "half")
    position = p.position[p.kind == FLUID]
    state = layered(position, [lambda x: 0.1 + 0 * x, lambda x: 0.1 + 0.01 * rows + 0 * x])
    state.fraction = own_share(position, state.fluid, 0.01, 0.8)
    state.position = position + [0, 0, 0.0023]
    wanted = {"ab [m]": 0.1023, "bc [m]": 0.1023 + 0.01 * rows}
    assert measure(job, state, p.geometry) == pytest.approx(wanted, abs=1e-6)


def test_a_liquid():
    job = three_layer_job("{name: middle, kind: liquid, fluid: b}")
    p = place(job, "half")
    state = layered(p.position[p.kind == FLUID], [lambda x: 0.1 + 0 * x, lambda x: 0.25 + 0 * x])
    state.velocity[:, 0] = 2.0
    own = np.flatnonzero(state.fluid == 1)
    state.fraction[own[:12]] = 0.4
    state.fraction[state.fluid != 1] = 0.1
    values = measure(job, state, p.geometry)
    mass = RHO * 0.8 * 0.15
    assert values == pytest.approx(
        {
            "middle.volume [m2]": 0.8 * 0.15,
            "middle.x [m]": 0.4,
            "middle.z [m]": 0.175,
            "middle.energy [J/m]": mass * (0.5 * 4.0 + G * 0.175),
            "middle.strayed [-]": 12 / len(own),
        }
    )
    state.compression[:] = 0.01
    assert measure(job, state, p.geometry)["middle.volume [m2]"] == pytest.approx(0.8 * 0.15 / 1.01)


@pytest.mark.parametrize("size", [(0.8, 0.5), (0.6, 0.3, 0.4)])
def test_gauges_on_the_earth_see_level_surfaces_where_they_stand(size):
    """Level liquids in a tank that has rolled, risen and moved aside."""
    d, spacing = len(size), 0.01 if len(size) == 2 else 0.02
    at = [[0.35], [0.15]] if d == 2 else [[0.3, 0.15], [0.15, 0.2]]
    probes = ", ".join(
        f"{{name: {kind[0]}{n}, kind: {kind}, at: {place}, fixed_to: earth{more}}}"
        for kind, more in (("elevation", ""), ("interface", ", between: [a, b]"))
        for n, place in enumerate(at)
    )
    job = parse_job(
        f"dimension: {d}\nspacing: {spacing}\ntank: {{size: {list(size)}}}\ntime: {{end: 1.0}}\n"
        "fluids: [{name: a, depth: 0.1}, {name: b, depth: 0.3}]\n"
        "motion: [{kind: pitch, amplitude_deg: 12, omega: 0, phase_deg: 90}, "
        "{kind: surge, amplitude: 0.05, omega: 0, phase_deg: 90}, "
        f"{{kind: heave, amplitude: 0.04, omega: 0, phase_deg: 90}}]\nprobes: [{probes}]\n"
    )
    p = place(job, "half")
    state = hydrostatic(p, 0.4)
    state.frame = Motion(job.motion, G, d, job.tank).at(0.5)
    height = (p.position @ state.frame.rotation.T + state.frame.origin)[:, 2]
    state.kind = np.where((p.kind == FLUID) & (height < 0.3), FLUID, 1)
    state.fluid = (height > 0.2).astype(int)
    state.fraction = own_share(p.position, state.fluid, spacing, size[0])
    values = measure(job, state, p.geometry)
    np.testing.assert_allclose(list(values.values()), [0.3, 0.3, 0.2, 0.2], atol=0.4 * spacing)
