"""Random scenes: a seed makes a job of keys that are legal one by one; together, they may be refused."""

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
import yaml

ROWS = {2: (8, 20), 3: (6, 10)}
"""Rows of particles over the depth. Coarse is how people start."""
MOST = {2: 1800, 3: 3500}
"""Particles of liquid at most; the spacing grows until there are no more."""
LAYER_ROWS = 5
"""Rows of the thinnest layer in a box, where that takes no more than twice as many particles."""
SETTINGS = {
    "radius": (1.6, 3.1),
    "laplacian_radius": (1.6, 3.1),
    "overdensity": (1.0, 1.2),
    "separation": (0.0, 1.0),
    "volume_radius": (2.6, 4.0),
    "volume_time": (0.1, 2.0),
    "shifting": (0.3, 1.2),
    "damping": (0.5, 2.0),
    "predictor_limit": (0.0, 2.0),
    "divergence_floor": (0.3, 0.6),
    "gradient_floor": (0.7, 0.8),
    "collision_distance": (0.3, 0.8),
    "courant": (0.1, 0.6),
    "steady_step": (0.1, 0.4),
    "hierarchy_excess": (0.0, 400.0),
    "ksp_rtol": (1e-8, 1e-2),
}
"""Single settings of the default scheme, and in which ranges they are tried."""
WORDS = {"gradient": ["corrected", "sum", "min"], "position": ["start", "moved"], "surface": ["ghost", "dirichlet"],
         "wall": ["half", "line"]}  # fmt: skip


class Scene(NamedTuple):
    """A job and what it reads.

    Attributes
    ----------
    seed : int
    job : dict
        Plain data of the job file.
    surface : None or trimesh.Trimesh
        Of the tank of shape stl.
    """

    seed: int
    job: dict
    surface: trimesh.Trimesh | None

    @property
    def text(self):
        """The job file."""
        return yaml.safe_dump(self.job, sort_keys=False, default_flow_style=None, width=110)

    @property
    def still(self):
        """Whether nothing may move: no motion, no velocity, stable layers, and a scheme that can hold them."""
        job = self.job
        layers = [fluid["density"] for fluid in job["fluids"]]
        return (
            not job["motion"]
            and job["gravity"] > 0.0
            and job["initial"] == "rest"
            and all("fill" in fluid and "surface_tension" not in fluid for fluid in job["fluids"])
            and layers == sorted(layers, reverse=True)
            and not self.papers
        )

    @property
    def papers(self):
        """Whether the scheme is the papers' one, which is kept as a baseline and gains energy and volume."""
        scheme = self.job["scheme"]
        return scheme == "papers" or (isinstance(scheme, dict) and bool(WORDS.keys() & scheme.keys()))

    @property
    def description(self):
        """In a few words."""
        job, tank = self.job, self.job["tank"]
        words = [f"{job['dimension']}D {tank.get('shape', 'box')}"]
        if not tank.get("lid", True):
            words.append("open")
        if tank["baffles"]:
            words.append(f"{len(tank['baffles'])} baffle(s)")
        fluids = job["fluids"]
        fills = [f"{100 * fluid['fill']:.3g} %" if "fill" in fluid else "region" for fluid in fluids]
        words.append(" + ".join(fills))
        if any("surface_tension" in part for part in (*fluids, *job["interfaces"])):
            words.append("tension")
        words.append(" and ".join(item["kind"] for item in job["motion"]) or "no motion")
        if job["gravity"] != 9.81:
            words.append(f"gravity {job['gravity']:g}")
        if job["initial"] != "rest":
            words.append(job["initial"]["kind"].replace("_", " "))
        scheme = job["scheme"]
        words.append(scheme if isinstance(scheme, str) else ", ".join(f"{k} {v}" for k, v in scheme.items()))
        return "; ".join(words)

    def write(self, directory):
        """Write the job and what it reads; the path of the job file.

        Parameters
        ----------
        directory : path-like

        Returns
        -------
        Path
        """
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        if self.surface is not None:
            self.surface.export(directory / self.job["tank"]["surface"])
        path = directory / f"scene_{self.seed}.yaml"
        path.write_text(f"# {self.description}\n{self.text}")
        return path


