"""Some scenes of `make hunt`, and that what looks at them would see what is wrong."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "jobs" / "hunt"))

import hunt
from scenes import make_scene

from parmps.errors import InputError
from parmps.loader import load_job

SEEDS = [0, 1, 2, 3, 4, 7, 8, 9, 10, 11, 12, 15, 18, 19, 20, 26, 28, 29, 35, 36]
CPU_SECONDS = 1.0


@pytest.mark.parametrize("seed", SEEDS)
def test_scenes(tmp_path, seed):
    verdict, why = hunt.examine(make_scene(seed), tmp_path, CPU_SECONDS)
    assert verdict == "holds", f"{make_scene(seed).description}: {why}"


def test_a_seed_makes_the_same_scene_and_others_make_others(tmp_path):
    texts = [make_scene(seed).write(tmp_path / str(seed)).read_text() for seed in range(20)]
    assert len(set(texts)) == 20
    assert texts == [make_scene(seed).write(tmp_path / str(seed)).read_text() for seed in range(20)]


def test_most_scenes_are_accepted(tmp_path):
    """Else the hunt would look at nothing; and all shapes and presets are among them."""
    accepted = []
    for seed in range(100):
        scene = make_scene(seed)
        try:
            accepted.append((scene, load_job(scene.write(tmp_path))))
        except InputError:
            continue
    assert len(accepted) > 80
    jobs = [job for _, job in accepted]
    assert {job.tank.shape for job in jobs} == {"box", "prism", "cylinder", "sphere", "stl"}
    assert {job.scheme.preset for job in jobs} == {"papers", "fast", "balanced", "accurate"}
    assert {probe.kind for job in jobs for probe in job.probes} == {
        "pressure", "elevation", "interface", "liquid", "force"
    }  # fmt: skip
    assert {len(job.fluids) for job in jobs} == {1, 2, 3}
    assert sum(scene.still for scene, _ in accepted) > 8


def test_mirrored_twice_is_the_same():
    for seed in range(40):
        scene = make_scene(seed)
        twice = hunt.mirrored(scene._replace(job=hunt.mirrored(scene)))
        assert _rounded(twice) == _rounded(scene.job)


def _rounded(data):
    """Plain data with its numbers rounded, since L - (L - x) is not x."""
    if isinstance(data, dict):
        return {key: _rounded(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_rounded(value) for value in data]
    return round(data, 9) + 0.0 if isinstance(data, float) else data


def test_faults_are_seen(tmp_path, start, monkeypatch):
    """An asymmetric job mirrored wrongly, energy from nowhere, volume, waves in a still tank, wrong pressure."""
    stills = (s for s in map(make_scene, range(100)) if s.still and not s.job["tank"]["baffles"])
    scene = next(s for s in stills if s.job["tank"]["shape"] == "box")
    path = scene.write(tmp_path)
    sim = start(path)
    while sim.time < 1.1 * hunt.STILL_AFTER:
        sim.step(1.1 * hunt.STILL_AFTER)

    def look():
        worst = {"energy": 0.0, "volume": 0.0, "speed": 0.0, "pressure": 0.0}
        return hunt.look(sim, scene, worst, hunt.surface_energy(sim), hunt.volume(sim))

    assert look() is None
    sim.particles.pressure *= 1.1
    assert "hydrostatic" in look()
    sim.particles.velocity[: sim.particles.liquid, 0] += 0.05
    assert "still liquid moves" in look() or "energy" in look()
    sim.particles.position[0, 2] = np.nan
    assert look() == "not finite"
    law = {"kind": "surge", "amplitude": 0.02, "omega": 5.0, "phase_deg": 0.0}
    moving = scene._replace(job=scene.job | {"motion": [law]})
    assert hunt.mirror_fault(moving, path) is None
    monkeypatch.setattr(hunt, "mirrored", lambda scene: scene.job)
    assert "mirrored" in hunt.mirror_fault(moving, path)
