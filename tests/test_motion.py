"""The motion of the tank: rigid-body kinematics, body force against a point mass, laws."""

import numpy as np
import pytest

from parmps.motion import Motion
from parmps.scene import MotionFile, Rotation, Tank, Translation

GRAVITY = 9.8
TANK = Tank(size=(0.8, 0.4, 0.5))
TANK_2D = Tank(size=(0.8, 0.5))

SUPERPOSED = (
    Rotation(kind="yaw", amplitude_deg=20, omega=2.3, phase_deg=10, centre=(0.1, -0.2, 0.3)),
    Translation(kind="surge", amplitude=0.1, omega=3.1, phase_deg=30),
    Rotation(kind="pitch", amplitude_deg=12, omega=4.1, phase_deg=-50, centre=(0.7, 0.0, -0.1)),
    Rotation(kind="roll", amplitude_deg=25, omega=1.7, phase_deg=90),
    Translation(kind="heave", amplitude=0.05, omega=5.0),
    Translation(kind="sway", amplitude=0.07, omega=2.0),
    Rotation(kind="roll", amplitude_deg=8, omega=6.0, centre=(0.0, 0.5, 0.5)),
)


def body_force(state, position, velocity):
    """Body force per unit mass on a particle in the tank frame, as the solver applies it."""
    return (
        state.force
        - np.cross(state.alpha, position)
        - np.cross(state.omega, np.cross(state.omega, position))
        - 2 * np.cross(state.omega, velocity)
    )


