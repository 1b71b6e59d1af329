"""Tanks that are no boxes: content, distance, walls and counts against geometry; liquid at rest and in free waves."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from parmps.domain import Domain
from parmps.errors import InputError
from parmps.faces import faces
from parmps.hull import Polygon, Round
from parmps.kernels.walls import distances
from parmps.loader import load_job, parse_job
from parmps.simulation import Simulation
from parmps.tank import DUMMY, FLUID, WALL, count_particles, place

G = 9.8
OCTAGON = "shape: prism, size: {size}, chamfer: {{bottom: [0.2, 0.2], top: [0.2, 0.1]}}"
PRISM_2D = OCTAGON.format(size=[1.0, 0.8])
PRISM_3D = OCTAGON.format(size=[0.6, 1.0, 0.8])
VEE = "shape: prism, size: [1.6, 0.8], chamfer: {bottom: [0.8, 0.8]}"
DISC = "shape: cylinder, size: [0.8, 0.8]"
CYLINDER = "shape: cylinder, size: [0.6, 0.8, 0.8]"
BALL = "shape: sphere, size: [0.8, 0.8, 0.8]"


def job_of(tank, liquid="depth: 0.4", spacing=0.04, more=""):
    dimension = 2 if tank in (PRISM_2D, VEE, DISC) else 3
    return parse_job(
        f"dimension: {dimension}\nspacing: {spacing}\ntank: {{{tank}}}\nfluids: [{{name: water, {liquid}}}]\n"
        f"time: {{end: 100.0, max_step: 4.0e-3, cfl: 0.4}}\n{more}\n"
    )


def write_stl(path, corners, triangles):
    lines = ["solid tank"]
    for triangle in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in corners[triangle]]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid tank"]))


def wedge(path):
    """A tank 0.6 m long, 1 m wide and 0.8 m high with a gable roof from 0.5 m height on; not at the origin."""
    section = np.array([[0, 0], [1, 0], [1, 0.5], [0.5, 0.8], [0, 0.5]])
    corners = np.concatenate([np.insert(section, 0, x, axis=1) for x in (0.0, 0.6)]) + [3.0, -1.0, 2.0]
    ends = [(0, k + 1, k) for k in range(1, 4)] + [(5, k + 5, k + 6) for k in range(1, 4)]
    sides = [t for k in range(5) for t in ((k, (k + 1) % 5, k + 5), ((k + 1) % 5, (k + 1) % 5 + 5, k + 5))]
    write_stl(path, corners, [list(t) for t in ends + sides])
    return f"shape: stl, size: [0.6, 1.0, 0.8], surface: {path}"


CONTENTS = {PRISM_2D: 0.74, PRISM_3D: 0.74 * 0.6, VEE: 0.64, DISC: np.pi * 0.16, CYLINDER: np.pi * 0.16 * 0.6}
CONTENTS[BALL] = 4 / 3 * np.pi * 0.4**3


def test_content_below_a_level_by_counting_points():
    corners = np.array([[0.2, 0], [0.8, 0], [1, 0.2], [1, 0.7], [0.8, 0.8], [0.2, 0.8], [0, 0.7], [0, 0.2]])
    rng = np.random.default_rng(1)
    for hull in (
        Polygon(corners, np.ones(8, bool)),
        Round(np.array([0.5, 0.4]), 0.4),
        Round(np.array([0.5, 0.5, 0.4]), 0.4),
    ):
        point = rng.uniform(0, 1, (200_000, hull.dimension))
        inside = hull.distance(point)[0] > 0
        for level in (0.05, 0.3, 0.75, 1.0):
            found = np.mean(inside & (point[:, -1] < level))
            assert hull.content_below(level) == pytest.approx(found, abs=0.004)


@pytest.mark.parametrize("tank", [PRISM_2D, PRISM_3D, VEE, DISC, CYLINDER, BALL])
@pytest.mark.parametrize("wall", ["half", "line"])
def test_walls_surround_the_hull(tank, wall):
    job = job_of(tank, "fill: 0.6", 0.08 if tank == BALL else 0.04)
    p = place(job, wall)
    l0, walls = p.spacing, p.geometry.walls
    assert p.volume.sum() == pytest.approx(0.6 * CONTENTS[tank], rel=1e-9 if wall == "half" else 0.2)
    if wall == "half":  # as many particles as spacings fit, within half a row
        assert p.total_fluid * l0**job.dimension == pytest.approx(p.volume.sum(), rel=3e-3)
    solid = p.kind != FLUID
    surface = p.position + p.depth[:, None] * p.normal
    np.testing.assert_allclose(distances(surface[solid], walls)[0], 0.0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(p.normal[solid], axis=1), 1.0)
    gap, normal = distances(p.position, walls)
    inset = 0.5 * l0 if wall == "half" else 0.0
    np.testing.assert_allclose(-gap[p.kind == WALL].max(), inset, atol=0.02 * l0)
    assert gap[~solid].min() > (0.29 if wall == "half" else 0.75) * l0
    into = distances((surface + 0.1 * l0 * p.normal)[p.kind == WALL], walls)[0]
    assert into.min() > -0.05 * l0  # behind an acute corner the wall turns away
    # evenly spaced: no holes and no clusters among the walls, nor in the liquid
    tree = cKDTree(p.position)
    assert tree.query(p.position, 2)[0][:, 1].min() > 0.55 * l0
    assert cKDTree(p.position[p.kind == WALL]).query(p.position[p.kind == WALL], 2)[0][:, 1].max() < 1.2 * l0
    parent = p.parent[p.kind == DUMMY]
    assert (p.kind[parent] == WALL).all()
    assert np.linalg.norm(p.position[p.kind == DUMMY] - p.position[parent], axis=1).max() < 6.0 * l0


@pytest.mark.parametrize("tank", [PRISM_2D, PRISM_3D, DISC, CYLINDER, BALL])
def test_areas_close(tank):
    p = place(job_of(tank, spacing=0.08 if tank == BALL else 0.04), "half")
    wall = p.kind == WALL
    _, area = faces(p.geometry, p.position[wall], p.normal[wall], p.depth[wall])
    np.testing.assert_allclose(area.sum(axis=0), 0.0, atol=1e-3)
    whole = {PRISM_2D: 2 * 0.8, PRISM_3D: 2 * 0.74, DISC: 4 * 0.4, CYLINDER: 2 * np.pi * 0.16, BALL: 2 * np.pi * 0.16}
    assert np.abs(area[:, 0]).sum() == pytest.approx(whole[tank], rel=0.01)


def test_shares_of_a_hull_do_not_depend_on_their_number():
    job = job_of(PRISM_3D)
    whole, shares = place(job, "half"), [place(job, "half", part, 3) for part in range(3)]
    for name in ("position", "kind", "normal", "depth", "volume", "parent", "id"):
        np.testing.assert_array_equal(np.concatenate([getattr(share, name) for share in shares]), getattr(whole, name))


def test_fill_is_a_share_of_the_volume():
    assert job_of(DISC, "fill: 0.5").depths[0] == pytest.approx(0.4)
    assert job_of(VEE, "fill: 0.25").depths[0] == pytest.approx(0.4)
    assert job_of(BALL, "fill: 1.0").depths[0] == pytest.approx(0.8)
    box = parse_job(
        "dimension: 2\nspacing: 0.01\ntank: {size: [1.0, 0.8]}\ntime: {end: 1}\n"
        "fluids: [{name: a, fill: 0.25}, {name: b, depth: 0.1}, {name: c, fill: 0.5}]"
    )
    np.testing.assert_allclose(box.depths, [0.2, 0.1, 0.4])


def test_surface_from_a_file(tmp_path):
    job = job_of(wedge(tmp_path / "wedge.stl"), "fill: 0.5", 0.08)
    assert job.depths[0] == pytest.approx(0.325)  # half of 0.6 x (0.5 + 0.15) m3, below the roof
    p = place(job, "half")
    hull = p.geometry.hull
    assert hull.content_below(0.8) == pytest.approx(0.6 * 0.65)
    assert p.total_fluid * p.spacing**3 == pytest.approx(0.195, rel=0.005)
    rng = np.random.default_rng(0)
    point = rng.uniform(0, 1, (500, 3)) * [0.6, 1.0, 0.8]
    x, y, z = point.T
    roof = ((0.8 - z) - 0.6 * np.abs(y - 0.5)) / np.hypot(1, 0.6)
    exact = np.min([x, 0.6 - x, y, 1 - y, z, roof], axis=0)
    found, _ = hull.distance(point)
    assert np.abs(found - exact)[exact > 0].max() < 0.2 * p.spacing
    assert (found[exact < -0.1 * p.spacing] < 0).all()
    shell = p.geometry.arrangement.shells[0]
    np.testing.assert_allclose(hull.distance(shell.position)[0], -0.5 * p.spacing, atol=2e-3)
    gap = cKDTree(shell.position).query(shell.position, 2)[0][:, 1] / p.spacing
    assert gap.min() > 0.6 and gap.max() < 1.3


@pytest.mark.parametrize(
    ("tank", "message"),
    [
        ("size: [1.0, 0.8, 0.8], shape: sphere", "tank.size: .* must be equal, the diameter of the sphere"),
        ("size: [1.0, 0.8, 0.7], shape: cylinder", "tank.size: .* the last 2 must be equal"),
        ("size: [1.0, 0.8, 0.8], shape: cylinder, lid: false", "tank.lid: got false"),
        ("size: [1.0, 0.8, 0.8], shape: stl", "tank.surface: missing"),
        ("size: [1.0, 0.8, 0.8], shape: stl, surface: none.stl", "tank.surface: .*none.stl: no such file"),
        ("size: [1.0, 0.8, 0.8], surface: none.stl", "tank.surface: a box has none"),
        (
            "size: [1.0, 0.8, 0.8], shape: prism, chamfer: {bottom: [0.5, 0.1]}",
            r"tank.chamfer.bottom\[0\]: got 0.5 m, must be at most half",
        ),
        (
            "size: [1.0, 0.8, 0.8], shape: prism, chamfer: {bottom: [0.1, 0.5], top: [0.1, 0.5]}",
            "tank.chamfer: the chamfers' heights sum to 1 m",
        ),
        ("size: [1.0, 0.8, 0.8], baffles: [{x: 0.5, ring: 0.4, thickness: 0.1}]", r"baffles\[0\].ring: got 0.4 m"),
        (
            "size: [1.0, 0.8, 0.8], shape: cylinder, baffles: [{x: 0.5, ring: 0.1, thickness: 0.1}]",
            r"baffles\[0\].ring: needs a 3D tank of shape box or prism",
        ),
        (
            "size: [1.0, 0.8, 0.8], baffles: [{x: 0.5, bottom: 0, top: 0.4, thickness: 0.1, "
            "openings: [[[0.1, 0.1], [0.2, 0.4]]]}]",
            r"openings\[0\]: reaches from 0.1 m to 0.4 m, must lie inside the plate's 0 m to 0.4 m",
        ),
        ("size: [1.0, 0.8, 0.8], baffles: [{x: 0.5, top: 0.4, ring: 0.1, thickness: 0.1}]", "got x, top, ring, must"),
    ],
)
def test_refusals(tank, message):
    with pytest.raises(InputError, match=message):
        job_of(tank)


def test_refused_fills_and_surfaces(tmp_path):
    with pytest.raises(InputError, match="exactly one of depth, fill and region"):
        job_of(DISC, "fill: 0.5, depth: 0.1")
    with pytest.raises(InputError, match="fluids: overfull: fill sums to 1.2"):
        job_of(DISC, "fill: 0.6}, {name: oil, fill: 0.6")
    tank = wedge(tmp_path / "wedge.stl")
    with pytest.raises(InputError, match="tank.size: got .* but .* is 0.6 x 1 x 0.8 m large"):
        job_of(tank.replace("[0.6, 1.0, 0.8]", "[6.0, 10.0, 8.0]"))
    lines = (tmp_path / "wedge.stl").read_text().splitlines()
    (tmp_path / "wedge.stl").write_text("\n".join(lines[:1] + lines[8:]))
    with pytest.raises(InputError, match="tank.surface: .*is not closed"):
        job_of(tank)
    (tmp_path / "wedge.stl").write_text("no surface")
    with pytest.raises(InputError, match="tank.surface: .*"):
        job_of(tank)


BAFFLED = "size: [0.6, 0.4, 0.5], baffles: [{}]"
PERFORATED = (
    "{x: 0.3, bottom: 0, top: 0.4, thickness: 0.02, "
    "openings: [[[0.1, 0.1], [0.18, 0.2]], [[0.22, 0.1], [0.3, 0.2]], [[0.1, 0.25], [0.3, 0.33]]]}"
)


@pytest.mark.parametrize(
    ("baffle", "face", "edges", "through"),
    [
        ("{x: 0.3, ring: 0.1, thickness: 0.03}", 2 * (0.2 - 0.06), 2 * 0.2 + 2 * 0.3, [0.3, 0.2, 0.25]),
        (PERFORATED, 2 * (0.16 - 0.032), 2 * 0.36 + 0.4 + 2 * 0.28, [0.3, 0.14, 0.15]),
    ],
)
@pytest.mark.parametrize("wall", ["half", "line"])
def test_baffles_with_openings(baffle, face, edges, through, wall):
    p = place(job_of(BAFFLED.format(baffle), "depth: 0.3", 0.02), wall)
    solid, l0 = p.geometry.solids[0], p.spacing
    wall_layer = p.kind == WALL
    surface = p.position + p.depth[:, None] * p.normal
    np.testing.assert_allclose(distances(surface[p.kind != FLUID], p.geometry.walls)[0], 0.0, atol=1e-9)
    assert distances((surface + 0.1 * l0 * p.normal)[wall_layer], p.geometry.walls)[0].min() > 0.0
    owner, area = faces(p.geometry, p.position[wall_layer], p.normal[wall_layer], p.depth[wall_layer])
    sums = np.abs(area[owner == 1]).sum(axis=0)
    assert sums[0] == pytest.approx(face, rel=1e-9 if wall == "half" else 0.1)
    if wall == "half":
        assert sums[1] + sums[2] == pytest.approx(edges * (solid.high - solid.low)[0], rel=1e-9)
    # the opening is filled with liquid, the rest of the plate is not
    liquid = p.position[p.kind == FLUID]
    assert cKDTree(liquid).query(through)[0] < l0
    assert distances(liquid, p.geometry.walls)[0].min() > 0.24 * l0


def test_counts_of_the_papers():
    """Walls on the wall lines, one layer and two of dummies; the paper prints 2.2 million for 4.5 mm alone."""
    baffled = load_job("jobs/baffled_tank_3d.yaml", ["spacing=0.005"])
    assert count_particles(baffled, "line", 5)[0]["fluid"] == 274_195
    for spacing, total in ((0.0045, 2.2e6), (0.006, 0.96e6)):
        job = load_job("jobs/lng_tank.yaml", [f"spacing={spacing}"])
        assert count_particles(job, "line")[0]["total"] == pytest.approx(total, rel=0.02)


@pytest.mark.parametrize("tank", [PRISM_2D, VEE, DISC, PRISM_3D, CYLINDER, BALL])
@pytest.mark.parametrize("fill", [0.2, 0.8])
def test_fill_is_exact_to_half_a_row(tank, fill):
    """Count times the volume of the lattice's cell misses the fill by less than half a row across the tank."""
    p = place(job_of(tank, f"fill: {fill}", 0.08 if tank == BALL else 0.04), "half")
    low, high = p.geometry.walls.container[:, :2]
    across = np.prod((high - low)[: p.geometry.dimension - 1])
    wanted = fill * CONTENTS[tank]
    assert abs(p.total_fluid * p.spacing**p.geometry.dimension - wanted) < 0.5 * p.spacing * across
    assert p.volume.sum() == pytest.approx(wanted, rel=1e-9)


