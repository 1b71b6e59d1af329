"""Particles at the start: counts, shares, volumes, walls; distance to walls; initial velocities."""

import h5py
import numpy as np
import pytest
from scipy.spatial import cKDTree

from parmps.errors import InputError
from parmps.faces import faces
from parmps.kernels.walls import crosses_solid, wall_distance
from parmps.lattice import distance_to_box
from parmps.loader import parse_job
from parmps.output import ParticleFile
from parmps.tank import DUMMY, FLUID, WALL, initial_velocity, place

POST = "{x: 0.4, bottom: 0.0, top: 0.15, thickness: 0.006}"
SHELF = "{z: 0.1, left: 0.3, right: 0.5, thickness: 0.002}"
SILL = "{x: 0.4, bottom: 0.0, top: 0.15, thickness: 0.06}"
FIN = "{x: 0.3, bottom: 0.05, top: 0.15, thickness: 0.006, width: [0.1, 0.31]}"


def make_job(size=(0.8, 0.5), depth=0.25, spacing=0.004, lid="true", baffles="", fluids=None, more=""):
    fluids = fluids or f"[{{name: water, depth: {depth}}}]"
    return parse_job(
        f"dimension: {len(size)}\nspacing: {spacing}\nfluids: {fluids}\ntime: {{end: 1.0}}\n"
        f"tank: {{size: {list(size)}, lid: {lid}, baffles: [{baffles}]}}\n{more}\n"
    )


@pytest.mark.parametrize(
    ("size", "depth", "spacing", "fluid"),
    [
        ((0.8, 0.5), 0.25, 0.004, 12338),
        ((0.57, 0.5), 0.18, 0.002, 25560),
        ((0.57, 0.31, 0.5), 0.2, 0.005, 113 * 61 * 40),
    ],
)
def test_counts_of_the_papers(size, depth, spacing, fluid):
    placement = place(make_job(size, depth, spacing), "line")
    assert placement.total_fluid == np.sum(placement.kind == FLUID) == fluid
    if fluid == 12338:
        assert placement.total - fluid == 1974


def test_rows_of_three_layers():
    fluids = "[{name: a, depth: 0.15}, {name: b, depth: 0.15}, {name: c, depth: 0.38}]"
    placement = place(make_job((1.08, 0.9), spacing=0.005, fluids=fluids), "line")
    rows = np.bincount(placement.fluid[placement.kind == FLUID]) / 215
    np.testing.assert_array_equal(rows, [30, 30, 76])


def test_half_walls_fit_the_tank_exactly():
    placement = place(make_job((0.83, 0.5), 0.2435, 0.01), "half")
    liquid = placement.position[placement.kind == FLUID]
    h = 0.83 / 83, 0.2435 / 24
    assert placement.spacing == pytest.approx(np.sqrt(h[0] * h[1]))
    np.testing.assert_allclose(liquid.min(axis=0), [h[0] / 2, 0, h[1] / 2])
    np.testing.assert_allclose(liquid.max(axis=0), [0.83 - h[0] / 2, 0, 0.2435 - h[1] / 2])
    np.testing.assert_allclose(placement.volume.sum(), 0.83 * 0.2435, rtol=1e-12)


def test_lid_is_at_the_tank_height_above_a_nearly_full_tank():
    placement = place(make_job((0.4, 0.3), 0.297, 0.01), "half")
    lid = placement.position[(placement.kind == WALL) & (placement.normal[:, 2] == -1)]
    np.testing.assert_allclose(lid[:, 2], 0.3 + 0.0099 / 2)


