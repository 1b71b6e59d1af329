"""Surfaces from STL files: what is cleaned, united or refused, against volumes that are known."""

import numpy as np
import pytest

from parmps.cautions import cautions
from parmps.errors import InputError
from parmps.kernels.triangles import exact_distance
from parmps.kernels.weight import lattice
from parmps.loader import parse_job
from parmps.mesh import _apart, load_hull
from parmps.packing import REACH, asymmetry, neighbours
from parmps.stl import read_surface
from parmps.tank import count_particles

FACES = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)]  # floor and lid
FACES += [t for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)) for t in ((a, b, b + 4), (a, b + 4, a + 4))]


def box(low, high):
    """Triangles (12, 3, 3) of a box, turned outwards."""
    (x, y, z), (u, v, w) = low, high
    corners = np.array([[x, y, z], [u, y, z], [u, v, z], [x, v, z], [x, y, w], [u, y, w], [u, v, w], [x, v, w]])
    return corners.astype(float)[FACES]


def ball(rings, radius=0.5):
    """Triangles of a ball around the origin, by latitude and longitude."""
    up, around = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    sine, cosine = np.sin(up)[:, None], np.cos(up)[:, None]
    at = radius * np.stack([sine * np.cos(around), sine * np.sin(around), cosine + 0 * around], axis=-1)
    here, right = at, np.roll(at, -1, axis=1)
    quads = [here[:-1], here[1:], right[1:], right[:-1]]
    faces = [np.stack([quads[k] for k in t], axis=2).reshape(-1, 3, 3) for t in ((0, 1, 2), (0, 2, 3))]
    return np.concatenate(faces)