@pytest.fixture
def start():
    begun = []

    def begin(job):
        begun.append(Simulation(job, Domain()))
        return begun[-1]

    yield begin
    for sim in begun:
        sim.solver.close()


@pytest.mark.parametrize("tank", [PRISM_2D, DISC])
def test_water_at_rest_beside_sloped_and_curved_walls(start, tank):
    sim = start(job_of(tank, spacing=0.02))
    while sim.time < 0.3:
        sim.step(0.3)
    sim.choose_step(1.0)
    sim.solve()
    p = sim.particles
    liquid = slice(0, p.liquid)
    error = p.pressure[liquid] / (1000.0 * G) + p.position[liquid, 2] - 0.4
    assert np.sqrt(np.mean(error**2)) < 3e-3 * 0.4
    assert np.sqrt(np.mean(np.sum(p.velocity[liquid] ** 2, axis=1))) < 1e-3 * np.sqrt(G * 0.4)
    assert abs(sim.volume_drift()) < 1e-3
    assert sim.put_back == 0


BAFFLED_STILL = {
    "curved": "tank: {shape: cylinder, size: [0.6233, 0.6233], baffles: [{x: 0.2144, bottom: 0.0, top: 0.18, "
    "thickness: 0.02308}]}\nspacing: 0.01154\nfluids: [{name: water, fill: 0.7}]",
    "acute": "tank: {shape: prism, size: [1.31, 0.92], chamfer: {bottom: [0.43, 0.32], top: [0.52, 0.45]}, "
    "baffles: [{z: 0.5134, left: 0.488, right: 1.31, thickness: 0.112}]}\nspacing: 0.0413\n"
    "fluids: [{name: water, fill: 1.0}]",
}


