"""Closed surfaces from STL files: read, cleaned, turned outwards, and their shells united."""

import functools
import os
import re
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from parmps.errors import InputError

KEY = "tank.surface"
WELDS = (1e-7, 1e-6, 1e-5)
"""Gaps that are closed, in diagonals of the box around the surface; the first that closes it is taken. The last is far
below any spacing that a tank can have: a thousand particles along it are 1e-3."""
SAME = 1e-6
"""Share of a shell's volume that is none: of what lies inside another, or outside."""
ANGLE = 1e-6
"""Faces at an edge that are this near, in rad, lie on each other."""
PLATING = 0.5
"""Share of a tank that solids inside it take, from which on the file looks like the tank's plating."""
FACET = re.compile(
    r"facet\s+normal(?:\s+\S+){3}\s+outer\s+loop\s+" + 3 * r"vertex\s+(\S+)\s+(\S+)\s+(\S+)\s+" + r"endloop\s+endfacet",
    re.IGNORECASE,
)
SOLID = re.compile(r"\s*(solid\b[^\n]*\n\s*(endsolid\b[^\n]*)\s*)+", re.IGNORECASE)
OTHERS = {b"\x89PNG": "PNG", b"\xff\xd8": "JPEG", b"ply": "PLY", b"PK": "ZIP", b"OFF": "OFF", b"ISO-10303": "STEP",
          b"glTF": "glTF", b"%PDF": "PDF", b"\x1f\x8b": "gzip", b"v ": "OBJ", b"# ": "OBJ or another text",
          b"\x89HDF": "HDF5", b"DXF": "DXF"}  # fmt: skip
"""How files of other kinds begin."""


@dataclass(frozen=True)
class Surface:
    """A closed surface; the box around it begins at the origin.

    Attributes
    ----------
    triangles : (m, 3, 3) float64, m
        Corners, counter-clockwise seen from outside.
    remarks : tuple of str
        What was done to the file's triangles that may not be what was meant.
    """

    triangles: np.ndarray
    remarks: tuple

    @property
    def extents(self):
        """Sides of the box around it: (3,) float64, m."""
        return np.ptp(self.triangles.reshape(-1, 3), axis=0)


def read_surface(path):
    """Read a closed surface.

    Vertices that nearly coincide are merged, triangles that are none or given twice are dropped, and edges are
    divided where corners of other triangles lie on them. All triangles of a shell are turned alike. Shells that
    overlap or touch are united; a shell inside another that is turned the other way round is a solid in the tank.

    Parameters
    ----------
    path : str

    Returns
    -------
    Surface

    Raises
    ------
    InputError
        There is no such file, it is no STL file, the surface is not closed, or its shells contradict each other; or
        it has several and manifold3d, which unites them, is not installed.
    """
    if not os.path.isfile(path):
        raise InputError(KEY, f"{path}: no such file")
    return _read(path, os.path.getmtime(path))


@functools.lru_cache(maxsize=4)
def _read(path, _changed):
    try:
        triangles = _parse(path)
        triangles, remarks = _close(triangles - triangles.min(axis=(0, 1)), _rounding(triangles))
    except (OSError, ValueError) as error:
        raise InputError(KEY, f"{path}: {error}") from None
    return Surface(np.ascontiguousarray(triangles - triangles.min(axis=(0, 1))), tuple(remarks))


def _rounding(triangles):
    """What single precision, in which STL files are written, may move a corner by, m."""
    return float(np.abs(triangles).max() * np.finfo(np.float32).eps)


# The file


def _parse(path):
    """Triangles of a file, (m, 3, 3) float64; a ValueError says what is wrong with it."""
    with open(path, "rb") as file:
        data = file.read()
    if not data:
        raise ValueError("is empty")
    count = int.from_bytes(data[80:84], "little")
    if len(data) >= 84 and len(data) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
        triangles = np.frombuffer(data, record, count, 84)["corner"].astype(float)
    elif data.lstrip()[:5].lower() == b"solid" and b"\0" not in data:
        triangles = _parse_text(data.decode("latin-1"))
    else:
        raise ValueError(_other_kind(data, count))
    if not np.isfinite(triangles).all():
        bad = int(np.argmin(np.isfinite(triangles).all(axis=(1, 2))))
        raise ValueError(f"triangle {bad + 1} has a corner that is not finite")
    if len(triangles) < 4:
        raise ValueError(f"has {len(triangles)} triangles, a closed surface has at least 4")
    return triangles