@pytest.mark.parametrize("wall", ["half", "line"])
@pytest.mark.parametrize(
    ("size", "baffles"),
    [((0.8, 0.5), b) for b in ("", POST, SHELF, SILL)] + [((0.6, 0.31, 0.5), b) for b in ("", FIN, POST)],
)
@pytest.mark.parametrize("lid", ["true", "false"])
def test_walls(wall, size, baffles, lid):
    spacing = 0.004 if len(size) == 2 else 0.02
    job = make_job(size, 0.2, spacing, lid, baffles)
    p = place(job, wall)
    box = p.geometry.walls.container
    solids = p.geometry.walls.solids
    liquid, walls, dummy = (p.kind == kind for kind in (FLUID, WALL, DUMMY))
    np.testing.assert_array_equal(p.id, np.arange(p.total))
    np.testing.assert_allclose(np.linalg.norm(p.normal[~liquid], axis=1), 1)
    assert not p.normal[liquid].any() and not p.depth[liquid].any()
    # the surface point lies on the tank or on a baffle
    surface = p.position + p.depth[:, None] * p.normal
    gap = np.abs(distance_to_box(surface, box))
    for solid in solids:
        gap = np.minimum(gap, np.abs(distance_to_box(surface, solid)))
    assert gap[~liquid].max() < 1e-9
    # from there, the normal leads into the liquid region
    into = surface + 0.1 * p.spacing * p.normal
    distances = np.array([wall_distance(*x, p.geometry.walls)[0] for x in into[walls]])
    np.testing.assert_array_less(0, distances)
    # dummies lie behind their wall particle
    parent = p.parent[dummy]
    assert (p.kind[parent] == WALL).all() and (p.parent[~dummy] == -1).all()
    assert np.linalg.norm(p.position[dummy] - p.position[parent], axis=1).max() < 3.7 * p.spacing
    assert (np.sum(p.normal[dummy] * p.normal[parent], axis=1) > 0.5).all()
    # liquid keeps off everything; walls off walls, except across a thin baffle
    tree = cKDTree(p.position)
    pairs = tree.query_pairs(0.6 * p.spacing, output_type="ndarray")
    assert not liquid[pairs].all(axis=1).any()
    if not baffles:
        assert len(pairs) == 0
    assert len(tree.query_pairs(0.01 * p.spacing)) == 0
    for solid in solids:
        assert distance_to_box(p.position[liquid], solid).min() > 0.24 * p.spacing
    if lid == "false":
        assert p.position[:, 2].max() <= size[-1]
    whole = 0.2 * np.prod(size[:-1])
    assert 0.8 * whole < p.volume.sum() <= whole * (1 + 1e-12)
    if wall == "half":  # as many particles as the volume asks for, wherever the baffles are
        assert p.volume.sum() == pytest.approx(p.total_fluid * p.spacing ** len(size), rel=5e-3)


def test_every_lattice_neighbour_of_liquid_exists():
    """Within three rows, the liquid and the walls of a tank make one gapless lattice."""
    for size in ((0.2, 0.1), (0.2, 0.1, 0.1)):
        p = place(make_job(size, size[-1], 0.01), "half")
        count = {2: 12, 3: 32}[len(size)]
        neighbours = cKDTree(p.position).query_ball_point(p.position[p.kind == FLUID], 2.1 * p.spacing)
        assert {len(found) - 1 for found in neighbours} == {count}


def test_baffles_that_overlap_take_their_volume_once():
    both = (
        "{x: 0.4, bottom: 0.0, top: 0.1, thickness: 0.02}, {z: 0.05, left: 0.3, right: 0.5, thickness: 0.01}"
    )
    p = place(make_job(baffles=both), "half")
    assert p.volume.sum() == pytest.approx(0.8 * 0.25 - 0.02 * 0.1 - 0.18 * 0.01, rel=1e-12)