@pytest.mark.parametrize("case", BAFFLED_STILL)
@pytest.mark.parametrize("every", [0.02, 0.1])
def test_still_water_beside_baffles_on_sloped_and_curved_walls_stays_still(start, case, every):
    sim = start(parse_job(f"dimension: 2\ntime: {{end: 1}}\n{BAFFLED_STILL[case]}"))
    depth = sim.job.depths[0]
    while sim.time < 0.3 - 1e-9:
        sim.step((int(sim.time / every + 1e-6) + 1) * every)
    sim.choose_step(1.0)
    sim.solve()
    p = sim.particles
    liquid = slice(0, p.liquid)
    error = p.pressure[liquid] / (1000.0 * G) + p.position[liquid, 2] - depth
    error -= np.median(error) if sim.job.full else 0.0
    assert np.linalg.norm(p.velocity[liquid], axis=1).max() < 0.01 * np.sqrt(G * depth)
    assert np.abs(error).max() < 0.02 * depth
    assert sim.put_back == 0


def test_a_nearly_full_tank_closes(start):
    """Where the last surface particle goes, the pressure is known up to a constant: from that step on."""
    sim = start(
        parse_job(
            "dimension: 2\nspacing: 0.02\ntank: {shape: cylinder, size: [0.5, 0.5]}\ntime: {end: 1, cfl: 0.4}\n"
            "fluids: [{name: water, fill: 0.99}]\n"
            "motion: [{kind: pitch, amplitude_deg: 25, omega: 7.0, centre: [0.25, 0.25]}]"
        )
    )
    closed = []
    while sim.time < 0.3:
        sim.step(0.3)
        closed.append(sim.floating.count)
    assert (closed[0], max(closed)) == (0, 1)
    assert abs(sim.energy_drift()) < 0.02
    assert abs(sim.volume_drift()) < 0.02