def _parse_text(text):
    found = FACET.findall(text)
    rest = FACET.sub("", text)
    if not SOLID.fullmatch(rest.rstrip() + "\n"):
        if "endsolid" not in text[-200:].lower():
            raise ValueError(f"is cut off: there is no 'endsolid' at its end, after {len(found)} whole triangles")
        lines = [line.strip() for line in rest.splitlines()]
        odd = next((line for line in lines if line and not re.match(r"(end)?solid\b", line, re.IGNORECASE)), "solid")
        raise ValueError(f"is no STL file: '{odd[:60]}' is none of its words, after or among {len(found)} triangles")
    try:
        return np.array(found, dtype=float).reshape(-1, 3, 3)
    except ValueError as error:
        raise ValueError(f"has a corner that is no number: {error}") from None


def _other_kind(data, count):
    kind = next((name for begin, name in OTHERS.items() if data.startswith(begin)), None)
    if kind is not None:
        return f"is no STL file; it begins as a {kind} file does"
    if len(data) < 84 or (data[:512].isascii() and b"\0" not in data[:512]):
        return f"is no STL file: {len(data)} bytes that neither begin with 'solid' nor are binary STL"
    return (
        f"is cut off or no STL file: by its header it holds {count} triangles in {84 + 50 * count} bytes, but it has "
        f"{len(data)}"
    )


# Cleaning


def _close(triangles, rounding):
    """Clean and turn triangles, unite shells: triangles (m, 3, 3) and what to remark. A ValueError if that fails."""
    diagonal = float(np.linalg.norm(np.ptp(triangles.reshape(-1, 3), axis=0)))
    for weld in WELDS:
        tolerance = max(weld * diagonal, 2.0 * rounding)
        corners, faces = _welded(triangles, tolerance)
        if len(_open_edges(faces)):
            faces = _divided(corners, faces, tolerance)
        if len(faces) and not len(_open_edges(faces)):
            break
    else:
        raise ValueError(_open_message(corners, faces, tolerance) if len(faces) else "encloses no volume")
    shells, flat = _shells(corners, faces, tolerance)
    remarks = []
    if flat:
        remarks.append(
            "triangles that lie back to back were left out: plates without thickness are no walls; give them as "
            "tank.baffles"
        )
    if not shells:
        raise ValueError("encloses no volume")
    if len(shells) > 1:
        united, more = _united(corners, shells)
        return united, remarks + more
    only = shells[0]
    return corners[only if _volume(corners, only) > 0.0 else only[:, ::-1]], remarks


def _distinct(rows):
    """Rows (n, k) that differ: the number of one of each, for each row which that is, and how many are like it."""
    order = np.lexsort(rows.T)
    new = np.append(True, (np.diff(rows[order], axis=0) != 0).any(axis=1))[: len(rows)]
    which = np.empty(len(rows), int)
    which[order] = np.cumsum(new) - 1
    return order[new], which, np.bincount(which)