def test_regions():
    fluids = (
        "[{name: a, region: {box: [[0.0, 0.0], [0.25, 0.3]]}}, "
        "{name: b, region: {disc: {centre: [0.5, 0.3], radius: 0.1}}}]"
    )
    p = place(make_job(fluids=fluids), "half")
    liquid = p.kind == FLUID
    a, b = (p.position[liquid & (p.fluid == k)] for k in (0, 1))
    assert a.max(axis=0)[0] < 0.25 and a.max(axis=0)[2] < 0.3
    assert np.hypot(b[:, 0] - 0.5, b[:, 2] - 0.3).max() < 0.1
    assert p.volume[: len(a)].sum() == pytest.approx(0.25 * 0.3)
    assert p.volume[len(a) :].sum() == pytest.approx(np.pi * 0.01)
    with pytest.raises(InputError, match=r"fluids\[1\]: overlaps 'a': both have a particle at \["):
        place(make_job(fluids=fluids.replace("0.5, 0.3]", "0.3, 0.2]")), "half")


DROP = (
    "[{name: drop, region: {disc: {centre: [%g, 0.25], radius: 0.123}}}, {name: bath, depth: 0.5, density: 900}]\n"
    "interfaces: [{between: [drop, bath], surface_tension: %g}]"
)


def test_particles_stand_evenly_along_a_drop_with_surface_tension():
    unevenness = {}
    for tension in (0.0, 0.05):
        p = place(make_job(spacing=0.01, fluids=DROP % (0.4, tension)), "half")
        at, drop = p.position[: p.total_fluid], p.fluid[: p.total_fluid] == 0
        gap = (np.hypot(at[:, 0] - 0.4, at[:, 2] - 0.25) - 0.123) / p.spacing
        unevenness[tension] = np.array([np.std(gap[drop & (gap > -0.9)]), np.std(gap[~drop & (gap < 0.9)])])
    assert np.count_nonzero(drop) == round(np.pi * 0.123**2 / p.spacing**2)
    assert gap[drop].max() == pytest.approx(-0.4, abs=0.01) and gap[~drop].min() == pytest.approx(0.4, abs=0.01)
    assert np.all(unevenness[0.05] < 0.5 * unevenness[0.0])  # those on the lattice are two rows and more
    assert cKDTree(at).query(at, 2)[0].max() < 1.2 * p.spacing
    assert cKDTree(at).query(at, 2)[0][:, 1].min() > 0.8 * p.spacing
    shares = [place(make_job(spacing=0.01, fluids=DROP % (0.4, 0.05)), "half", part, 3) for part in range(3)]
    np.testing.assert_array_equal(np.concatenate([share.position for share in shares]), p.position)


@pytest.mark.parametrize("fluids", [DROP % (0.4, 0.0), DROP % (0.15, 0.05)], ids=["no tension", "beside a wall"])
def test_other_drops_keep_the_lattice(fluids):
    p = place(make_job(spacing=0.01, fluids=fluids), "half")
    plain = place(make_job(spacing=0.01, fluids="[{name: bath, depth: 0.5}]"), "half")
    np.testing.assert_array_equal(p.position, plain.position)


@pytest.mark.parametrize("baffles", ["", FIN])
def test_shares_do_not_depend_on_their_number(baffles):
    job = make_job((0.6, 0.31, 0.5), 0.2, 0.02, baffles=baffles)
    whole = place(job, "half")
    shares = [place(job, "half", part, 7) for part in range(7)]
    sizes = [len(share.id) for share in shares]
    assert max(sizes) - min(sizes) <= 1
    for name in ("position", "kind", "fluid", "normal", "depth", "volume", "parent", "id"):
        together = np.concatenate([getattr(share, name) for share in shares])
        np.testing.assert_array_equal(together, getattr(whole, name))