def test_free_wave_between_walls_of_45_degrees(start):
    """The potential x z is the exact first mode: its surface stays plane, and omega^2 = g / h (Kirchhoff)."""
    depth, amplitude = 0.4, 0.008
    sim = start(job_of(VEE, spacing=0.025))
    p = sim.particles
    omega = np.sqrt(G / depth)
    period = 2 * np.pi / omega
    liquid = slice(0, p.liquid)
    p.velocity[liquid, 0] = amplitude * omega / depth * p.position[liquid, 2]
    p.velocity[liquid, 2] = amplitude * omega / depth * (p.position[liquid, 0] - 0.8)
    first = p.position[liquid, 0].mean()
    times, mode = [0.0], [0.0]
    while times[-1] < 1.1 * period:
        sim.step(10.0)
        times.append(sim.time)
        mode.append(sim.particles.position[: sim.particles.liquid, 0].mean() - first)
    times, mode = np.array(times), np.array(mode)
    at = np.flatnonzero(mode[1:-1] * mode[2:] < 0.0) + 1
    crossing = times[at] - mode[at] * (times[at + 1] - times[at]) / (mode[at + 1] - mode[at])
    assert crossing[1] == pytest.approx(period, rel=0.015)
    # a tilt of the surface by a / h moves the centre of the wedge by 2 a / 3
    assert np.ptp(mode) / 2 == pytest.approx(2 * amplitude / 3, rel=0.06)