def write(path, *parts):
    """Write triangles as binary STL."""
    triangles = np.concatenate(parts)
    record = np.zeros(len(triangles), [("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
    record["corner"] = triangles
    path.write_bytes(bytes(80) + np.uint32(len(triangles)).tobytes() + record.tobytes())
    return str(path)


def volume(triangles):
    a, b, c = triangles.transpose(1, 0, 2)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


UNIT, SMALL = box((0, 0, 0), (1, 1, 1)), box((0.25, 0.25, 0.25), (0.75, 0.75, 0.75))
LEFT, RIGHT = box((0, 0, 0), (0.6, 0.5, 0.6)), box((0.4, 0, 0), (1.0, 0.5, 0.6))
PLATE = np.array([[0.5, 0.2, 0.2], [0.5, 0.8, 0.2], [0.5, 0.8, 0.8], [0.5, 0.2, 0.8]])[[(0, 1, 2), (0, 2, 3)]]


def inwards(triangles):
    return triangles[:, ::-1]


@pytest.mark.parametrize(
    ("parts", "content", "remark"),
    [
        ((LEFT, RIGHT), 0.3, "2 shells overlap or touch and were united"),
        ((inwards(LEFT), inwards(RIGHT)), 0.3, "2 shells overlap or touch and were united"),
        ((UNIT, UNIT + [1, 0, 0]), 2.0, "2 shells overlap or touch and were united"),
        ((UNIT, 0.5 * UNIT + [1, 0.2, 0.2]), 1.125, "2 shells overlap or touch and were united"),
        ((UNIT, UNIT + [3, 0, 0]), 2.0, "2 rooms that no liquid flows between"),
        ((UNIT, inwards(UNIT + [3, 0, 0])), 2.0, "2 rooms that no liquid flows between"),
        ((UNIT, inwards(SMALL)), 0.875, None),
        ((UNIT, inwards(SMALL - [0, 0, 0.25])), 0.875, None),
        ((UNIT, inwards(0.9 * UNIT + 0.05)), 1 - 0.9**3, "a shell turned inwards takes 73% of it"),
        ((UNIT, PLATE, inwards(PLATE)), 1.0, "plates without thickness are no walls"),
    ],
)
def test_shells_are_united_or_taken_out(tmp_path, parts, content, remark):
    pytest.importorskip("manifold3d")
    surface = read_surface(write(tmp_path / "tank.stl", *parts))
    assert volume(surface.triangles) == pytest.approx(content, rel=1e-6)
    assert surface.triangles.min() == 0.0
    assert len(surface.remarks) == (remark is not None)
    assert remark is None or remark in surface.remarks[0]


def test_two_boxes_that_overlap_are_one_tank(tmp_path):
    pytest.importorskip("manifold3d")
    path = write(tmp_path / "tank.stl", LEFT, RIGHT)
    job = parse_job(
        f"dimension: 3\nspacing: 0.05\ntank: {{shape: stl, size: [1.0, 0.5, 0.6], surface: {path}}}\n"
        "fluids: [{name: water, fill: 0.5}]\ntime: {end: 1.0}"
    )
    assert job.depths[0] == pytest.approx(0.3)
    counts, spacing = count_particles(job, "half")
    assert counts["fluid"] * spacing**3 == pytest.approx(0.15, rel=0.01)
    assert any(c.startswith("tank.surface: 2 shells overlap") for c in cautions(job))


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ((UNIT, SMALL), r"a shell, from \[0.25, 0.25, 0.25\] to \[0.75, 0.75, 0.75\] m, inside another"),
        ((LEFT, inwards(RIGHT)), "crosses another and is turned the other way round"),
        ((UNIT[1:],), r"is not closed: 3 edges do not have two triangles, one of them near \["),
        ((UNIT, PLATE), r"is not closed: 4 edges .* near \[0.5, 0.5, 0.[28]\] m"),
        ((PLATE, inwards(PLATE)), "encloses no volume"),
        ((np.where(UNIT == 1.0, np.nan, UNIT),), "triangle 1 has a corner that is not finite"),
        ((UNIT[:2],), "has 2 triangles"),
    ],
)
def test_what_is_no_tank_is_refused_by_name(tmp_path, parts, message):
    pytest.importorskip("manifold3d")
    with pytest.raises(InputError, match=f"tank.surface: .*tank.stl: .*{message}"):
        read_surface(write(tmp_path / "tank.stl", *parts))


def divided(triangles):
    """A T-junction: the first triangle in four, with corners on two of its edges."""
    a, b, c = triangles[0]
    p, q, r = (a + b) / 2, 0.3 * a + 0.7 * b, (b + c) / 2
    return np.concatenate([triangles[1:], [[a, p, c], [p, q, c], [q, b, r], [q, r, c]]])


@pytest.mark.parametrize(
    "triangles",
    [
        inwards(UNIT),
        np.concatenate([UNIT[:5, ::-1], UNIT[5:]]),  # turned at random
        np.concatenate([UNIT, UNIT[:3]]),
        np.concatenate([UNIT, UNIT[:1, ::-1]]),
        np.concatenate([UNIT, UNIT[:2][:, [0, 0, 1]]]),
        np.concatenate([UNIT, [[[0, 0, 0], [1, 0, 0], [0.5, 0, 0]]]]),  # on an edge, and flat
        divided(UNIT),
        *(UNIT + np.random.default_rng(0).uniform(-gap, gap, UNIT.shape) for gap in (2e-7, 1e-6, 5e-6)),
        UNIT + [3e3, -4e3, 2e3],
    ],
)
def test_untidy_surfaces_are_cleaned(tmp_path, triangles):
    surface = read_surface(write(tmp_path / "tank.stl", triangles))
    assert volume(surface.triangles) == pytest.approx(1.0, abs=2e-5)
    assert surface.remarks == ()


def text_of(triangles):
    lines = ["solid tank"]
    for corners in triangles:
        lines += ["facet normal 0 0 0", "outer loop", *("vertex {} {} {}".format(*c) for c in corners)]
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid tank\n"])


TEXT = text_of(UNIT)


def test_text_and_binary_are_alike(tmp_path):
    texts = TEXT, TEXT.upper(), TEXT.replace("\n", "\r\n"), TEXT.replace("solid tank", "solid")
    for number, text in enumerate(texts):
        path = tmp_path / f"{number}.stl"
        path.write_text(text, newline="")
        np.testing.assert_array_equal(read_surface(str(path)).triangles.sum(), UNIT.sum())


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (bytes(80) + b"\x0c\0\0\0" + bytes(70), "is cut off or no STL file: by its header it holds 12 triangles"),
        (bytes(5000), "by its header it holds 0 triangles"),
        (b"\x89PNG\r\n\x1a\n" + bytes(200), "begins as a PNG file does"),
        (b"ply\nformat ascii 1.0\n", "begins as a PLY file does"),
        (b"time,surge\n" * 50, "550 bytes that neither begin with 'solid' nor are binary STL"),
        (TEXT[:900].encode(), "is cut off: there is no 'endsolid' at its end, after 8 whole triangles"),
        (TEXT.replace("endloop", "end", 1).encode(), "'facet normal 0 0 0' is none of its words"),
        ((TEXT + "more\n").encode(), "'more' is none of its words"),
        (TEXT.replace("1.0", "1,0").encode(), "a corner that is no number: could not convert string to float: '1,0'"),
        (TEXT.replace("1.0", "inf").encode(), "a corner that is not finite"),
        (b"solid a\nendsolid a\n", "has 0 triangles"),
    ],
)
def test_files_of_other_kinds_give_one_message(tmp_path, content, message):
    path = tmp_path / "tank.stl"
    path.write_bytes(content)
    with pytest.raises(InputError, match=f"tank.surface: .*tank.stl: .*{message}") as error:
        read_surface(str(path))
    assert "\n" not in str(error.value)