@pytest.mark.parametrize("wall", ["half", "line"])
def test_face_areas_tile_the_walls(wall):
    for size, baffles in (((0.8, 0.5), POST), ((0.8, 0.5), SHELF), ((0.6, 0.31, 0.5), FIN)):
        p = place(make_job(size, 0.2, 0.01, baffles=baffles), wall)
        walls = p.kind == WALL
        owner, area = faces(p.geometry, p.position[walls], p.normal[walls], p.depth[walls])
        solid = p.geometry.solids[0]
        extent = np.minimum(solid.high - solid.low, 1.0)
        wanted = np.array([np.prod(np.delete(extent, a)) for a in range(3)])
        wanted *= solid.free_low.astype(float) + solid.free_high
        np.testing.assert_allclose(np.abs(area[owner == 1]).sum(axis=0), wanted, rtol=1e-9)
        # a column of the bottom or the side may give way to a baffle that stands on it
        tank = np.array([*size[:1], size[1] if len(size) == 3 else 1.0, size[-1]])
        both = 2 * np.array([np.prod(np.delete(tank, a)) for a in range(3)])
        if len(size) == 2:
            both[1] = 0
        np.testing.assert_allclose(np.abs(area[owner == 0]).sum(axis=0), both, rtol=0.03)


def test_a_spacing_that_does_not_fit_is_refused():
    with pytest.raises(InputError, match=r"spacing: got 0.3 m.*0.8 m within 10 %; 0.\d+ m does") as error:
        place(make_job((0.8, 0.9), 0.6, 0.3), "half")
    fitting = float(str(error.value).split("; ")[1].split()[0])
    place(make_job((0.8, 0.9), 0.6, fitting), "half")


def test_wall_distance_against_brute_force():
    rng = np.random.default_rng(3)
    p = place(make_job((0.6, 0.31, 0.5), 0.2, 0.02, baffles=FIN), "half")
    box, solids = p.geometry.walls.container, p.geometry.walls.solids
    # dense points on all surfaces
    grid = np.linspace(0, 1, 151)
    u, v = (g.ravel() for g in np.meshgrid(grid, grid))
    samples = []
    for low, high in (box, np.clip(solids[0], *box)):
        for axis in range(3):
            for side in (0.0, 1.0):
                unit = np.insert(np.stack([u, v], axis=1), axis, side, axis=1)
                samples.append(low + unit * (high - low))
    tree = cKDTree(np.concatenate(samples))
    for x in rng.uniform(*box, size=(300, 3)):
        distance, *normal = wall_distance(*x, p.geometry.walls)
        if distance > 0:
            assert distance == pytest.approx(tree.query(x)[0], abs=1e-4 + 0.003**2 / max(distance, 1e-3))
        foot = x - distance * np.array(normal)
        assert wall_distance(*foot, p.geometry.walls)[0] == pytest.approx(0, abs=1e-12)
        assert np.linalg.norm(normal) == pytest.approx(1)
    assert wall_distance(0.3, 0.15, -0.1, p.geometry.walls)[0] == pytest.approx(-0.1)
    assert wall_distance(0.1, 0.1, 0.49, p.geometry.walls._replace(open_top=True))[0] == pytest.approx(0.1)


def test_wall_distance_in_2d_ignores_y():
    geometry = place(make_job(baffles=POST), "half").geometry
    for x in ((0.1, 0.01), (0.4, 0.1), (0.39, 0.16), (-0.1, 0.2)):
        near, far = (wall_distance(x[0], y, x[1], geometry.walls) for y in (0.0, 9.0))
        assert near == far and near[2] == 0


def test_segments_across_a_baffle():
    boxes = place(make_job(baffles=POST), "half").geometry.walls.solids
    across = (0.39, 0.0, 0.1, 0.41, 0.0, 0.1)
    assert crosses_solid(*across, boxes)
    assert crosses_solid(0.397, 0.0, 0.1, 0.41, 0.0, 0.1, boxes)  # from its surface
    assert crosses_solid(0.39, 0.0, -0.01, 0.41, 0.0, 0.01, boxes)  # through the wall below
    assert not crosses_solid(0.39, 0.0, 0.16, 0.41, 0.0, 0.16, boxes)  # above the tip
    assert not crosses_solid(0.39, 0.0, 0.1, 0.397, 0.0, 0.1, boxes)  # up to its surface
    assert not crosses_solid(0.397, 0.0, 0.1, 0.397, 0.0, 0.12, boxes)  # along its surface
    assert not crosses_solid(0.4, 0.0, 0.1, 0.41, 0.0, 0.1, boxes)  # from inside
    assert not crosses_solid(*across, boxes[:0])


