"""Lattice constants and every operator against dense sums over all pairs, on regular and random particles."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from parmps.kernels import density, gradient, poisson, shifting, velocity, viscosity
from parmps.kernels.graph import join, number_parts
from parmps.kernels.lanes import LANES, append_near, append_nearest
from parmps.kernels.walls import Walls
from parmps.kernels.weight import lattice, smooth_weight, weight
from parmps.liquids import harmonic
from parmps.loader import parse_job
from parmps.neighbors import Pairs, sorted_cells
from parmps.particles import DUMMY, FLUID, OUT, WALL, Particles
from parmps.tank import place

REACH = 2.1
POST = "{x: 0.08, bottom: 0.0, top: 0.07, thickness: 0.006}"


@pytest.mark.parametrize(
    ("dimension", "reach", "n0", "lam", "neighbours", "asymmetry"),
    [
        (2, 2.1, 4.91598, 1.41561, 12, 0.5648),
        (2, 3.1, 13.51322, 2.60649, 28, 0.5890),
        (2, 4.01, 24.67168, 4.08288, 48, 0.6010),
        (3, 2.1, 11.07935, 1.73741, 32, 0.6324),
        (3, 4.01, 91.28493, 5.58572, 256, 0.7021),
    ],
)
def test_lattice_constants(dimension, reach, n0, lam, neighbours, asymmetry):
    sums = lattice(dimension, reach)
    assert sums.density == pytest.approx(n0, abs=1e-5)
    assert sums.lam == pytest.approx(lam, abs=1e-5)
    assert sums.neighbours == neighbours
    assert sums.asymmetry == pytest.approx(asymmetry, abs=6e-5)  # given to four digits


def kernel(r, reach=REACH):
    """W of the papers, written down once more."""
    with np.errstate(divide="ignore"):
        return np.where(r < reach, reach / (0.85 * r + 0.15 * reach) - 1.0, 0.0)


def make_case(dimension, noise, baffles="", wall_pairs=False, full=False, seed=1):
    """A small tank whose liquid is moved off the lattice, and its neighbours by brute force."""
    size = (0.16, 0.12) if dimension == 2 else (0.07, 0.06, 0.06)
    depth = size[-1] if full else 0.08 if dimension == 2 else 0.04
    job = parse_job(
        f"dimension: {dimension}\nspacing: 0.01\nfluids: [{{name: water, depth: {depth}}}]\n"
        "time: {end: 1.0}\n"
        f"tank: {{size: {list(size)}, baffles: [{baffles}]}}\n"
    )
    placed = place(job, "half")
    names = ("id", "kind", "fluid", "parent", "position", "normal", "depth")
    order = np.argsort(placed.kind, kind="stable")
    p = Particles({name: np.asarray(getattr(placed, name))[order] for name in names})
    l0 = placed.spacing
    rng = np.random.default_rng(seed)
    shake = rng.uniform(-noise, noise, (p.liquid, 3)) * l0
    if dimension == 2:
        shake[:, 1] = 0.0
    p.position[: p.liquid] += shake
    solids = placed.geometry.walls.solids
    pairs = Pairs(REACH * l0, placed.geometry.obstacles, wall_pairs=wall_pairs)
    pairs.find(p)
    d = (p.position[None, :, :] - p.position[: p.rows, None, :]) / l0
    r = np.linalg.norm(d, axis=2)
    r[np.arange(p.rows), np.arange(p.rows)] = np.inf
    first, other = pairs.lists
    listed = np.zeros(r.shape, bool)
    pairs_of = np.repeat(np.arange(p.rows), np.diff(first)), other[: first[-1]]
    listed[pairs_of] = True
    strength, _ = pairs.weigh(l0, REACH, REACH)
    w = np.zeros(r.shape)  # the weights that the operators get, in single precision, in all digits
    w[pairs_of] = strength[: first[-1]]
    w[listed] *= (r[listed] * l0) ** 2
    vector = rng.normal(size=(len(p), 3))
    if dimension == 2:
        vector[:, 1] = 0.0
    return SimpleNamespace(
        p=p, l0=l0, d=d, r=r, solids=solids, lists=pairs.lists, wet=(*pairs.wet, strength), listed=listed,
        dimension=dimension, rng=rng,
        lat=lattice(dimension, REACH), rows=p.rows, w=w, vector=vector,
        scalar=rng.normal(size=len(p)),
        surface=(rng.random(len(p)) < 0.2).astype(np.int8) * (p.kind == FLUID),
    )  # fmt: skip


CASES = [(2, 0.0), (2, 0.25), (3, 0.0), (3, 0.25)]
on_all = pytest.mark.parametrize(("dimension", "noise"), CASES)


def moments_of(c, wet=None):
    out = SimpleNamespace(
        density=np.zeros(c.rows), asymmetry=np.zeros((len(c.p), 3)), lean=np.zeros((c.rows, 3)),
        matrix=np.zeros((c.rows, 6)),
    )  # fmt: skip
    density.moments(
        c.p.position, np.ones(len(c.p)) if wet is None else wet, *c.wet, c.l0, c.lat.density, c.dimension,
        out.density, out.asymmetry, out.lean, out.matrix,
    )  # fmt: skip
    return out


def full_matrix(six):
    """Symmetric matrices of their six entries."""
    return six[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)


def six_of(matrix):
    return np.ascontiguousarray(matrix.reshape(-1, 9)[:, [0, 1, 2, 4, 5, 8]])


# Neighbours


@pytest.mark.parametrize("wall_pairs", [False, True])
@on_all
def test_neighbours_without_baffles(dimension, noise, wall_pairs):
    c = make_case(dimension, noise, wall_pairs=wall_pairs)
    kind, normal = c.p.kind, c.p.normal
    mine = kind[: c.rows, None]
    seen_wall = np.einsum("ijk,jk->ij", c.d, normal) < 0.0
    from_wall = np.einsum("ijk,ik->ij", c.d, normal[: c.rows]) > 0.0
    sees = np.where(
        mine == FLUID, (kind == FLUID) | seen_wall, np.where(kind == FLUID, from_wall, wall_pairs)
    )
    np.testing.assert_array_equal(c.listed, (c.r < REACH) & sees)
    first, last, other, strength = c.wet
    for i in range(c.rows):
        assert len(set(other[first[i] : first[i + 1]])) == first[i + 1] - first[i]
        assert not np.any(kind[other[first[i] : last[i]]] == DUMMY)
        assert np.all(kind[other[last[i] : first[i + 1]]] == DUMMY)
        r = c.r[i, other[first[i] : first[i + 1]]]
        np.testing.assert_allclose(strength[first[i] : first[i + 1]], kernel(r) / (r * c.l0) ** 2, 1e-6, 1e-6 / c.l0**2)


def test_candidates_taken_together_are_those_taken_one_by_one():
    candidates = np.random.default_rng(3).random((3, 40))
    order = np.arange(40, dtype=np.uint32)[::-1].copy()
    here, reach2 = candidates[:, 11], 0.3
    for begin, end in ((0, 32), (5, 8), (9, 30)):
        found = []
        for append, lanes in ((_append_near, LANES), (append_nearest.py_func, 1)):
            other, square, count = np.empty(64, np.uint32), np.empty(64, np.float32), np.uint64(0)
            for k in range(begin, end, lanes):
                where = np.uint64(k), np.uint64(end), *here, reach2
                count = np.uint64(append(*candidates, order, *where, other, square, count))
            found.append((other[:count], square[:count]))
        assert len(found[0][0]) > 0
        assert np.array_equal(found[0][0], found[1][0])
        assert found[0][1] == pytest.approx(found[1][1], rel=1e-7)


@njit
def _append_near(xs, ys, zs, order, k, end, x, y, z, reach2, other, square, count):
    return append_near(xs, ys, zs, order, k, end, x, y, z, reach2, other, square, count)


@pytest.mark.parametrize("dimension", [2, 3])
def test_neighbours_of_a_cloud_are_those_of_a_tree(dimension):
    rng = np.random.default_rng(5)
    position = rng.random((2000, 3)) * [3.0, 0.0 if dimension == 2 else 1.0, 1.0]
    position[0] *= 50.0  # spray far away
    kind = np.zeros(2000, np.int8)
    kind[17] = OUT
    p = Particles({"id": np.arange(2000), "kind": kind, "position": position})
    pairs = Pairs(0.1, np.empty((0, 2, 3)))
    pairs.find(p)
    first, other = pairs.lists
    tree = cKDTree(position)
    for i, expected in enumerate(tree.query_ball_point(position, 0.1)):
        expected = [] if i == 17 else sorted(set(expected) - {i, 17})
        assert sorted(other[first[i] : first[i + 1]]) == expected


def test_a_particle_that_left_is_nobody_s_neighbour_next_to_a_wall():
    c = make_case(2, 0.1)
    gone = int(np.argmin(c.p.position[: c.p.liquid, 0]))
    c.p.kind[gone] = OUT
    pairs = Pairs(REACH * c.l0, c.solids)
    pairs.find(c.p)
    first, other = pairs.lists
    assert first[gone] == first[gone + 1]
    assert gone not in other[: first[-1]]


def test_liquid_sees_the_edge_of_a_baffle_from_around_it():
    """Walls of an edge are neighbours of all liquid around it, and of none behind the baffle."""
    c = make_case(2, 0.0, POST)
    low, high = c.solids[0][:, [0, 2]]
    edge = np.flatnonzero((c.p.kind == WALL) & (np.abs(c.p.normal[:, [0, 2]]) > 0.1).all(axis=1))
    tip = [i for i in edge if abs(c.p.position[i, 2] - high[1]) < c.l0]
    assert len(tip) == 2
    liquid = slice(0, c.p.liquid)
    for i in tip:
        x, z = c.p.position[liquid, 0], c.p.position[liquid, 2]
        same_side = (x - (low[0] + high[0]) / 2) * c.p.normal[i, 0] > 0.0
        around = c.r[i, liquid] < REACH
        clear = same_side | (z > high[1]) | (z < high[1] - 0.5 * c.l0)  # others look along the top, through its rim
        assert np.array_equal(c.listed[i, liquid][clear], (around & (same_side | (z > high[1])))[clear])
        assert np.array_equal(c.listed[i, liquid], c.listed[liquid, i])


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_no_neighbours_through_a_baffle(noise):
    c = make_case(2, noise, POST)
    fluid, reach = slice(0, c.p.liquid), 4.01  # the walls of the baffle keep the two sides 3 spacings apart
    pairs = Pairs(reach * c.l0, c.solids)
    pairs.find(c.p)
    first, other = pairs.lists
    listed = np.zeros(c.r.shape, bool)
    listed[np.repeat(np.arange(c.rows), np.diff(first)), other[: first[-1]]] = True
    a, b = np.nonzero(np.triu(c.r[fluid, fluid] < reach))
    share = np.linspace(0.0, 1.0, 301)[:, None, None]
    points = (1.0 - share) * c.p.position[a] + share * c.p.position[b]
    low, high = c.solids[0][:, [0, 2]]

    def inside(margin):
        at = points[:, :, [0, 2]]
        return np.any(np.all((at > low - margin) & (at < high + margin), axis=2), axis=0)

    seen = listed[a, b]
    assert np.array_equal(seen, listed[b, a])
    assert not np.any(seen & inside(-1e-3 * c.l0))
    assert np.all(seen | inside(2e-2 * c.l0))
    assert np.any(~seen)


# Density and moments


@on_all
def test_moments(dimension, noise):
    c = make_case(dimension, noise)
    wet = np.where(c.p.kind == 1, c.rng.random(len(c.p)), 1.0)
    got = moments_of(c, wet)
    scale = c.dimension / c.lat.density
    np.testing.assert_allclose(got.density, c.w @ wet, rtol=1e-12)
    np.testing.assert_allclose(
        got.asymmetry[: c.rows], -scale * np.einsum("ij,ijk->ik", c.w * wet / c.r, c.d), atol=1e-12
    )
    w = np.where(c.p.kind == 2, 0.0, c.w)
    np.testing.assert_allclose(got.lean, -np.einsum("ij,ijk->ik", w * wet / c.r**2, c.d), atol=1e-12)
    reference = scale * np.einsum("ij,ijk,ijl->ikl", w / c.r**2, c.d, c.d)
    np.testing.assert_allclose(full_matrix(got.matrix), reference, atol=1e-12)
    if noise == 0.0:
        # dummies have no part in the moments: two rows from the walls they are those of the lattice
        away = np.flatnonzero(
            (c.w.sum(axis=1) > c.lat.density - 1e-5) & ~(c.listed & (c.p.kind == 2)).any(axis=1)
        )
        assert len(away)
        np.testing.assert_allclose(got.matrix[away][:, [0, 5]], 1.0, rtol=1e-6)


@on_all
@pytest.mark.parametrize("floor", [0.4, 0.6])
def test_invert_with_eigenvalue_floor(dimension, noise, floor):
    c = make_case(dimension, noise)
    matrix = moments_of(c).matrix
    random = c.rng.normal(size=(300, 3, 3))
    if dimension == 2:
        random[:, 1] = 0.0
    random = random @ random.transpose(0, 2, 1)
    matrix = np.concatenate([matrix, six_of(random), np.zeros((1, 6))])
    inverse = np.zeros_like(matrix)
    density.invert(matrix, floor, dimension, inverse)
    dense = full_matrix(matrix).copy()
    if dimension == 2:
        dense[:, 1, 1] = 1.0
    values, vectors = np.linalg.eigh(dense)
    reference = np.einsum("nij,nj,nkj->nik", vectors, 1.0 / np.maximum(values, floor), vectors)
    assert np.any(values < floor) and np.any(values[:, 0] > floor)
    np.testing.assert_allclose(full_matrix(inverse), reference, atol=1e-9)
    density.invert(matrix, floor, dimension, matrix)
    np.testing.assert_array_equal(matrix, inverse)


@on_all
def test_missing_moment(dimension, noise):
    c = make_case(dimension, noise)
    m = moments_of(c)
    out = np.zeros_like(m.matrix)
    gradient.add_missing_moment(m.matrix, c.surface, m.lean, c.lat.density, dimension, out)
    size = np.linalg.norm(m.lean, axis=1)
    factor = np.where(c.surface[: c.rows] != 0, dimension / (c.lat.density * np.maximum(size, 1e-300)), 0.0)
    extra = factor[:, None, None] * m.lean[:, :, None] * m.lean[:, None, :]
    np.testing.assert_allclose(full_matrix(out), full_matrix(m.matrix) + extra, atol=1e-12)


@on_all
def test_smooth_density(dimension, noise):
    c = make_case(dimension, noise, POST if dimension == 2 else "")
    reach, liquid = 2.6, c.p.liquid
    skip = (c.rng.random(len(c.p)) < 0.2).astype(np.int8)
    c.p.kind[3] = OUT
    out = np.full(liquid, 7.0)
    density.smooth_density(skip, c.p.normal, reach * c.l0, *sorted_cells(c.p, reach * c.l0), out)
    front = -np.einsum("ijk,jk->ij", c.d[:liquid], c.p.normal)
    counts = (c.p.kind == FLUID) | ((c.p.kind != OUT) & (front > 1e-9))
    clear = ~np.any((c.p.kind != FLUID) & (c.r[:liquid] < reach) & (np.abs(front) < 1e-6), axis=1)  # of rounding
    q = np.minimum(c.r[:liquid] / reach, 1.0)
    bell = np.where(counts, (1.0 - q) ** 4 * (1.0 + 4.0 * q), 0.0)
    left_out = (skip[:liquid] != 0) | (c.p.kind[:liquid] == OUT)
    known = ~left_out & clear
    assert np.all(out[left_out] == 7.0)
    assert np.count_nonzero(known) > 0.3 * liquid
    np.testing.assert_allclose(out[known], 1.0 + bell.sum(axis=1)[known], rtol=1e-12)
    assert smooth_weight.py_func(2.0, 2.0) == 0.0
    assert weight.py_func(2.0, 2.0) == pytest.approx(0.0, abs=1e-15)


def test_surface_window():
    n0, threshold = 4.0, 0.5
    n = n0 * np.array([0.79, 0.81, 0.81, 0.96, 0.96, 0.98])
    f = np.zeros((6, 3))
    f[:, 2] = [0.0, 0.49, 0.51, 0.49, 0.51, 0.9]
    surface = np.zeros(6, np.int8)
    density.mark_surface(n, f, n0, threshold, surface)
    assert surface.tolist() == [1, 0, 1, 0, 1, 0]


def surface_at_rest(dimension):
    """The tank at rest, its moments and the particles found in the surface."""
    c = make_case(dimension, 0.0)
    wet = np.ones(len(c.p))
    density.wet_walls(c.p.position, c.p.normal, *c.wet, c.l0, c.p.liquid, c.rows, wet)
    m = moments_of(c, wet)
    surface = np.zeros(len(c.p), np.int8)
    density.mark_surface(m.density, m.asymmetry, c.lat.density, 0.9 * c.lat.asymmetry, surface)
    surface[c.p.liquid :] = 0
    normal = np.zeros((c.p.liquid, 3))
    density.surface_normals(c.p.position, m.asymmetry, surface, *c.wet, c.p.liquid, m.lean, normal)
    return c, wet, surface, normal


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_surface_of_liquid_at_rest_is_its_top_row(dimension):
    c, _, surface, normal = surface_at_rest(dimension)
    z = c.p.position[: c.p.liquid, 2]
    top = z > z.max() - 0.5 * c.l0
    np.testing.assert_array_equal(surface[: c.p.liquid] != 0, top)
    plan = c.p.position[: c.p.liquid, : dimension - 1]
    inner = top & ((plan > c.l0) & (plan < plan.max(axis=0) - 0.5 * c.l0)).all(axis=1)
    np.testing.assert_allclose(normal[inner], np.tile([0.0, 0.0, 1.0], (inner.sum(), 1)), atol=5e-3)
    # dummies, of small weight, are not known to be dry
    assert normal[top, 2].min() > 0.99
    assert not normal[z < z.max() - 2.5 * c.l0].any()


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_is_missing_at_the_surface_is_along_its_normal(dimension):
    c = make_case(dimension, 0.0)
    rng = np.random.default_rng(3)
    surface = np.zeros(len(c.p), np.int8)
    surface[: c.p.liquid] = rng.random(c.p.liquid) < 0.5
    normal, lean, asymmetry = np.zeros((c.p.liquid, 3)), np.zeros((c.rows, 3)), np.zeros((len(c.p), 3))
    asymmetry[: c.p.liquid] = [0.6, 0.0, 0.8]
    lean[:] = rng.normal(size=lean.shape) + [0.6, 0.0, 0.8]
    before = lean.copy()
    density.surface_normals(c.p.position, asymmetry, surface, *c.wet, c.p.liquid, lean, normal)
    along = before @ [0.6, 0.0, 0.8]
    turned = along > 0.5 * np.linalg.norm(before, axis=1)  # others have no normal that describes them
    turned[: c.p.liquid] &= surface[: c.p.liquid] != 0
    turned[c.p.liquid :] = False
    assert 0 < turned.sum() < (surface != 0).sum()
    np.testing.assert_allclose(lean[turned], along[turned, None] * [0.6, 0.0, 0.8], atol=1e-12)
    np.testing.assert_array_equal(lean[~turned], before[~turned])


@pytest.mark.parametrize("dimension", [2, 3])
def test_walls_are_wet_below_the_surface_and_dry_above(dimension):
    c, wet, _, _ = surface_at_rest(dimension)
    level = c.p.position[: c.p.liquid, 2].max() + 0.5 * c.l0
    walls = np.flatnonzero(c.p.kind == 1)
    np.testing.assert_array_equal(wet[walls], c.p.position[walls, 2] < level)
    assert 0 < wet[walls].sum() < len(walls)
    np.testing.assert_array_equal(np.delete(wet, walls), 1.0)


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_no_neighbour_covers_is_the_top_row(dimension):
    c, wet, surface, _ = surface_at_rest(dimension)
    found = np.zeros_like(surface)
    position, asymmetry = c.p.position, moments_of(c, wet).asymmetry
    density.mark_uncovered(position, c.p.normal, wet, asymmetry, 0.7 * c.lat.asymmetry, *c.wet[:3], c.p.liquid, found)
    np.testing.assert_array_equal(found, surface)


def mean_row_density(c, surface, normal):
    pairs = Pairs(REACH * c.l0, c.solids)
    pairs.find(c.p)
    total, count = density.row_density(
        c.p.position, c.p.kind, surface, normal, *pairs.lists, c.l0, REACH, c.lat.row_density, c.p.liquid
    )
    return total / count


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_surface_row_of_the_lattice_has_density_one(dimension):
    c, _, surface, normal = surface_at_rest(dimension)
    assert mean_row_density(c, surface, normal) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("fewer", [1, 2, -2])
def test_density_of_a_surface_row_of_other_numbers(fewer):
    c, _, surface, normal = surface_at_rest(2)
    row = np.flatnonzero(surface)
    # from the row to the one below it, or back; the others close up
    moved = c.p.position[: c.p.liquid, 2].argsort()[: abs(fewer)] if fewer < 0 else row[:fewer]
    row = np.union1d(row, moved) if fewer < 0 else np.setdiff1d(row, moved)
    level = c.p.position[: c.p.liquid, 2].max()
    c.p.position[moved, 2] = level - 0.9 * c.l0
    surface[moved] = 0
    surface[row] = 1
    normal[row] = 0.0, 0.0, 1.0
    c.p.position[row, 0] = (np.arange(len(row)) + 0.5) * 16 * c.l0 / len(row)
    c.p.position[row, 2] = level
    # the walls continue it with the lattice's spacing, which the ends see
    assert mean_row_density(c, surface, normal) == pytest.approx(1.0 - fewer / 16, abs=0.025)


@on_all
def test_spread(dimension, noise):
    c = make_case(dimension, noise)
    out = np.zeros(len(c.p), np.int8)
    density.spread(c.surface, *c.lists, c.rows, out)
    expected = (c.surface[: c.rows] != 0) | (c.listed & (c.surface != 0)).any(axis=1)
    np.testing.assert_array_equal(out[: c.rows] != 0, expected)


# Gradients


@on_all
def test_corrected_gradient(dimension, noise):
    c = make_case(dimension, noise)
    m = moments_of(c)
    inverse = np.zeros_like(m.matrix)
    density.invert(m.matrix, 0.6, dimension, inverse)
    out, pressure = np.zeros((len(c.p), 3)), c.scalar
    gradient.corrected_gradient(
        c.p.position, c.scalar, c.surface, m.lean, *c.wet, inverse, 0.4 * c.l0, c.lat.density,
        dimension, c.rows, out, *[None] * 5, np.zeros(c.rows, np.int8), np.zeros((len(c.p), 3)), 1000.0,
    )  # fmt: skip
    w = np.where(c.p.kind == 2, 0.0, c.w) / c.r**2
    jump = pressure[None, :] - pressure[: c.rows, None]
    total = np.einsum("ij,ijk->ik", w * jump, c.d)
    total -= np.where(c.surface[: c.rows] != 0, pressure[: c.rows] / 0.4, 0.0)[:, None] * m.lean
    reference = dimension / (c.lat.density * c.l0) * np.einsum("nij,nj->ni", full_matrix(inverse), total)
    np.testing.assert_allclose(out[: c.rows], reference, atol=1e-9 * np.abs(reference).max())


def test_the_free_surface_bears_no_tension_but_that_of_its_curvature():
    surface, start = np.array([1, 1, 0, 1, 1], np.int8), np.array([-3.0, 2.0, -3.0, -3.0, -3.0])
    for above, expected in (
        (None, [0.0, 2.0, -3.0, 0.0, -3.0]),
        (np.array([-1.0, -1.0, -1.0, 4.0, 0.0]), [-1.0, 2.0, -3.0, 0.0, -3.0]),
    ):
        pressure = start.copy()
        poisson.release_surface(surface, above, 4, pressure)
        np.testing.assert_array_equal(pressure, expected)


@on_all
def test_gradients_are_exact_for_linear_fields(dimension, noise):
    c = make_case(dimension, noise)
    m = moments_of(c)
    inverse = np.zeros_like(m.matrix)
    density.invert(m.matrix, 1e-12, dimension, inverse)
    slope = np.array([300.0, 0.0 if dimension == 2 else -200.0, -9800.0])
    none = np.zeros(len(c.p), np.int8)
    out = np.zeros((len(c.p), 3))
    liquid = c.p.liquid
    gradient.corrected_gradient(
        c.p.position, c.p.position @ slope + 7.0, none, m.lean, *c.wet, inverse, 0.5 * c.l0,
        c.lat.density, dimension, liquid, out, *[None] * 5, np.zeros(c.rows, np.int8), np.zeros((len(c.p), 3)), 1000.0,
    )  # fmt: skip
    np.testing.assert_allclose(out[:liquid], np.tile(slope, (liquid, 1)), atol=1e-8 * 9800)
    tensor = c.rng.normal(size=(3, 3))
    if dimension == 2:
        tensor[1] = tensor[:, 1] = 0.0
    grad = np.zeros((len(c.p), 9))
    field = c.p.position @ tensor.T + [0.3, 0.0, -0.1]
    velocity.velocity_gradient(
        c.p.position, field, *c.wet, inverse, c.lat.density, dimension, liquid, grad
    )
    np.testing.assert_allclose(grad[:liquid], np.tile(tensor.ravel(), (liquid, 1)), atol=1e-9)


@on_all
def test_velocity_gradient(dimension, noise):
    c = make_case(dimension, noise)
    m = moments_of(c)
    inverse = np.zeros_like(m.matrix)
    density.invert(m.matrix, 0.4, dimension, inverse)
    out = np.zeros((len(c.p), 9))
    velocity.velocity_gradient(
        c.p.position,
        c.vector,
        *c.wet,
        inverse,
        c.lat.density,
        dimension,
        c.rows,
        out,
    )
    w = np.where(c.p.kind == 2, 0.0, c.w) / c.r**2
    jump = c.vector[None, :, :] - c.vector[: c.rows, None, :]
    reference = np.einsum("ij,ija,ijc,icb->iab", w, jump, c.d, full_matrix(inverse), optimize=True)
    reference *= dimension / (c.lat.density * c.l0)
    np.testing.assert_allclose(
        out[: c.rows].reshape(-1, 3, 3), reference, atol=1e-9 * np.abs(reference).max()
    )


@pytest.mark.parametrize(
    ("flow", "rate"),
    [
        ([[0.0, 0.0, -3.0], [0.0, 0.0, 0.0], [3.0, 0.0, 0.0]], 2.0),  # a rotation deforms nothing
        ([[3.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -3.0]], 10.0 * 18.0 / (math.sqrt(18.0) + 5.0)),
        ([[0.0, 0.0, 6.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], 10.0 * 18.0 / (math.sqrt(18.0) + 5.0)),  # shear
    ],
)
def test_volume_error_relaxes_by_the_strain_rate(flow, rate):
    gradient, error = np.reshape(flow, (1, 9)), np.array([0.02])
    for fastest in (100.0, 1.0):
        divergence = np.zeros(1)
        velocity.relax_volume(error, gradient, 2.0, 10.0, 5.0, fastest, divergence)
        assert divergence[0] == pytest.approx(-0.02 * min(rate, fastest), rel=1e-12)


@pytest.mark.parametrize("minimum", [False, True])
@on_all
def test_paper_gradient(dimension, noise, minimum):
    c = make_case(dimension, noise, wall_pairs=True)
    out = np.zeros((len(c.p), 3))
    gradient.paper_gradient(
        c.p.position, c.scalar, *c.lists, c.wet[-1], c.lat.density, dimension, minimum, c.rows, out
    )
    mine = c.scalar[: c.rows]
    least = np.minimum(np.where(c.listed, c.scalar[None, :], np.inf).min(axis=1), mine)
    offset = -least if minimum else mine
    total = c.scalar[None, :] + offset[:, None]
    reference = dimension / (c.lat.density * c.l0) * np.einsum("ij,ijk->ik", c.w / c.r**2 * total, c.d)
    np.testing.assert_allclose(out[: c.rows], reference, atol=1e-9 * np.abs(reference).max())


@on_all
def test_residual_damping(dimension, noise):
    c = make_case(dimension, noise)
    n, base, slope = c.p.liquid, 0.05, 0.3
    grad = c.rng.normal(size=(len(c.p), 9))
    if dimension == 2:
        grad[:, [1, 3, 4, 5, 7]] = 0.0
    out = np.zeros((c.rows, 3))

    def damp(field, gradients):
        gradient.residual_damping(
            c.p.position,
            field,
            c.p.kind,
            gradients,
            *c.wet,
            c.lat.density,
            dimension,
            base,
            slope,
            n,
            out,
            *[None] * 5,
        )
        return out[:n].copy()

    got = damp(c.vector, grad)
    g = grad[:n].reshape(-1, 3, 3)
    link = c.d[:n, :n] * c.l0
    bracket = c.vector[None, :n] - c.vector[:n, None]
    bracket -= 0.5 * np.einsum("ijab,ijb->ija", g[:, None] + g[None, :], link)
    strength = np.minimum(base + slope * np.linalg.norm(bracket, axis=2), 0.3)
    reference = np.einsum("ij,ija->ia", strength * c.w[:n, :n], bracket) / c.lat.density
    np.testing.assert_allclose(got, reference, atol=1e-12 * np.abs(reference).max())
    np.testing.assert_allclose(got.sum(axis=0), 0.0, atol=1e-11 * np.abs(got).sum())
    tensor = c.rng.normal(size=(3, 3))
    got = damp(c.p.position @ tensor.T, np.tile(tensor.ravel(), (len(c.p), 1)))
    np.testing.assert_allclose(got, 0.0, atol=1e-14)


# Velocities


@on_all
def test_viscosity(dimension, noise):
    c = make_case(dimension, noise)
    n, nu, dt, before = c.p.liquid, 1e-3, 2e-3, c.rng.normal(size=(len(c.p), 3))
    out = before.copy()
    viscosity.add_viscosity(
        c.p.position, c.vector, c.p.kind, c.p.normal, c.p.depth, np.full((1, 1), nu), *c.wet, c.l0,
        c.lat.density, c.lat.lam, dimension, dt, n, out, None,
    )  # fmt: skip
    w = np.where(c.p.kind == 2, 0.0, c.w)[:n]
    wall = c.p.kind == WALL
    below = c.p.depth / c.l0
    height = -np.einsum("ijk,jk->ij", c.d[:n], c.p.normal) - below
    ghost = -np.minimum(below / np.maximum(height, 1e-3), 1.5)[:, :, None] * c.vector[:n, None, :]
    there = np.where(wall[None, :, None], ghost, c.vector[None, :, :])
    laplacian = np.einsum("ij,ijk->ik", w, there - c.vector[:n, None, :])
    laplacian *= 2.0 * dimension / (c.lat.density * c.lat.lam * c.l0**2)
    np.testing.assert_allclose(out[:n], before[:n] + dt * nu * laplacian, rtol=1e-10, atol=1e-12)
    np.testing.assert_array_equal(out[n:], before[n:])


@pytest.mark.parametrize("liquids", [1, 2])
@on_all
def test_transposed_velocity_gradient(dimension, noise, liquids):
    c = make_case(dimension, noise)
    n, dt, slope = c.p.liquid, 2e-3, c.rng.normal(size=(len(c.p), 9))
    if dimension == 2:
        slope[:, [1, 3, 4, 5, 7]] = 0.0
    nu = harmonic(np.array([1.0, 1e-2])[:liquids])
    fluid = np.arange(len(c.p)) % 2 if liquids == 2 else np.zeros(len(c.p), int)
    out = np.zeros_like(c.vector)
    viscosity.add_transpose(
        c.p.position, c.p.kind, slope, nu, *c.wet, c.l0, c.lat.density, c.lat.lam, dimension, dt, n, out,
        fluid.astype(np.int8) if liquids == 2 else None,
    )  # fmt: skip
    g, wall = slope.reshape(-1, 3, 3), c.p.kind == WALL
    weight = np.where(c.p.kind == 2, 0.0, c.w)[:n]
    weight = weight * np.where(wall, nu[fluid[:n], fluid[:n]][:, None], nu[fluid[:n, None], fluid])
    own = np.einsum("ijb,iba->ija", c.d[:n], g[:n])
    its = np.where(wall[None, :, None], own, np.einsum("ijb,jba->ija", c.d[:n], g))
    expected = np.einsum("ij,ija->ia", weight, 0.5 * (own + its)) * c.l0
    expected *= dt * 2.0 * dimension / (c.lat.density * c.lat.lam * c.l0**2)
    np.testing.assert_allclose(out[:n], expected, rtol=1e-6, atol=1e-9)
    assert not out[n:].any()


@on_all
def test_liquid_that_turns_as_a_whole_bears_no_stress(dimension, noise):
    c = make_case(dimension, noise)
    n, spin = c.p.liquid, np.array([[0.0, 0.3, 0.5], [-0.3, 0.0, 0.2], [-0.5, -0.2, 0.0]])
    if dimension == 2:
        spin[1] = spin[:, 1] = 0.0
    flow, slope = c.p.position @ spin.T, np.tile(spin.ravel(), (len(c.p), 1))
    far = c.p.kind.copy()
    far[far == WALL] = 0  # the walls turn with the liquid
    operator = (np.full((1, 1), 1e-3), *c.wet, c.l0, c.lat.density, c.lat.lam, dimension, 1.0)
    out = np.zeros_like(flow)
    viscosity.add_viscosity(c.p.position, flow, far, c.p.normal, c.p.depth, *operator, n, out, None)
    alone = np.abs(out).max()
    viscosity.add_transpose(c.p.position, far, slope, *operator, n, out, None)
    assert np.abs(out).max() < 1e-12 * alone


@pytest.mark.parametrize("liquids", [1, 2])
@on_all
def test_implicit_viscosity_has_the_operator_of_the_explicit_one(dimension, noise, liquids):
    c = make_case(dimension, noise)
    rows, n, dt = c.rows, c.p.liquid, 2e-4
    rho, dynamic = np.array([1.0, 1e-3])[:liquids], np.array([1.0, 1e-5])[:liquids]
    nu = harmonic(dynamic) / rho[:, None]
    fluid = None if liquids == 1 else (np.arange(len(c.p)) % 2).astype(np.int8)
    own = rho[np.zeros(rows, int) if fluid is None else fluid[:rows]]
    column = np.full(len(c.p), -1, np.int32)
    column[:rows] = np.arange(rows)
    first, halo_first = np.zeros((2, rows + 1), np.int32)
    columns, halo_columns = np.zeros((2, len(c.lists[1]) + rows), np.int32)
    values, halo_values = np.zeros((2, len(columns)))
    operator = (*c.wet, c.l0, c.lat.density, c.lat.lam, dimension, dt)
    walls = (c.p.kind, c.p.normal, c.p.depth)
    viscosity.viscosity_rows(
        c.p.position, *walls, nu, rho, column, *operator, first, columns, values, halo_first, halo_columns,
        halo_values, fluid,
    )  # fmt: skip
    assert halo_first[-1] == 0
    count = first[-1]
    matrix = csr_matrix((values[:count], columns[:count], first), shape=(rows, rows)).toarray()
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-14)
    np.testing.assert_array_equal(matrix[n:, n:], np.diag(own[n:]))
    change = np.zeros_like(c.vector)
    viscosity.add_viscosity(c.p.position, c.vector, *walls, nu, *operator, n, change, fluid)
    after = own[:n, None] * (c.vector[:n] - change[:n])
    np.testing.assert_allclose(matrix[:n, :n] @ c.vector[:n], after, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("sticks", [False, True])
@on_all
def test_reflection_at_walls(dimension, noise, sticks):
    c = make_case(dimension, noise)
    out = c.vector.copy()
    velocity.reflect_at_walls(
        c.p.position,
        c.vector,
        c.p.kind,
        c.p.normal,
        c.p.depth,
        *c.wet,
        c.l0,
        c.p.liquid,
        c.rows,
        sticks,
        out,
    )
    for i in range(c.p.liquid, c.rows):
        w = np.where(c.p.kind == FLUID, c.w[i], 0.0)
        if not w.any():
            assert not out[i].any()
            continue
        normal, below = c.p.normal[i], c.p.depth[i] / c.l0
        mean = w @ c.vector / w.sum()
        height = w @ (c.d[i] @ normal) / w.sum() - below
        ratio = min(below / max(height, 1e-3), 1.5)
        across = mean @ normal
        expected = -ratio * mean if sticks else mean - across * normal - ratio * across * normal
        np.testing.assert_allclose(out[i], expected, atol=1e-12)


@on_all
def test_contacts(dimension, noise):
    c = make_case(dimension, noise)
    n, least, reach, dt = c.p.liquid, 0.9, 1.5, 0.3 * c.l0
    out = np.zeros((len(c.p), 3))
    within = kernel(reach) / (reach * c.l0) ** 2
    count = velocity.add_contacts(
        c.p.position, c.vector, c.p.kind, *c.wet, within, least * c.l0, dt, n, out, None, None
    )
    d, r = c.d[:n, :n], np.where(c.listed[:n, :n], c.r[:n, :n], np.inf)
    towards = -np.einsum("ijk,ijk->ij", c.vector[None, :n] - c.vector[:n, None], d) / r
    allowed = np.where(np.isfinite(r), np.maximum(r - least, 0.0) * c.l0 / dt, 0.0)
    hit = (r < reach) & (towards > allowed)
    assert count == hit.sum() > 0
    slower = np.where(hit, 0.5 * (towards - allowed) / r, 0.0)
    np.testing.assert_allclose(out[:n], -np.einsum("ij,ijk->ik", slower, d), atol=1e-12)
    np.testing.assert_allclose(out.sum(axis=0), 0.0, atol=1e-10)


def test_body_force_of_a_turning_tank():
    rng = np.random.default_rng(3)
    r, v = rng.normal(size=(2, 20, 3))
    force, alpha, omega = rng.normal(size=(3, 3))
    kind = np.zeros(20, np.int8)
    kind[-1] = WALL
    out = np.zeros((20, 3))
    velocity.body_force(r, v, kind, force, alpha, omega, out)
    expected = force - np.cross(alpha, r) - np.cross(omega, np.cross(omega, r)) - 2.0 * np.cross(omega, v)
    expected[-1] = 0.0
    np.testing.assert_allclose(out, expected, atol=1e-13)


def test_predicted_acceleration_keeps_its_distance_from_the_body_force():
    rng = np.random.default_rng(4)
    last, force, v = rng.normal(size=(3, 50, 3))
    kind = np.zeros(50, np.int8)
    kind[-1] = WALL
    out, star = np.zeros((50, 3)), np.full((50, 3), np.nan)
    velocity.predict(kind, v, last, force, 1.0, 0.1, out, star)
    size = np.linalg.norm(last, axis=1)
    np.testing.assert_allclose(out, force + last * np.minimum(1.0, 1.0 / size)[:, None], atol=1e-14)
    np.testing.assert_allclose(star[:-1], (v + 0.1 * (force - out))[:-1], atol=1e-14)
    assert not star[-1].any()
    velocity.predict(kind, v, last, force, 0.0, 0.1, out, star)
    np.testing.assert_array_equal(out, force)


def test_acceleration_and_its_next_prediction():
    rng = np.random.default_rng(5)
    star, change, predicted, force, got = rng.normal(size=(5, 30, 3))
    velocity_before, acceleration = np.zeros((30, 3)), got.copy()
    velocity.accelerate(star, change, predicted, force, 0.1, 25, acceleration, velocity_before)
    np.testing.assert_allclose(velocity_before[:25], (star + change + 0.1 * (predicted - got))[:25], atol=1e-14)
    np.testing.assert_allclose(acceleration[:25], (0.5 * (predicted + got) - force)[:25], atol=1e-15)
    np.testing.assert_array_equal(acceleration[25:], got[25:])


def test_greatest_speed():
    v = np.random.default_rng(6).normal(size=(40, 3))
    assert velocity.greatest_speed(v, 30) == pytest.approx(np.linalg.norm(v[:30], axis=1).max())
    for wrong in (np.nan, np.inf, -np.inf):
        v[7, 1] = wrong
        assert velocity.greatest_speed(v, 30) == np.inf
    assert velocity.greatest_speed(v, 0) == 0.0


# Pressure equation


def upright(c):
    return np.tile([0.0, 0.0, 1.0], (c.rows, 1))


def assemble(c, surface, lean, link, wall, source, ghost, pressure, share=0.5, distance=0.5):
    rows, entries = c.rows, len(c.lists[1]) + c.rows
    column = np.full(len(c.p), -1, np.int32)
    column[:rows] = np.arange(rows)
    first, halo_first = np.zeros((2, rows + 1), np.int32)
    columns, halo_columns = np.zeros((2, entries), np.int32)
    values, halo_values = np.zeros((2, entries))
    at, rhs = np.zeros(rows, np.int32), np.zeros(rows)
    poisson.poisson_rows(
        c.p.position, c.p.kind, surface, lean, link, wall, source, pressure, column, *c.wet, c.l0, c.lat.density,
        c.lat.lam, c.dimension, 1000.0, share, distance * c.l0, ghost, first, columns, values, halo_first, halo_columns,
        halo_values, at, rhs, *[None] * 7,
    )  # fmt: skip
    assert halo_first[-1] == 0
    np.testing.assert_array_equal(columns[at], np.arange(rows))
    count = first[-1]
    matrix = csr_matrix((values[:count], columns[:count], first), shape=(rows, rows)).toarray()
    poisson.sort_rows(first, columns, values)
    for i in range(rows):
        assert np.all(np.diff(columns[first[i] : first[i + 1]]) > 0)
    again = csr_matrix((values[:count], columns[:count], first), shape=(rows, rows)).toarray()
    np.testing.assert_array_equal(again, matrix)
    return matrix, rhs


@pytest.mark.parametrize("ghost", [True, False])
@on_all
def test_poisson_rows(dimension, noise, ghost):
    c = make_case(dimension, noise)
    rows, n, share = c.rows, c.p.liquid, 0.5
    wall_force = c.rng.normal(size=(len(c.p), 3))
    source = c.rng.normal(size=rows)
    lean = c.rng.normal(size=(rows, 3))
    got, rhs = assemble(c, c.surface, lean, c.vector, wall_force, source, ghost, c.scalar, share, distance=0.4)
    scale = 2.0 * dimension / (c.lat.density * c.lat.lam * c.l0**2)
    matrix, right = np.zeros((rows, rows)), np.zeros(rows)
    for i in range(rows):
        if c.surface[i] and not ghost:
            matrix[i, i] = scale * c.lat.density
            continue
        flux = 0.0
        for j in np.flatnonzero(c.listed[i, :rows]):
            liquid = i < n and j < n
            w = c.w[i, j] * (1.0 if liquid else share)
            f = 0.5 * (c.vector[i] + c.vector[j]) if liquid else wall_force[min(i, j)]
            matrix[i, i] += scale * w
            flux += w * f @ c.d[i, j]
            if ghost or not c.surface[j]:
                matrix[i, j] -= scale * w
        if c.surface[i]:
            missing = -c.w[i] @ np.where(np.isfinite(c.r[i])[:, None], c.d[i], 0.0)
            extra = max(np.linalg.norm(missing) / 0.4, c.lat.density - c.w[i].sum())
            matrix[i, i] += scale * extra
            flux += np.linalg.norm(missing) * c.vector[i] @ lean[i] / np.linalg.norm(lean[i])
        held, least = 0.0, scale * poisson.WEAKEST_WALL
        if i >= n:
            if 0.0 < matrix[i, i] < least:
                held = (least - matrix[i, i]) * c.scalar[i]
            matrix[i, i] = max(matrix[i, i], least)
        elif matrix[i, i] == 0.0:
            matrix[i, i] = scale * c.lat.density
        right[i] = held - 1000.0 * (source[i] + scale * c.l0 * flux)
    np.testing.assert_allclose(got, matrix, atol=1e-10 * matrix.max())
    np.testing.assert_allclose(rhs, right, atol=1e-10 * np.abs(right).max())
    np.testing.assert_allclose(got, got.T, atol=1e-12 * got.max())
    assert np.linalg.eigvalsh(got)[0] > 0.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_hydrostatic_pressure_solves_the_equation_of_a_full_tank_of_disordered_particles(dimension):
    c = make_case(dimension, 0.3, full=True)
    force = np.array([1.3, 0.0 if dimension == 2 else -0.4, -9.8])
    everywhere = np.tile(force, (len(c.p), 1))
    none = np.zeros(len(c.p), np.int8)
    exact = 1000.0 * c.p.position[: c.rows] @ force
    matrix, rhs = assemble(c, none, upright(c), everywhere, everywhere, np.zeros(c.rows), True, exact)
    residual = matrix @ exact - rhs
    wet = np.array([matrix[i].astype(bool).sum() > 1 for i in range(c.rows)])
    np.testing.assert_allclose(residual[wet], 0.0, atol=1e-9 * np.abs(rhs).max())
    solved = np.linalg.lstsq(matrix[np.ix_(wet, wet)], rhs[wet], rcond=1e-10)[0]
    error = solved - exact[wet]
    np.testing.assert_allclose(error, error.mean(), atol=1e-6 * np.ptp(exact))


@pytest.mark.parametrize("dimension", [2, 3])
def test_hydrostatic_pressure_solves_the_equation_below_a_flat_surface(dimension):
    """Disordered below, where the equation is exact; the surface is even, and away from the walls."""
    c = make_case(dimension, 0.0)
    top = c.p.position[: c.p.liquid, 2].max()
    deep = c.p.position[: c.p.liquid, 2] < top - 2.5 * c.l0
    shake = c.rng.uniform(-0.3, 0.3, (c.p.liquid, 3)) * c.l0 * deep[:, None]
    shake[:, 1] *= dimension == 3
    c.p.position[: c.p.liquid] += shake
    pairs = Pairs(REACH * c.l0, c.solids)
    pairs.find(c.p)
    c.lists = pairs.lists
    strength, _ = pairs.weigh(c.l0, REACH, REACH)
    c.wet = *pairs.wet, strength
    surface = np.zeros(len(c.p), np.int8)
    surface[: c.p.liquid] = c.p.position[: c.p.liquid, 2] > top - 0.5 * c.l0
    everywhere = np.tile([0.0, 0.0, -9.8], (len(c.p), 1))
    exact = 9800.0 * (top + 0.5 * c.l0 - c.p.position[: c.rows, 2])
    matrix, rhs = assemble(c, surface, upright(c), everywhere, everywhere, np.zeros(c.rows), True, exact)
    residual = np.abs(matrix @ exact - rhs) / np.abs(rhs).max()
    wet = np.count_nonzero(matrix, axis=1) > 1
    plan = c.p.position[: c.rows, : dimension - 1]
    inner = np.all((plan > 2.1 * c.l0) & (plan < plan.max(axis=0) - 2.6 * c.l0), axis=1)
    flat = (surface[: c.rows] != 0) & inner
    assert flat.any()
    assert residual[wet & (surface[: c.rows] == 0)].max() < 1e-12
    assert residual[flat].max() < 1e-12


# Moving


def unbooked(count=10_000):
    """What the kernels book energy with, of one liquid without a body force."""
    return np.zeros(count, np.int8), np.ones(1), np.zeros((4, 3)), np.zeros(12)


@on_all
def test_move_without_shifting_or_surface_follows_the_velocity(dimension, noise):
    c = make_case(dimension, noise)
    n, dt = c.p.liquid, 1e-3
    before = c.p.position.copy()
    none = np.zeros(len(c.p), np.int8)
    m = moments_of(c)
    shifting.move(
        c.p.position, c.vector, c.p.kind, m.asymmetry, none, np.zeros((n, 3)), m.lean,
        np.zeros((len(c.p), 9)), c.l0, 1.0, 0.5 * c.l0, 0.0, dt, n, None, None, *c.wet, *unbooked(),
    )  # fmt: skip
    np.testing.assert_allclose(c.p.position[:n], before[:n] + dt * c.vector[:n], atol=1e-15)
    np.testing.assert_array_equal(c.p.position[n:], before[n:])


@on_all
def test_shifting_evens_the_spacing_and_carries_the_velocity_along(dimension, noise):
    c = make_case(dimension, noise)
    n, shift = c.p.liquid, 0.1
    m = moments_of(c)
    tensor = c.rng.normal(size=(3, 3))
    speed = c.p.position @ tensor.T
    before = c.p.position.copy()
    none = np.zeros(len(c.p), np.int8)
    normal = np.tile([0.0, 0.0, 1.0], (n, 1)) * (np.arange(n) % 2)[:, None]
    shifting.move(
        c.p.position, speed, c.p.kind, m.asymmetry, none, normal, m.lean,
        np.tile(tensor.ravel(), (len(c.p), 1)), c.l0, 1.0, 0.5 * c.l0, shift, 0.0, n, None, None, *c.wet, *unbooked(),
    )  # fmt: skip
    step = shift * c.l0 * m.asymmetry[:n]
    step -= np.sum(step * normal, axis=1)[:, None] * normal
    size = np.linalg.norm(step, axis=1)
    step *= np.minimum(1.0, 0.05 * c.l0 / np.maximum(size, 1e-300))[:, None]
    np.testing.assert_allclose(c.p.position[:n] - before[:n], step, atol=1e-14)
    np.testing.assert_allclose(speed[:n], c.p.position[:n] @ tensor.T, atol=1e-14)


@pytest.mark.parametrize("dimension", [2, 3])
def test_surface_particles_move_as_the_surface_above_them_in_a_wave(dimension):
    c, _, surface, normal = surface_at_rest(dimension)
    n, dt, k, distance = c.p.liquid, 1e-6, 0.3 / c.l0, 0.5 * c.l0
    m = moments_of(c)
    before = c.p.position.copy()
    x, z = c.p.position[:, 0], c.p.position[:, 2] - c.p.position[:n, 2].max()
    speed = np.exp(k * z)[:, None] * np.stack([-np.sin(k * x), 0.0 * x, np.cos(k * x)], axis=1)
    inverse, gradient = np.zeros((c.rows, 6)), np.zeros((len(c.p), 9))
    density.invert(m.matrix, 0.4, dimension, inverse)
    velocity.velocity_gradient(
        c.p.position, speed, *c.wet, inverse, c.lat.density, dimension, n, gradient
    )  # fmt: skip
    shifting.move(
        c.p.position, speed, c.p.kind, m.asymmetry, surface, normal, m.lean, gradient, c.l0,
        c.lat.lean, distance, 0.0, dt, n, None, None, *c.wet, *unbooked(),
    )  # fmt: skip
    plan, size = before[:n, : dimension - 1], [0.16] if dimension == 2 else [0.07, 0.06]
    middle = ((plan > 2.0 * c.l0) & (plan < np.array(size) - 2.0 * c.l0)).all(axis=1)
    checked = (surface[:n] != 0) & middle
    assert checked.sum() >= 2
    moved = (c.p.position[:n] - before[:n])[checked] / dt
    # (k d)^2 is 0.022; with the particle's own gradient they are 0.03 too slow
    np.testing.assert_allclose(moved, np.exp(k * distance) * speed[:n][checked], atol=0.008)


def test_particles_are_put_back_from_walls_and_lose_the_speed_towards_them():
    container = np.array([[0.0, -np.inf, 0.0], [1.0, np.inf, 0.5]])
    position = np.array([[-0.02, 0.0, 0.3], [0.5, 0.0, 0.51], [1.01, 0.0, -0.01], [0.5, 0.0, 0.25]])
    speed = np.array([[-1.0, 0.0, 2.0], [1.0, 0.0, -3.0], [1.0, 0.0, -1.0], [5.0, 0.0, 5.0]])
    count = shifting.keep_off_walls(
        position, speed, np.zeros(4, np.int8), Walls(container), 0.01, 4, *unbooked(4)
    )
    assert count >= 4
    np.testing.assert_allclose(
        position[:, [0, 2]], [[0.01, 0.3], [0.5, 0.49], [0.99, 0.01], [0.5, 0.25]], atol=1e-12
    )
    np.testing.assert_allclose(speed[:, [0, 2]], [[0, 2], [1, -3], [0, 0], [5, 5]], atol=1e-12)


# Graphs


@pytest.mark.parametrize("edges", [0, 60, 150, 1000])
def test_connected_parts_are_those_of_scipy(edges):
    rng = np.random.default_rng(edges)
    begins, columns = np.sort(rng.integers(0, 150, edges)), rng.integers(0, 200, edges).astype(np.int32)
    first = np.searchsorted(begins, np.arange(151)).astype(np.int32)  # the last vertices have edges to them alone
    part = np.arange(200)
    join(first, columns, part)
    count = number_parts(part)
    expected, label = connected_components(csr_matrix((np.ones(edges), (begins, columns)), shape=(200, 200)), False)
    assert count == expected
    assert len(set(zip(part.tolist(), label.tolist(), strict=True))) == expected


@pytest.mark.parametrize(("below", "added"), [(0.9, 0.1), (1.2, -0.2), (0.625, 0.1875), (-1.0, 0.0), (3.0, 0.0)])
def test_velocity_above_the_surface_follows_gradients_that_vary_little(below, added):
    """Above a surface particle: a linear change of the gradient is carried on, half of 3 eighths, none of a jump."""
    rng = np.random.default_rng(3)
    own = rng.normal(size=9)
    gradient = np.stack([own, below * own, below * own, 50.0 * own])  # the last one is of the surface, too
    kind, surface = np.zeros(4, np.int8), np.array([1, 0, 0, 1], np.int8)
    lists = np.array([0], np.uint32), np.array([3], np.uint32), np.array([1, 2, 3], np.uint32)
    q = rng.normal(size=3)
    found = shifting.velocity_above(0, kind, surface, gradient, *q, *lists, rng.uniform(1.0, 2.0, 3), np.empty(9))
    np.testing.assert_allclose(found, (1.0 + added) * own.reshape(3, 3) @ q, rtol=1e-12)
