"""Openings too narrow for the particles are warned about, each with its width; wide ones are not."""

import numpy as np
import pytest
from test_stl import UNIT, write

from parmps.cautions import cautions
from parmps.loader import parse_job


def narrow(tank, dimension=3, spacing=0.05):
    job = parse_job(
        f"dimension: {dimension}\nspacing: {spacing}\ntank: {{{tank}}}\nfluids: [{{name: w, fill: 0.6}}]\n"
        "time: {end: 1.0}\noutput: {particles_every: 0.5}"
    )
    return [caution for caution in cautions(job) if "liquid flows" in caution]


HOLES = "[[0.3, 0.2], [0.32, 0.22]], [[0.5, 0.2], [0.53, 0.4]], [[0.6, 0.3], [0.8, 0.5]]"


@pytest.mark.parametrize(
    ("tank", "dimension", "found"),
    [
        (f"size: [1, 1, 0.6], baffles: [{{x: 0.5, bottom: 0, top: 0.6, thickness: 0.05, openings: [{HOLES}]}}]", 3,
         ["tank.baffles[0].openings[0]: an opening (2 of the plate's 3 are narrow) is 0.02 m wide or less, 0.4 spac"]),
        ("size: [1.0, 0.6], baffles: [{x: 0.5, bottom: 0.03, top: 0.4, thickness: 0.05}]", 2,
         ["tank.baffles[0]: the gap to the floor is 0.03 m"]),
        ("size: [1.0, 0.6], baffles: [{x: 0.5, bottom: 0.2, top: 0.54, thickness: 0.05}]", 2,
         ["tank.baffles[0]: the gap to the lid is 0.06 m"]),
        ("size: [1.0, 0.6], lid: false, baffles: [{x: 0.5, bottom: 0.2, top: 0.54, thickness: 0.05}]", 2, []),
        ("size: [1.0, 0.6], baffles: [{z: 0.3, left: 0.0, right: 0.91, thickness: 0.05}]", 2,
         ["tank.baffles[0]: the gap to the wall is 0.09 m"]),
        ("size: [1, 1, 0.6], baffles: [{x: 0.5, bottom: 0, top: 0.4, thickness: 0.05, width: [0.08, 1.0]}]", 3,
         ["tank.baffles[0]: the gap to the wall is 0.08 m"]),
        ("size: [1.0, 0.6], baffles: [{x: 0.5, bottom: 0, top: 0.2, thickness: 0.05}, "
         "{x: 0.5, bottom: 0.25, top: 0.4, thickness: 0.05}]", 2,
         ["tank.baffles[1]: the gap to tank.baffles[0] (of 1 that are narrow) is 0.05 m wide or less, 1 spacings"]),
        ("size: [1.0, 0.6], baffles: [{x: 0.5, bottom: 0, top: 0.2, thickness: 0.05}, "
         "{x: 0.6, bottom: 0, top: 0.2, thickness: 0.05}]", 2,
         ["tank.baffles[1]: the gap to tank.baffles[0] (of 1 that are narrow) is 0.05 m"]),
        ("size: [1.0, 0.6], baffles: [{x: 0.5, bottom: 0.1, top: 0.5, thickness: 0.05}, "
         "{x: 0.65, bottom: 0, top: 0.2, thickness: 0.05}]", 2, []),
        ("size: [1, 1, 0.6], baffles: [{x: 0.5, ring: 0.27, thickness: 0.05}]", 3,
         ["tank.baffles[0].ring: the opening in the ring is 0.06 m"]),
        ("shape: prism, size: [1.0, 0.8], chamfer: {top: [0.46, 0.2]}", 2,
         ["tank.chamfer.top: the flat between the chamfers is 0.08 m"]),
        ("shape: prism, size: [1.0, 0.8], chamfer: {bottom: [0.5, 0.2]}", 2, []),
        ("shape: cylinder, size: [0.8, 0.8], baffles: [{x: 0.4, bottom: 0.06, top: 0.4, thickness: 0.05}]", 2,
         ["tank.baffles[0]: the gap to the floor is 0.06 m"]),
        ("shape: cylinder, size: [0.8, 0.8], baffles: [{x: 0.1, bottom: 0.06, top: 0.4, thickness: 0.05}]", 2, None),
    ],
)  # fmt: skip
def test_what_is_narrow_is_told(tank, dimension, found):
    cautions = narrow(tank, dimension)
    if found is None:  # there the plate goes into the round wall
        assert not any("floor" in caution for caution in cautions)
        return
    assert len(cautions) == len(found)
    assert all(caution.startswith(start) for caution, start in zip(cautions, found, strict=True))
    assert all("below 2 spacings" in caution for caution in cautions)


@pytest.mark.parametrize(("width", "found"), [(0.06, 1), (0.2, 0)])
def test_a_neck_of_a_surface_is_told(tmp_path, width, found):
    pytest.importorskip("manifold3d")
    neck = UNIT * [0.6, width, width] + [0.45, 0.25 - width / 2, 0.25 - width / 2]
    path = write(tmp_path / "tank.stl", 0.5 * UNIT, 0.5 * UNIT + [1.0, 0, 0], neck)
    tank = f"shape: stl, size: [1.5, 0.5, 0.5], surface: {path}"
    cautions = [caution for caution in narrow(tank) if "neck" in caution]
    assert len(cautions) == found
    assert np.all(["without which its 1 room(s) would be 2, is 0.1 m wide or less" in caution for caution in cautions])
