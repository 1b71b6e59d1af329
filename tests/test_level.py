"""Tanks that are tilted at the start: where the liquid stands, against exact geometry, and that it rests."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial import cKDTree

from parmps.errors import InputError
from parmps.kernels.walls import distances
from parmps.loader import parse_job
from parmps.motion import Motion
from parmps.particles import FLUID
from parmps.probes import build_probes
from parmps.run import Schedule
from parmps.tank import place

BASE = """
dimension: 2
spacing: 0.05
tank: {size: [1.0, 0.6]}
fluids: [{name: water, depth: 0.3}]
motion: [{kind: pitch, amplitude_deg: 5, omega: 0, phase_deg: 90}]
time: {end: 2.0}
"""
PITCH = "motion[0].amplitude_deg={}"


def placed(*overrides, wall="half"):
    """Liquid of a job, and the direction against gravity in its tank."""
    job = parse_job(BASE, overrides)
    up = Motion(job.motion, job.gravity, job.dimension, job.tank).at(0.0).rotation[2]
    p = place(job, wall)
    liquid = p.kind == FLUID
    assert distances(p.position[liquid], p.geometry.walls)[0].min() > 0.1 * p.spacing
    assert cKDTree(p.position[liquid]).query(p.position[liquid], 2)[0][:, 1].min() > 0.5 * p.spacing
    return p, liquid, up


def seen(sim):
    """What gauges see of a simulation."""
    p = sim.particles
    names = ("position", "velocity", "pressure", "kind", "fluid", "normal", "depth")
    arrays = {name: getattr(p, name)[: p.owned] for name in names}
    return SimpleNamespace(**arrays, surface=sim.work.surface[: p.owned], spacing=sim.l0, frame=sim.frame)


def box_level(depth, degrees, length=1.0, height=0.6):
    """Height of the level surface in the middle of a box, by the area below it; it may meet floor and lid."""
    x = np.linspace(-0.5, 0.5, 20001) * length
    slope = math.tan(math.radians(degrees))

    def surplus(middle):
        return np.trapz(np.clip(middle + slope * x, 0.0, height), x) - depth * length

    return brentq(surplus, -10.0, 10.0)


@pytest.mark.parametrize(
    ("degrees", "depth"), [(1, 0.3), (-5, 0.3), (20, 0.3), (45, 0.3), (20, 0.1), (45, 0.1), (20, 0.5)]
)
def test_the_uppermost_row_is_parallel_to_the_level_surface(degrees, depth):
    p, liquid, up = placed(PITCH.format(degrees), f"fluids[0].depth={depth}", "spacing=0.025")
    height = p.position[liquid] @ up
    surface = np.array([0.5, 0.0, box_level(depth, degrees)]) @ up
    assert height.max() + 0.5 * p.spacing == pytest.approx(surface, abs=0.03 * p.spacing)
    x = np.linspace(0.0, 1.0, 1001)
    line = box_level(depth, degrees) + math.tan(math.radians(degrees)) * (x - 0.5)
    length = np.mean((line > 0.0) & (line < 0.6)) / math.cos(math.radians(degrees))
    assert np.count_nonzero(height > height.max() - 1e-9) == pytest.approx(length / p.spacing, abs=4)
    assert p.volume.sum() == pytest.approx(depth, rel=1e-12)
    assert p.total_fluid == pytest.approx(depth / p.spacing**2, abs=1)


def test_each_layer_is_level_and_has_its_volume():
    p, liquid, up = placed(
        PITCH.format(10), "fluids=[{name: a, depth: 0.15}, {name: b, depth: 0.25, density: 800}]", "spacing=0.025"
    )
    height, fluid = p.position[liquid] @ up, p.fluid[liquid]
    for number, (depth, level) in enumerate([(0.15, 0.15), (0.25, 0.4)]):
        assert p.volume[liquid][fluid == number].sum() == pytest.approx(depth, rel=1e-12)
        top = np.array([0.5, 0.0, box_level(level, 10)]) @ up
        assert height[fluid == number].max() < top < height[fluid == number].max() + 0.6 * p.spacing
    assert height[fluid == 1].min() > height[fluid == 0].max() + 0.8 * p.spacing


def test_spaces_that_a_bulkhead_parts_keep_their_volumes():
    bulkhead = "tank.baffles=[{x: 0.4, bottom: 0, top: 0.6, thickness: 0.04}]"
    p, liquid, up = placed(PITCH.format(10), bulkhead, "spacing=0.02")
    position = p.position[liquid]
    for low, high in ((0.0, 0.38), (0.42, 1.0)):
        inside = position[(position[:, 0] > low) & (position[:, 0] < high)]
        surface = np.array([(low + high) / 2, 0.0, box_level(0.3, 10, high - low)]) @ up
        assert (inside @ up).max() + 0.5 * p.spacing == pytest.approx(surface, abs=0.03 * p.spacing)
        assert len(inside) * p.spacing**2 == pytest.approx(0.3 * (high - low), abs=p.spacing**2)


@pytest.mark.parametrize("degrees", [15, 60, 120])
def test_a_circle_is_as_full_whatever_its_turn(degrees):
    p, liquid, up = placed(
        PITCH.format(degrees), "tank={shape: cylinder, size: [0.6, 0.6]}", "fluids[0].depth=0.2", "spacing=0.02"
    )
    half = math.acos(1.0 / 3.0)  # of the segment below 0.2 m
    surface = np.array([0.3, 0.0, 0.3]) @ up - 0.1
    assert (p.position[liquid] @ up).max() + 0.5 * p.spacing == pytest.approx(surface, abs=0.03 * p.spacing)
    assert p.volume.sum() == pytest.approx(0.09 * (half - math.sin(2 * half) / 2), rel=1e-9)


@pytest.mark.parametrize(
    ("kinds", "tank"),
    [
        (("roll", "pitch"), "{size: [1.0, 0.5, 0.6]}"),
        (("pitch",), "{shape: cylinder, size: [1.0, 0.6, 0.6]}"),
        (("roll",), "{shape: sphere, size: [0.6, 0.6, 0.6]}"),
    ],
)
def test_half_full_tanks_in_3d_are_level_about_their_centre(kinds, tank):
    turns = ", ".join(f"{{kind: {kind}, amplitude_deg: 7, omega: 0, phase_deg: 90}}" for kind in kinds)
    p, liquid, up = placed("dimension=3", f"tank={tank}", f"motion=[{turns}]", "spacing=0.1")
    high = p.geometry.walls.container[1] / 2
    height = p.position[liquid] @ up
    assert height.max() + 0.5 * p.spacing == pytest.approx(high @ up, abs=0.03 * p.spacing)


def test_upright_tanks_start_on_their_lattice():
    upright = placed("motion=[]")[0]
    accelerating = "motion=[{kind: surge, amplitude: 0.1, omega: 5, phase_deg: 90}]"
    for overrides in (["initial=upright"], [accelerating], ["gravity=0"], [PITCH.format(0)]):
        assert np.array_equal(placed(*overrides)[0].position, upright.position)
    assert np.array_equal(placed("initial=rest")[0].position, placed()[0].position)


def test_shares_are_those_of_the_whole():
    job = parse_job(BASE)
    whole = place(job, "half")
    parts = [place(job, "half", part, 3) for part in range(3)]
    assert np.array_equal(np.concatenate([part.position for part in parts]), whole.position)


def test_a_mirrored_tilt_starts_mirrored():
    (p, liquid, _), (q, _, _) = placed(PITCH.format(7)), placed(PITCH.format(-7))
    mirrored = q.position[liquid] * [-1.0, 1.0, 1.0] + [1.0, 0.0, 0.0]
    assert cKDTree(mirrored).query(p.position[liquid])[0].max() < 1e-9


def test_what_cannot_start_level_is_refused():
    with pytest.raises(InputError, match=r"motion: the tank is tilted by 45 deg .* above the rim"):
        placed(PITCH.format(45), "tank.lid=false")
    with pytest.raises(InputError, match=r"initial.kind: a standing wave needs a tank that is upright"):
        parse_job(BASE, ["initial={kind: standing_wave, amplitude: 0.01}"])


@pytest.mark.parametrize("degrees", [1, 5, 20])
def test_level_liquid_rests(start, degrees):
    gauges = "probes=[{name: a, kind: elevation, at: [0.05]}, {name: b, kind: elevation, at: [0.9]}]"
    sim = start(BASE, PITCH.format(degrees), gauges)
    slope, schedule = math.tan(math.radians(degrees)), Schedule(0.02, 0.3)
    probes, bound = build_probes(sim.job, sim.geometry), 0.01 * math.sqrt(9.8 * 0.3)
    sim.start()
    while sim.time < 0.3:
        sim.choose_step(schedule.after(sim.time))
        sim.solve()
        assert np.abs(sim.particles.velocity).max() < bound
        for probe, x in zip(probes, (0.05, 0.9), strict=True):
            level = probe.value(probe.partial(seen(sim)))[0]
            assert level == pytest.approx(0.3 + (x - 0.5) * slope, abs=0.1 * sim.l0)
        sim.move()