def test_standing_wave_is_the_gradient_of_linear_theory():
    job = make_job(more="initial: {kind: standing_wave, mode: 2, amplitude: 0.05}")
    p = place(job, "half")
    velocity = initial_velocity(job, p)
    k, h = 2 * np.pi / 0.8, 0.25
    omega = np.sqrt(9.8 * k * np.tanh(k * h))
    x, z = p.position[p.kind == FLUID][:, [0, 2]].T
    scale = 0.05 * omega / np.sinh(k * h)
    u, v, w = velocity[p.kind == FLUID].T
    np.testing.assert_allclose(u, -scale * np.cosh(k * z) * np.sin(k * x), atol=1e-12)
    np.testing.assert_allclose(w, scale * np.sinh(k * z) * np.cos(k * x), atol=1e-12)
    assert not velocity[p.kind != FLUID].any() and not v.any()


def test_uniform_velocity():
    job = make_job(more="initial: {kind: velocity, fluid: water, value: [1.0, -2.0]}")
    p = place(job, "half")
    assert (initial_velocity(job, p)[p.kind == FLUID] == [1, 0, -2]).all()
    assert not initial_velocity(make_job(), p).any()


def test_state_from_a_file(tmp_path):
    rng = np.random.default_rng(0)
    source = place(make_job(), "half")
    position = source.position[source.kind == FLUID]
    velocity = rng.normal(size=position.shape) * [1, 0, 1]
    path = tmp_path / "state.h5"

    def write(position):
        with h5py.File(path, "w") as file:
            file["position"] = position[:, [0, 2]]
            file["velocity"] = velocity[:, [0, 2]]
        return make_job(more=f"initial: {{kind: file, path: '{path}'}}")

    job = write(position)
    for part in range(3):
        p = place(job, "half", part, 3)
        mine = p.id[p.kind == FLUID]
        np.testing.assert_array_equal(p.position[p.kind == FLUID], position[mine])
        np.testing.assert_array_equal(initial_velocity(job, p)[p.kind == FLUID], velocity[mine])
    twice = position.copy()
    twice[5] = twice[9] + [1e-5, 0, 0]
    with pytest.raises(InputError, match=r"initial.path: .*particles at \[.*\] m and \[.*\] m coincide"):
        place(write(twice), "half")
    with pytest.raises(InputError, match="outside the tank"):
        place(write(position + [0.1, 0, 0]), "half")
    path.write_bytes(b"no HDF5")
    with pytest.raises(InputError, match="not a state file"):
        place(job, "half")


def test_state_from_a_result(tmp_path):
    source = place(make_job(spacing=0.02), "half")
    n = source.total
    arrays = {
        "position": source.position,
        "id": source.id,
        "type": source.kind,
        "fluid": source.fluid,
        "velocity": np.outer(source.id, [1.0, 0.0, 2.0]),
        "pressure": np.zeros(n),
        "surface": np.zeros(n, np.int8),
    }
    ParticleFile.create(tmp_path / "particles.vtkhdf", n, 3, {})
    file = ParticleFile(tmp_path / "particles.vtkhdf")
    for frame in range(2):
        file.write(frame, 0, arrays | {"velocity": arrays["velocity"] * (frame + 1)})
        file.commit(frame, float(frame))
    file.close()
    job = make_job(spacing=0.02, more=f"initial: {{kind: file, path: '{tmp_path / 'particles.vtkhdf'}'}}")
    p = place(job, "half")
    np.testing.assert_array_equal(p.position, source.position)
    liquid = p.kind == FLUID
    np.testing.assert_array_equal(initial_velocity(job, p)[liquid], 2 * arrays["velocity"][liquid])