def test_a_surface_that_crosses_itself_is_refused(tmp_path):
    crossed = ball(12)
    crossed[crossed[..., 2] > 0.4] -= [0, 0, 1.5]  # the top pushed through the bottom
    hull = load_hull(write(tmp_path / "tank.stl", crossed), 0.1)
    with pytest.raises(InputError, match=r"tank.surface: crosses itself: \[.*\] m is inside it -1 times"):
        hull.distance(np.zeros((1, 3)))


def test_units_are_named(tmp_path):
    path = write(tmp_path / "tank.stl", 1000 * UNIT)
    text = "dimension: 3\nspacing: {}\ntank: {{shape: stl, size: {}, surface: {}}}\n"
    text += "fluids: [{{name: w, fill: 0.5}}]\ntime: {{end: 1}}"
    with pytest.raises(InputError, match="the file must be in m and is in mm"):
        parse_job(text.format(0.1, [1, 1, 1], path))
    job = parse_job(text.format(100.0, [1000, 1000, 1000], path))
    assert "tank.size: 1000 m is longer than any tank; is it in mm?" in cautions(job)


def test_exact_distance_from_a_box():
    random = np.random.default_rng(0)
    point = random.uniform(-0.5, 1.5, (200, 3))
    beyond = np.maximum(-point, point - 1.0)
    exact = np.where((beyond < 0).all(axis=1), -beyond.max(axis=1), -np.linalg.norm(np.maximum(beyond, 0), axis=1))
    np.testing.assert_allclose(exact_distance(point, UNIT, 1e-7), exact, atol=1e-12)


def test_points_are_picked_apart_and_moved_by_the_sum_over_their_pairs():
    random = np.random.default_rng(1)
    at = random.uniform(0, 6, (300, 3))
    picked = _apart(at, 0.8)
    free = np.ones(300, bool)
    for i in range(300):
        if free[i]:
            free[i + 1 :] &= np.linalg.norm(at[i + 1 :] - at[i], axis=1) > 0.8
    np.testing.assert_array_equal(picked, free)
    away = at[:, None] - at
    r = np.linalg.norm(away, axis=2)
    w = np.where((r > 0) & (r < REACH), (REACH - r) * 0.85 / (0.85 * r + 0.15 * REACH), 0.0)
    exact = 3 / lattice(3, REACH).density * np.einsum("ij,ijk->ik", w / np.where(r > 0, r, 1), away)
    np.testing.assert_allclose(asymmetry(at, at, neighbours(at, at, 1.0), 1.0, 3), exact, atol=1e-12)
    copy = at.copy()
    np.testing.assert_allclose(asymmetry(at, copy, neighbours(at, copy, 1.0), 1.0, 3), exact, atol=1e-12)