def make_scene(seed):
    """Make the scene of a seed.

    Parameters
    ----------
    seed : int

    Returns
    -------
    Scene
    """
    rng = np.random.default_rng([24, seed])
    dimension = 2 if rng.random() < 0.65 else 3
    shapes = ["box", "prism", "cylinder"] + (["sphere", "stl"] if dimension == 3 else [])
    tank, surface = _tank(rng, dimension, str(rng.choice(shapes)), seed)
    size = tank["size"]
    count = int(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
    fill = 1.0 if rng.random() < 0.12 else _round(rng.uniform(0.1, 0.98))
    rows = rng.integers(*ROWS[dimension], endpoint=True)
    volume = math.prod(size) * fill
    spacing = _round(max(fill * size[-1] / rows, (volume / MOST[dimension]) ** (1.0 / dimension)))
    tank["baffles"] = [_baffle(rng, tank, spacing) for _ in range(rng.choice([0, 1, 2], p=[0.4, 0.4, 0.2]))]
    scheme = _scheme(rng)
    papers = scheme == "papers" or (isinstance(scheme, dict) and scheme.get("preset") == "papers")
    fluids = _fluids(rng, count, fill, papers)
    if tank["shape"] == "box" and count > 1:  # the rows of each layer must fit its depth within a tenth
        finest = (volume / (2 * MOST[dimension])) ** (1.0 / dimension)
        thinnest = min(fluid["fill"] for fluid in fluids) * size[-1]
        spacing = _round(min(spacing, max(thinnest / LAYER_ROWS, finest)))
    gravity = float(rng.choice([9.81, 1.62, 0.0], p=[0.9, 0.05, 0.05]))
    rate = math.sqrt(max(gravity, 1.0) / size[0])
    motion = [] if rng.random() < 0.35 else [_law(rng, dimension, size, rate) for _ in range(rng.integers(1, 3))]
    initial = "rest"
    if rng.random() < 0.12:
        speed = 0.3 * rate * size[0]
        value = [_round(v) for v in rng.uniform(-speed, speed, dimension)]
        initial = {"kind": "velocity", "fluid": fluids[-1]["name"], "value": value}
    elif rng.random() < 0.15:
        initial = {"kind": "standing_wave", "mode": int(rng.integers(1, 3)), "amplitude": _round(0.02 * size[-1])}
    elif rng.random() < 0.1 and count == 1:
        del fluids[0]["fill"]
        fluids[0]["region"] = _region(rng, dimension, size)
    job = {
        "dimension": dimension, "spacing": spacing, "gravity": gravity, "tank": tank, "fluids": fluids,
        "interfaces": _interfaces(rng, fluids), "motion": motion, "initial": initial,
        "time": {"end": _round(rng.uniform(1.0, 2.0) * (1.0 if dimension == 2 else 0.3))},
        "scheme": scheme,
        "probes": [_probe(rng, f"p{number}", tank, fluids) for number in range(rng.integers(0, 5))],
        "output": {"probes_every": float(rng.choice([0.005, 0.02, 0.05, 0.1])), "particles_every": 0.1},
    }  # fmt: skip
    return Scene(seed, job, surface)


def _round(value):
    return float(f"{value:.3g}")


def _tank(rng, dimension, shape, seed):
    """A tank of some size without baffles, and the surface of one of shape stl."""
    length = _round(10.0 ** rng.uniform(-0.5, 0.3))
    size = [_round(length * side) for side in (1.0, *rng.uniform(0.4, 0.9, dimension - 1))]
    tank, surface = {"shape": shape, "size": size}, None
    if shape in ("cylinder", "sphere"):
        round_sides = dimension if shape == "sphere" or dimension == 2 else 2
        size[-round_sides:] = [size[-1]] * round_sides
    elif shape == "prism":
        across, height = size[-2:]
        edges = ["bottom", "top"] if rng.random() < 0.6 else [str(rng.choice(["bottom", "top"]))]
        tank["chamfer"] = {
            edge: [_round(across * rng.uniform(0.1, 0.45)), _round(height * rng.uniform(0.1, 0.45))] for edge in edges
        }
    elif shape == "stl":
        made = [trimesh.creation.box((1, 1, 1)), trimesh.creation.icosphere(2), trimesh.creation.cylinder(0.5, 1.0),
                trimesh.creation.capsule(1.0, 0.5)]  # fmt: skip
        surface = made[rng.integers(len(made))]
        surface.apply_scale(np.array(size) / surface.extents)
        tank["surface"] = f"scene_{seed}.stl"
    if shape in ("box", "prism") and rng.random() < 0.15:
        tank["lid"] = False
    return tank, surface


def _baffle(rng, tank, spacing):
    """A plate somewhere in the box around the tank, as thick as some spacings."""
    size = tank["size"]
    length, height = size[0], size[-1]
    thickness = _round(spacing * rng.uniform(0.5, 2.5))
    inside = [_round(side * rng.uniform(0.15, 0.85)) for side in (length, height)]
    if len(size) == 3 and tank["shape"] in ("box", "prism") and rng.random() < 0.25:
        ring = _round(rng.uniform(0.1, 0.3) * min(size))
        return {"x": inside[0], "ring": ring, "thickness": thickness}
    low, high = sorted(rng.uniform(0.0, 1.0, 2))
    low = 0.0 if rng.random() < 0.5 else low
    if rng.random() < 0.7:
        plate = {"x": inside[0], "bottom": _round(low * height), "top": _round(max(high, low + 0.1) * height)}
        up = (plate["bottom"], plate["top"])
    else:
        plate = {"z": inside[1], "left": _round(low * length), "right": _round(max(high, low + 0.1) * length)}
        up = (plate["left"], plate["right"])
    plate["thickness"] = thickness
    if len(size) == 3 and rng.random() < 0.4:
        plate["width"] = [_round(share * size[1]) for share in (rng.uniform(0.0, 0.4), rng.uniform(0.6, 1.0))]
        if rng.random() < 0.5:
            across, upright = np.array(plate["width"]), np.array(up)
            corners = [[_round(side[0] + share * (side[1] - side[0])) for side in (across, upright)]
                       for share in (0.25, 0.75)]  # fmt: skip
            if "z" in plate:
                corners = [corner[::-1] for corner in corners]
            plate["openings"] = [corners]
    return plate


def _fluids(rng, count, fill, papers):
    """Layers of random shares, the heavier ones below as a rule."""
    shares = rng.dirichlet(np.full(count, 4.0)) * fill
    ratio = 10.0 ** rng.uniform(0.0, 0.8 if papers else 3.0)
    densities = sorted(1000.0 / ratio ** rng.uniform(0.0, 1.0, count), reverse=True)
    if rng.random() < 0.1:
        densities = densities[::-1]
    fluids = []
    for name, share, density in zip("abc", shares, densities, strict=False):
        fluid = {"name": name, "fill": float(f"{math.floor(share * 1e4) / 1e4:.4g}"), "density": _round(density)}
        fluid["kinematic_viscosity"] = float(rng.choice([0.0, 1e-6, 1e-4, 1e-2, 1.0], p=[0.1, 0.5, 0.2, 0.1, 0.1]))
        if not papers and rng.random() < 0.1:
            fluid["surface_tension"] = float(rng.choice([0.07, 1.0]))
        fluids.append(fluid)
    if fill == 1.0:
        fluids[-1]["fill"] = float(f"{1.0 - sum(fluid['fill'] for fluid in fluids[:-1]):.4g}")
    return fluids


def _interfaces(rng, fluids):
    interfaces = []
    for lower, upper in zip(fluids, fluids[1:], strict=False):
        if rng.random() < 0.3:
            entry = {"between": [lower["name"], upper["name"]], "surface_tension": float(rng.choice([0.05, 1.0]))}
            if rng.random() < 0.3:
                entry["wetting_angle"] = _round(rng.uniform(40.0, 140.0))
            interfaces.append(entry)
    return interfaces


def _region(rng, dimension, size):
    if rng.random() < 0.6:
        high = [_round(side * rng.uniform(0.3, 0.9)) for side in size]
        return {"box": [[0.0] * dimension, high]}
    centre = [_round(side * rng.uniform(0.4, 0.6)) for side in size]
    radius = _round(rng.uniform(0.4, 0.95) * min(min(c, side - c) for c, side in zip(centre, size, strict=True)))
    return {"disc" if dimension == 2 else "ball": {"centre": centre, "radius": radius}}


def _law(rng, dimension, size, rate):
    """A motion near resonance, of up to half of what gravity pulls with."""
    omega = _round(rate * rng.uniform(0.8, 4.0))
    kinds = ["surge", "heave", "roll", "pitch"] + (["sway", "yaw"] if dimension == 3 else [])
    kind, phase = str(rng.choice(kinds)), float(rng.choice([0.0, 90.0, _round(rng.uniform(-180.0, 180.0))]))
    strength = rng.uniform(0.02, 0.5)
    if kind in ("surge", "sway", "heave"):
        amplitude = _round(min(strength * 9.81 / omega**2, 0.2 * size[0]))
        return {"kind": kind, "amplitude": amplitude, "omega": omega, "phase_deg": phase}
    law = {"kind": kind, "amplitude_deg": _round(40.0 * strength), "omega": omega, "phase_deg": phase}
    if rng.random() < 0.5:
        law["centre"] = [_round(side * rng.random()) for side in size]
    return law


def _scheme(rng):
    chance = rng.random()
    if chance < 0.7:
        return str(rng.choice(["balanced", "papers", "fast", "accurate"], p=[0.4, 0.2, 0.2, 0.2]))
    if chance < 0.92:
        name = str(rng.choice(list(SETTINGS)))
        low, high = SETTINGS[name]
        value = high * (low / high) ** rng.random() if low > 0.0 and high / low > 100 else rng.uniform(low, high)
        return {"preset": str(rng.choice(["balanced", "fast", "accurate"])), name: _round(value)}
    name = str(rng.choice(list(WORDS)))
    return {"preset": str(rng.choice(["balanced", "papers"])), name: str(rng.choice(WORDS[name]))}


def _probe(rng, name, tank, fluids):
    """A measurement somewhere; in tanks that are no boxes, as a rule away from their edges."""
    kinds = ["pressure", "elevation", "liquid", "force"] + (["interface"] if len(fluids) > 1 else [])
    probe = {"name": name, "kind": str(rng.choice(kinds))}
    edges = [0.0, 1.0] if tank["shape"] == "box" or rng.random() < 0.1 else [0.35, 0.65]
    at = [_round(side * rng.choice([*edges, rng.uniform(0.3, 0.7)])) for side in tank["size"]]
    if probe["kind"] == "pressure":
        probe["at"] = at
    elif probe["kind"] in ("elevation", "interface"):
        probe["at"] = at[:-1]
        if rng.random() < 0.3:
            probe["fixed_to"] = "earth"
    if probe["kind"] == "interface":
        probe["between"] = [fluids[0]["name"], fluids[-1]["name"]]
    elif probe["kind"] == "liquid":
        probe["fluid"] = fluids[0]["name"]
    return probe