def assert_free_fall(motion, duration=0.6):
    """A free point mass at rest in the earth frame, followed in the tank frame, falls straight down."""
    start = np.array([0.3, 0.1, 0.2])
    launch = np.array([0.4, -0.3, 1.0])
    first = motion.at(0.0)
    relative = motion.initial_velocity(start) + first.rotation.T @ launch

    def rate(t, y):
        return np.concatenate([y[3:], body_force(motion.at(t), y[:3], y[3:])])

    # classical Runge-Kutta, with steps that end where the pieces of a recorded spline do
    y, step = np.concatenate([start, relative]), 0.0025
    origin = first.origin + first.rotation @ start
    for t in step * np.arange(round(duration / step)):
        a = rate(t, y)
        b = rate(t + step / 2, y + step / 2 * a)
        c = rate(t + step / 2, y + step / 2 * b)
        d = rate(t + step * (1 - 1e-12), y + step * c)
        y = y + step / 6 * (a + 2 * b + 2 * c + d)
        state = motion.at(t + step)
        earth = state.origin + state.rotation @ y[:3]
        fall = np.array([0, 0, GRAVITY / 2 * (t + step) ** 2])
        np.testing.assert_allclose(earth, origin + launch * (t + step) - fall, atol=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_greatest_force_does_not_depend_on_where_the_origin_is(dimension):
    """A roll about one lower corner is the mirror image of that about the other."""
    tank = TANK_2D if dimension == 2 else TANK
    kind, axis = ("pitch", 0) if dimension == 2 else ("roll", 1)
    found = []
    for side, sign in ((0.0, 1.0), (1.0, -1.0)):
        centre = np.zeros(dimension)
        centre[axis] = side * tank.size[axis]
        turn = Rotation(kind=kind, amplitude_deg=sign * 20, omega=17, centre=tuple(centre))
        motion = Motion([turn], GRAVITY, dimension, tank)
        found.append(motion.at(0.03).greatest_force(motion.corners))
        points = np.random.default_rng(1).random((200, 3)) * np.abs(motion.corners).max(axis=0)
        assert np.linalg.norm(motion.at(0.03).force_at(points), axis=1).max() <= found[-1]
    assert found[0] == pytest.approx(found[1], rel=1e-12)


def write_csv(path, columns, end=2.0, rows=201, start=0.0):
    time = np.linspace(start, end, rows)
    table = np.column_stack([time, *(law(time) for law in columns.values())])
    np.savetxt(path, table, delimiter=",", header=",".join(["time [s]", *columns]), comments="", fmt="%.12g")
    return MotionFile(kind="file", path=str(path))


def test_free_fall_superposed():
    assert_free_fall(Motion(SUPERPOSED, GRAVITY, 3, TANK))


def test_free_fall_2d():
    items = (
        Translation(kind="surge", amplitude=0.1, omega=3.1, phase_deg=30),
        Rotation(kind="pitch", amplitude_deg=12, omega=4.1, phase_deg=-50, centre=(0.7, -0.1)),
        Rotation(kind="roll", amplitude_deg=12, omega=2.1),
    )
    motion = Motion(items, GRAVITY, 2, TANK_2D)
    assert_free_fall(motion)
    state = motion.at(0.7)
    assert state.omega[0] == state.omega[2] == state.force[1] == state.velocity[1] == 0.0


def test_free_fall_from_file(tmp_path):
    item = write_csv(
        tmp_path / "motion.csv",
        {
            "roll [deg]": lambda t: 10 * np.sin(2 * t + 0.3),
            "surge [m]": lambda t: 0.1 * np.sin(3 * t),
            "yaw [deg]": lambda t: 15 * np.cos(t),
            "heave [m]": lambda t: 0.05 * t**2,
        },
    )
    assert_free_fall(Motion((item, *SUPERPOSED[:2]), GRAVITY, 3, TANK))


@pytest.mark.parametrize("t", [0.1, 0.77, 3.0])
def test_derivatives_match_finite_differences(t):
    motion = Motion(SUPERPOSED, GRAVITY, 3, TANK)
    state, step = motion.at(t), 1e-4
    before, after = motion.at(t - step), motion.at(t + step)
    to_tank = state.rotation.T
    velocity = (after.origin - before.origin) / (2 * step)
    acceleration = (after.origin - 2 * state.origin + before.origin) / step**2
    spin = to_tank @ (after.rotation - before.rotation) / (2 * step)
    omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    np.testing.assert_allclose(state.velocity, to_tank @ velocity, atol=1e-6)
    np.testing.assert_allclose(state.force, to_tank @ ([0, 0, -GRAVITY] - acceleration), atol=1e-5)
    np.testing.assert_allclose(state.omega, omega, atol=1e-6)
    np.testing.assert_allclose(state.alpha, (after.omega - before.omega) / (2 * step), atol=1e-5)
    np.testing.assert_allclose(state.rotation @ to_tank, np.eye(3), atol=1e-14)


def test_positive_directions():
    """Positive pitch (and roll in 2D) lowers the right end; roll turns +y up; yaw turns +x to +y."""

    def moved(kind, point, dimension=3, tank=TANK):
        item = Rotation(kind=kind, amplitude_deg=10, omega=1, phase_deg=90, centre=(0.0,) * dimension)
        return Motion((item,), GRAVITY, dimension, tank).at(0.0).rotation @ point

    assert moved("pitch", [1, 0, 0])[2] < 0
    assert moved("roll", [0, 1, 0])[2] > 0
    assert moved("yaw", [1, 0, 0])[1] > 0
    for kind in ("roll", "pitch"):
        assert moved(kind, [1, 0, 0], 2, TANK_2D)[2] < 0


def test_tilted_gravity_pushes_to_the_low_end():
    motion = Motion((Rotation(kind="roll", amplitude_deg=30, omega=0, phase_deg=90),), GRAVITY, 2, TANK_2D)
    np.testing.assert_allclose(motion.at(1.0).force, [GRAVITY / 2, 0, -GRAVITY * np.sqrt(3) / 2])
    assert not motion.moves
    assert not motion.rotates


def test_default_centre_is_the_bottom_centre():
    for tank, dimension in ((TANK_2D, 2), (TANK, 3)):
        state = Motion((SUPERPOSED[3],), GRAVITY, dimension, tank).at(0.4)
        centre = np.array([0.4, 0.0 if dimension == 2 else 0.2, 0.0])
        np.testing.assert_allclose(state.origin + state.rotation @ centre, centre, atol=1e-15)


def test_without_motion():
    motion = Motion((), GRAVITY, 2, TANK_2D)
    state = motion.at(3.0)
    np.testing.assert_array_equal(state.force, [0, 0, -GRAVITY])
    np.testing.assert_array_equal(state.rotation, np.eye(3))
    assert not motion.moves
    assert not motion.rotates


def test_what_moves():
    surge = Motion(SUPERPOSED[1:2], GRAVITY, 3, TANK)
    assert surge.moves
    assert not surge.rotates
    assert Motion(SUPERPOSED[:1], GRAVITY, 3, TANK).rotates


def test_impulsive_start():
    motion = Motion((Translation(kind="surge", amplitude=0.02, omega=6.469),), GRAVITY, 2, TANK_2D)
    np.testing.assert_allclose(motion.initial_velocity(np.zeros((5, 3))), [[-0.02 * 6.469, 0, 0]] * 5)
    np.testing.assert_array_equal(motion.at(-1e-9).velocity, 0.0)
    roll = Motion((Rotation(kind="roll", amplitude_deg=3, omega=1.83),), GRAVITY, 2, TANK_2D)
    rate = np.radians(3) * 1.83
    np.testing.assert_allclose(roll.initial_velocity([0.4, 0.0, 0.5]), [-rate * 0.5, 0, 0], atol=1e-15)


def test_rest_before_the_start_keeps_the_first_displacement():
    state = Motion((SUPERPOSED[3],), GRAVITY, 3, TANK)
    np.testing.assert_allclose(state.at(-1.0).rotation, state.at(0.0).rotation)
    np.testing.assert_array_equal(state.at(-1.0).omega, 0.0)


def test_record_keeps_the_velocity_of_its_data(tmp_path):
    item = write_csv(tmp_path / "sine.csv", {"surge [m]": lambda t: 0.02 * np.sin(6 * t)})
    recorded = Motion((item,), GRAVITY, 2, TANK_2D)
    law = Motion((Translation(kind="surge", amplitude=0.02, omega=6),), GRAVITY, 2, TANK_2D)
    for t in (0.0, 0.333, 1.9):
        np.testing.assert_allclose(recorded.at(t).velocity, law.at(t).velocity, atol=2e-6)
        np.testing.assert_allclose(recorded.at(t).force, law.at(t).force, atol=2e-3)


def test_record_that_begins_late_sets_out_from_rest(tmp_path):
    item = write_csv(tmp_path / "late.csv", {"surge [m]": lambda t: 0.1 + 0.5 * (t - 1)}, start=1.0)
    motion = Motion((item,), GRAVITY, 2, TANK_2D)
    for t in (0.0, 0.9, 1.0):
        np.testing.assert_allclose(motion.at(t).origin, [0.1, 0, 0])
        np.testing.assert_allclose(motion.at(t).velocity, 0, atol=1e-12)
    np.testing.assert_allclose(motion.at(1.9).velocity, [0.5, 0, 0], atol=1e-4)


def test_openfoam_turns_first_roll_last_and_displaces_along_the_earth(tmp_path):
    """As its transformation does: p to Rx Ry Rz (p - c) + c + d, whatever else moves inside."""
    row = "({t} (({t} 0.2 {t}) (10 {a} 30)))\n"
    path = tmp_path / "motion.dat"
    path.write_text("(\n" + "".join(row.format(t=t / 10, a=t) for t in range(30)) + ")\n")
    centre, point = np.array([0.1, 0.2, 0.3]), np.array([0.5, -0.1, 0.2])
    item = MotionFile(kind="file", path=str(path), centre=tuple(centre))
    state = Motion((item,), GRAVITY, 3, TANK).at(1.7)
    x, y, z = np.radians([10, 17, 30])
    about_x = np.array([[1, 0, 0], [0, np.cos(x), -np.sin(x)], [0, np.sin(x), np.cos(x)]])
    about_y = np.array([[np.cos(y), 0, np.sin(y)], [0, 1, 0], [-np.sin(y), 0, np.cos(y)]])
    about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
    moved = about_x @ about_y @ about_z @ (point - centre) + centre + [1.7, 0.2, 1.7]
    np.testing.assert_allclose(state.origin + state.rotation @ point, moved, atol=1e-12)


def test_openfoam_table_with_other_motions(tmp_path):
    path = tmp_path / "motion.dat"
    row = "({:.4f} (({:.12f} {:.12f} {:.12f}) ({:.12f} {:.12f} {:.12f})))\n"
    times = np.arange(0, 1.01, 0.0025)
    path.write_text("(" + "".join(row.format(t, *(0.1 * np.sin(t * np.arange(1, 7)))) for t in times) + ")")
    item = MotionFile(kind="file", path=str(path), centre=(0.0, 0.1, 0.2))
    assert_free_fall(Motion((SUPERPOSED[0], item, SUPERPOSED[1]), GRAVITY, 3, TANK))


@pytest.mark.parametrize(("columns", "sign"), [("0 0 0.02) (0 3 0", -1.0), ("0 0 0.02) (3 0 0", 1.0)])
def test_openfoam_table_in_a_plane(tmp_path, columns, sign):
    """A turn about y lowers the right end, one about x raises it."""
    path = tmp_path / "motion.dat"
    path.write_text("(\n" + "".join(f"({t} (({columns})))\n" for t in range(5)) + ")\n")
    state = Motion((MotionFile(kind="file", path=str(path)),), GRAVITY, 2, TANK_2D).at(1.0)
    right = state.origin + state.rotation @ [0.8, 0.0, 0.0]
    assert right[2] == pytest.approx(0.02 + sign * 0.4 * np.sin(np.radians(3)))
    assert right[1] == 0.0


def test_sway_is_surge_in_2d():
    laws = [Translation(kind=kind, amplitude=0.1, omega=3.1, phase_deg=30) for kind in ("surge", "sway")]
    first, second = (Motion((law,), GRAVITY, 2, TANK_2D).at(0.7) for law in laws)
    for found, expected in zip(second, first, strict=True):
        np.testing.assert_array_equal(found, expected)


def test_period_instead_of_omega():
    by_period = Motion((Translation(kind="surge", amplitude=0.1, period=1.6),), GRAVITY, 2, TANK_2D)
    by_omega = Motion((Translation(kind="surge", amplitude=0.1, omega=2 * np.pi / 1.6),), GRAVITY, 2, TANK_2D)
    np.testing.assert_array_equal(by_period.at(0.9).force, by_omega.at(0.9).force)


def test_ramp_starts_from_rest_and_ends_in_the_law():
    law = {"kind": "roll", "amplitude_deg": 20, "omega": 4.0, "phase_deg": 50, "centre": (0.1, 0.2)}
    ramped, plain = (Motion((Rotation(**law, ramp=ramp),), GRAVITY, 2, TANK_2D) for ramp in (1.5, 0.0))
    first = ramped.at(0.0)
    np.testing.assert_array_equal(first.rotation, np.eye(3))
    assert not first.omega.any() and not first.alpha.any()
    np.testing.assert_array_equal(ramped.at(-1.0).rotation, np.eye(3))
    for found, expected in zip(ramped.at(1.5), plain.at(1.5), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(ramped.at(1.5 - 1e-9).alpha, plain.at(1.5).alpha, atol=1e-6)
    assert_free_fall(ramped)


def test_ramped_heel_moves():
    heel = {"kind": "roll", "amplitude_deg": 5, "omega": 0, "phase_deg": 90}
    assert Motion((Rotation(**heel, ramp=1.0),), GRAVITY, 2, TANK_2D).moves
    assert not Motion((Rotation(**heel),), GRAVITY, 2, TANK_2D).moves


def test_start_within_a_record(tmp_path):
    law = {"surge [m]": lambda t: 0.02 * np.sin(6 * (t - 12.5))}
    item = write_csv(tmp_path / "sine.csv", law, start=10.0, end=15.0, rows=1001)
    recorded = Motion((item.model_copy(update={"start": 12.5}),), GRAVITY, 2, TANK_2D)
    sine = Motion((Translation(kind="surge", amplitude=0.02, omega=6),), GRAVITY, 2, TANK_2D)
    for t in (-0.5, 0.0, 0.333, 2.4):
        np.testing.assert_allclose(recorded.at(t).velocity, sine.at(t).velocity, atol=1e-5)
        np.testing.assert_allclose(recorded.at(t).force, sine.at(t).force, atol=2e-3)


def test_a_rounded_record_that_begins_late_sets_out_from_rest(tmp_path):
    path = tmp_path / "late.csv"
    times = np.arange(1.0, 4.0, 0.005)
    np.savetxt(path, np.column_stack([times, 0.02 * np.sin(6 * (times - 1.0))]), "%.4f", ",",
               header="time [s],surge [m]", comments="")  # fmt: skip
    motion = Motion((MotionFile(kind="file", path=str(path)),), GRAVITY, 2, TANK_2D)
    steps = np.linspace(0.0, 3.9, 3901)
    velocity = np.array([motion.at(t).velocity[0] for t in steps])
    assert np.abs(velocity[steps < 0.9]).max() < 1e-4
    force = np.array([motion.at(t).force[0] for t in steps])
    # the liquid is given all of the tank's speed by the body force, none by a jump
    given = -np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(steps))])
    np.testing.assert_allclose(given, velocity, atol=1e-3)
    np.testing.assert_allclose(velocity[steps > 1.2], 0.12 * np.cos(6 * (steps[steps > 1.2] - 1)), atol=2e-3)