@pytest.mark.parametrize(
    ("tank", "spacing", "displaced", "tolerance"),
    [
        # by the segment of the circle that the plate's foot stands in, in 2D and along a cylinder
        ("{shape: cylinder, size: [0.62, 0.62], baffles: [{x: 0.31, bottom: 0, top: 0.18, thickness: 0.02}]}", 0.0115,
         0.02 * 0.18, 3e-3),
        ("{shape: cylinder, size: [1.5, 1, 1], baffles: [{x: 0.7, bottom: 0, top: 0.3, thickness: 0.06}]}", 0.05,
         0.06 * (0.25 * np.arccos(0.4) - 0.2 * np.sqrt(0.21)), 1e-2),
    ],
)
def test_faces_where_a_baffle_stands_on_a_curved_floor(tank, spacing, displaced, tolerance):
    """Pressure that grows with the depth pushes walls and baffle by the liquid's weight, and nowhere sideways."""
    dimension = 2 if "0.62" in tank else 3
    job = parse_job(f"dimension: {dimension}\nspacing: {spacing}\ntank: {tank}\nfluids: [{{name: w, fill: 0.7}}]\n"
                    "time: {end: 1}\n", ())  # fmt: skip
    p = place(job, "half")
    wall = p.kind == WALL
    owner, area = faces(p.geometry, p.position[wall], p.normal[wall], p.depth[wall])
    surface = p.position[wall] + p.depth[wall, None] * p.normal[wall]
    force = (area * (job.tank.height - surface[:, 2])[:, None]).sum(axis=0)
    length = 1.5 if dimension == 3 else 1.0
    volume = np.pi * (job.tank.height / 2.0) ** 2 * length - displaced
    assert force[2] == pytest.approx(-volume, rel=tolerance)
    assert np.abs(force[:2]).max() < tolerance * volume
    assert set(owner) == {0, 1}