def _welded(triangles, tolerance):
    """Corners (n, 3) that differ, and faces (m, 3) without those that are none or given twice."""
    points = triangles.reshape(-1, 3)
    one, which, _ = _distinct(points)
    corners = points[one]
    pairs = cKDTree(corners).query_pairs(tolerance, output_type="ndarray")
    link = coo_matrix((np.ones(len(pairs)), pairs.T), shape=2 * (len(corners),))
    _, cluster = connected_components(link, directed=False)
    _, first = np.unique(cluster, return_index=True)
    faces = cluster[which].reshape(-1, 3)
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    # the least corner first keeps the turn
    faces = np.take_along_axis(faces, (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    return corners[first], faces[np.sort(_distinct(faces)[0])]


def _edges(faces):
    """Edges of faces, (3 m, 2), those of face k in rows k, m + k and 2 m + k."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _open_edges(faces):
    """Rows of `_edges` that an odd number of faces have."""
    _, which, count = _distinct(np.sort(_edges(faces), axis=1))
    return np.flatnonzero(count[which] % 2)


def _divided(corners, faces, tolerance):
    """Faces, each once however turned, none flatter than the tolerance; divided where corners lie on open edges."""
    faces = faces[np.sort(_distinct(np.sort(faces, axis=1))[0])]
    a, b, c = corners[faces].transpose(1, 0, 2)
    longest = np.max([np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)], 0)
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > tolerance * longest]
    for _ in range(3):  # one edge of a face at a time
        rows = _open_edges(faces)
        if not len(rows):
            break
        edges = _edges(faces)[rows]
        ends = np.unique(edges)
        middle, half = corners[edges].mean(axis=1), np.linalg.norm(np.diff(corners[edges], axis=1)[:, 0], axis=1) / 2
        near = cKDTree(corners[ends]).query_ball_point(middle, half + tolerance)
        done, fans = set(), []
        for row, (start, end), around in zip(rows, edges, near, strict=True):
            face, along = row % len(faces), corners[end] - corners[start]
            there = np.setdiff1d(ends[around], faces[face])
            at = (corners[there] - corners[start]) @ along / (along @ along)
            off = np.linalg.norm(corners[there] - corners[start] - at[:, None] * along, axis=1)
            on = (off < tolerance) & (at > 0.0) & (at < 1.0)
            if face in done or not on.any():
                continue
            done.add(face)
            chain = [start, *there[on][np.argsort(at[on])], end]
            top = faces[face][(row // len(faces) + 2) % 3]
            fans += [(p, q, top) for p, q in zip(chain[:-1], chain[1:], strict=True)]
        if not done:
            break
        faces = np.concatenate([np.delete(faces, list(done), axis=0), np.array(fans)])
    return faces


def _open_message(corners, faces, tolerance):
    edges = np.sort(_edges(faces)[_open_edges(faces)], axis=1)
    edges = edges[_distinct(edges)[0]]
    at = corners[edges].mean(axis=(0, 1))
    place = corners[edges].mean(axis=1)
    place = place[np.argmin(np.linalg.norm(place - at, axis=1))]
    return (
        f"is not closed: {len(edges)} edges do not have two triangles, one of them near "
        f"{_point(place)} m from the lower corner of the box around it; gaps of up to "
        f"{tolerance:.2g} m are closed"
    )


# Shells


def _volume(corners, faces):
    a, b, c = corners[faces].transpose(1, 0, 2)
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def _shells(corners, faces, tolerance):
    """Faces of each closed shell, all turned as most of its own are in the file; and the number of flat shells."""
    edges, number = _edges(faces), len(faces)
    rows = _pairs(corners, faces, edges)
    (f, g), same = (rows % number).T, edges[rows[:, 0], 0] == edges[rows[:, 1], 0]
    # Each face is there twice, as it is and turned round; neighbours agree where they pass their edge both ways.
    one = np.concatenate([f, f + number])
    other = np.concatenate([g + number * same, g + number * ~same])
    link = coo_matrix((np.ones(len(one)), (one, other)), shape=(2 * number, 2 * number))
    _, label = connected_components(link, directed=False)
    if np.any(label[:number] == label[number:]):
        raise ValueError("has no inside: a way along its surface comes back on the other side")
    found, flat = [], 0
    shell = np.minimum(label[:number], label[number:])
    for k in np.unique(shell):
        mine = np.flatnonzero(shell == k)
        turned = label[mine] != k
        if 2 * np.count_nonzero(turned) > len(mine):
            turned = ~turned
        faces_of = np.where(turned[:, None], faces[mine][:, ::-1], faces[mine])
        if len(_open_edges(faces_of)):
            raise ValueError("is no single surface: edges that 4 or more triangles have divide it into open parts")
        a, b, c = corners[faces_of].transpose(1, 0, 2)
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        if abs(_volume(corners, faces_of)) <= tolerance * area:
            flat += 1
        else:
            found.append(faces_of)
    return found, flat


def _pairs(corners, faces, edges):
    """Rows of `_edges` that go together, (k, 2): faces beside each other on the same shell.

    Where more than two meet at an edge, those do between which the inside lies, going around it.
    """
    _, which, count = _distinct(np.sort(edges, axis=1))
    order = np.argsort(which, kind="stable")
    pairs = [order[count[which[order]] == 2].reshape(-1, 2)]
    many = order[count[which[order]] > 2]
    for rows in np.split(many, np.flatnonzero(np.diff(which[many])) + 1) if len(many) else []:
        start, end = np.sort(edges[rows[0]])
        top = faces[rows % len(faces), (rows // len(faces) + 2) % 3]
        axis = (corners[end] - corners[start]) / np.linalg.norm(corners[end] - corners[start])
        out = corners[top] - corners[start]
        out -= (out @ axis)[:, None] * axis
        angle = np.arctan2(np.cross(out[0], out) @ axis, out @ out[0])
        # the inside lies beyond a face that passes the edge backwards, and before one that passes it forwards
        forwards = edges[rows, 0] == start
        turn = np.lexsort((~forwards, np.rint(angle / ANGLE) % round(2.0 * np.pi / ANGLE)))
        turn = np.roll(turn, -np.argmin(forwards[turn]))
        if len(rows) % 2 == 0 and not forwards[turn[::2]].any() and forwards[turn[1::2]].all():
            pairs.append(rows[turn].reshape(-1, 2))
    return np.concatenate(pairs)


def _united(corners, shells):
    """Triangles of several shells as one surface, and what to remark.

    The largest is turned outwards, and all others with it. Those turned outwards are added, those turned inwards are
    taken out, the largest first.
    """
    try:
        from manifold3d import Manifold, Mesh64
    except ImportError:
        raise ValueError(
            f"has {len(shells)} separate shells; to unite them needs manifold3d, which is not installed: "
            "pip install manifold3d"
        ) from None
    shells = sorted(shells, key=lambda shell: -abs(_volume(corners, shell)))
    outwards = np.sign(_volume(corners, shells[0]))
    tank, rooms, taken = Manifold(), 0, 0.0
    for shell in shells:
        sign = outwards * np.sign(_volume(corners, shell))
        used, local = np.unique(shell, return_inverse=True)
        faces = local.reshape(-1, 3) if _volume(corners, shell) > 0.0 else local.reshape(-1, 3)[:, ::-1]
        body = Manifold(Mesh64(corners[used], np.ascontiguousarray(faces, np.uint64)))
        inside = (tank ^ body).volume() / body.volume()
        box = corners[shell].reshape(-1, 3)
        place = f"from {_point(box.min(axis=0))} to {_point(box.max(axis=0))} m"
        if sign < 0.0 and inside > 1.0 - SAME:
            tank, taken = tank - body, taken + body.volume()
            continue
        if sign < 0.0 and inside > SAME:
            raise ValueError(
                f"has a shell, {place}, that crosses another and is turned the other way round: it could be a part of "
                "the tank or a solid in it; turn it round or cut off what is outside"
            )
        if inside > 1.0 - SAME:
            raise ValueError(
                f"has a shell, {place}, inside another, turned the same way; turn it round if it is a solid in the "
                "tank, leave it out if it is the other side of the tank's plating"
            )
        tank, rooms = tank + body, rooms + 1
    whole = tank.volume() + taken
    remarks = []
    parts = sum(part.volume() > 0.0 for part in tank.decompose())
    if parts < rooms:
        remarks.append(f"{rooms} shells overlap or touch and were united: liquid flows from one to the other")
    if parts > 1:
        remarks.append(f"it has {parts} rooms that no liquid flows between; each is filled to the same level")
    if taken > PLATING * whole:
        remarks.append(
            f"a shell turned inwards takes {taken / whole:.0%} of it, as a solid in the tank; if the file is the "
            "tank's plating, keep its inner surface only"
        )
    mesh = tank.to_mesh64()
    return mesh.vert_properties[:, :3][mesh.tri_verts], remarks


def _point(at):
    return "[" + ", ".join(f"{x:.4g}" for x in at) + "]"