def test_extremes(tmp_path):
    law = {"surge [m]": lambda t: 0.02 * np.sin(6 * t)}
    items = (
        Rotation(kind="roll", amplitude_deg=10, omega=5.0, centre=(0.0, 0.0)),
        Translation(kind="heave", amplitude=0.1, period=2.0),
        write_csv(tmp_path / "sine.csv", law, rows=401),
    )
    roll, heave, surge = Motion(items, GRAVITY, 2, TANK_2D).parts
    # acceleration and centripetal acceleration are greatest a quarter of a period apart
    angle = np.radians(10)
    phase = np.linspace(0, np.pi / 2, 10_001)
    felt = 0.89**0.5 * angle * 25 * np.hypot(np.sin(phase), angle * np.cos(phase) ** 2).max()
    np.testing.assert_allclose(roll.extremes(10.0), [angle, angle * 5, angle * 25, felt], rtol=1e-5)
    np.testing.assert_allclose(heave.extremes(10.0), [0.1, 0.1 * np.pi, 0.1 * np.pi**2, 0.1 * np.pi**2], rtol=1e-5)
    np.testing.assert_allclose(surge.extremes(2.0), [0.02, 0.12, 0.72, 0.72], rtol=1e-3)
    # within the run alone
    np.testing.assert_allclose(heave.extremes(0.1)[0], 0.1 * np.sin(0.1 * np.pi), rtol=1e-6)
