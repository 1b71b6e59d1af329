"""Liquid leaves walls where air can come in between, and follows them where none can."""

import numpy as np
import pytest

from parmps.kernels import separation

G = 9.81
BLOCK = """
dimension: 2
spacing: 0.02
gravity: 9.81
tank: {size: [3.22, 1.0], baffles: [{x: 0.744, bottom: 0.0, top: 0.161, thickness: 0.161}]}
fluids: [{name: water, region: {box: [[1.992, 0.0], [3.22, 0.55]]}}]
time: {end: 0.6}
"""
FLOOR = """
dimension: 2
spacing: 0.02
gravity: 9.81
tank: {size: [0.5, 0.4]}
fluids: [{name: water, depth: 0.2}]
motion: [{kind: file, path: FILE}]
time: {end: 0.1}
"""


def block_forces(sim):
    """Force on the block, N/m, and the least pressure on its top, Pa."""
    p = sim.particles
    walls = np.flatnonzero((p.kind[: p.rows] == 1) & (np.abs(p.position[: p.rows, 0] - 0.744) < 0.1))
    walls = walls[(p.position[walls, 2] > 0.0) & (p.position[walls, 2] < 0.17)]
    force = (-p.normal[walls] * p.pressure[walls, None] * sim.l0).sum(axis=0)
    return force, p.pressure[walls[p.normal[walls, 2] > 0.5]].min()


def test_a_jet_leaves_the_edge_of_a_block(start):
    """Nothing pulls the block towards the water, nor lifts it, and nothing drives the liquid.

    The jet of a dam break rises along the block and past its edge: a wall that held it there pulled with -65 kPa at
    this spacing.
    """
    sim = start(BLOCK)
    sim.start()
    mass = sim.particle_mass[0]
    lift = pull = top = impulse = 0.0
    energies = []
    while sim.time < 0.56:
        sim.choose_step(0.56)
        sim.solve()
        p = sim.particles
        force, least = block_forces(sim)
        pull, lift = pull + max(force[0], 0.0) * sim.dt, lift + max(force[2], 0.0) * sim.dt
        impulse += force[0] * sim.dt
        top = min(top, least)
        flow, height = p.velocity[: p.liquid], p.position[: p.liquid, 2]
        energies.append(mass * (0.5 * (flow**2).sum() + G * height.sum()))
        sim.move()
    assert impulse < -20.0  # the block is pushed: 900 N/m over 0.1 s and more
    assert pull < 0.01 * abs(impulse)
    assert lift < 0.01 * abs(impulse)
    assert top > -0.1 * 1000.0 * G * 0.55
    assert max(energies) < 1.002 * energies[0]


def test_liquid_follows_a_floor_that_falls_faster_than_it(start, tmp_path):
    """No air is at the floor: the air's pressure on the surface, which is the zero of the pressure, holds it there.

    The tank falls with 1.5 g. Liquid that came off the floor would be 8.8 mm above it after 0.06 s. The surface, which
    is then unstable (Rayleigh and Taylor), opens along the side walls: there is air.
    """
    record, time = tmp_path / "fall.csv", np.linspace(0.0, 0.12, 25)
    rows = [f"{t:.17g},{-0.75 * G * t * t:.17g}" for t in time]
    record.write_text("\n".join(["time [s],heave [m]", *rows]) + "\n")
    sim = start(FLOOR.replace("FILE", str(record)))
    before = sim.particles.position[: sim.particles.liquid, 2].mean()
    while sim.time < 0.06:
        sim.step(0.06)
    p = sim.particles
    assert p.position[: p.liquid, 2].mean() == pytest.approx(before, abs=0.1 * 8.8e-3)
    floor = np.flatnonzero((p.kind[: p.rows] == 1) & (p.normal[: p.rows, 2] > 0.9) & (p.position[: p.rows, 2] < 0.0))
    inner = floor[np.abs(p.position[floor, 0] - 0.25) < 0.15]
    assert p.pressure[inner] == pytest.approx(-0.5 * 1000.0 * G * 0.2, rel=0.15)
    assert not p.separated[inner].any()


def pair(pressure, speed, separated, surface=1, adhesion=0.0):
    """A wall particle below one of liquid, one spacing apart: what `let_go` makes of pressure and state."""
    position, velocity = np.array([[0.0, 0.0, 0.5], [0.0, 0.0, -0.5]]), np.array([[0.0, 0.0, speed], [0.0, 0.0, 0.0]])
    normal, kind = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0, 1], np.int8)
    flags, pressures = np.array([0, separated], np.int8), np.array([0.0, pressure])
    force = np.array([[0.0, 0.0, -2.0], [0.0, 0.0, 0.0]])
    first, last = np.array([0, 1, 2], np.uint32), np.array([1, 2], np.uint32)
    state = (position, velocity, normal, kind, np.array([surface, 0], np.int8), force, np.ones(1), np.zeros(2, np.int8))
    pairs = (first, last, np.array([1, 0], np.uint32), 1.0, 2.1, 1, 2)
    separation.let_go(*state, *pairs, np.array([adhesion]), pressures, flags)
    return flags[1], pressures[1]


def test_a_wall_lets_go_where_it_would_pull():
    """It pulls where its pressure, less the weight of the liquid above it (2 Pa here), is negative."""
    assert pair(2.01, 1.0, 0) == (0, 2.01)
    assert pair(1.99, 1.0, 0) == (1, 0.0)
    assert pair(-10.0, 1.0, 0, surface=0) == (0, -10.0)  # no air in reach
    assert pair(1.0, 1.0, 0, adhesion=1.5) == (0, 1.0)
    assert pair(0.0, 1.0, 0, adhesion=1.5) == (1, 0.0)


def test_liquid_that_comes_back_is_stopped():
    assert pair(0.0, 0.1, 1)[0] == 1
    assert pair(0.0, -0.1, 1)[0] == 0


def test_cut_links_have_no_weight():
    strength = np.array([1.0, 2.0, 3.0, 4.0], np.float32)
    pairs = [np.array(numbers, np.uint32) for numbers in ([0, 2, 3], [2, 3, 4], [1, 2, 0, 0])]
    separation.cut_links(*pairs, np.array([0, 0, 1], np.int8), strength)
    np.testing.assert_array_equal(strength, [1.0, 0.0, 3.0, 0.0])
