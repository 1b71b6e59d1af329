"""Some scenes of `make hunt`, and three layers in the papers' scheme, on all ranks and on one."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "jobs" / "hunt"))

import hunt
from scenes import make_scene

SEEDS = [2, 12]
"""A prism with a baffle, and a cylinder with tension."""


@pytest.mark.parametrize("seed", SEEDS)
def test_scenes(comm, shared_path, seed):
    scene = make_scene(seed)
    assert hunt.ranks_fault(scene, shared_path / "scene.yaml", comm) is None


def test_three_layers_in_the_papers_scheme(comm, shared_path, monkeypatch):
    """Dummies behind walls in the surface had a pressure or none by the sign of the solver's error."""
    monkeypatch.setattr(hunt, "SHORT", 26)
    scene = make_scene(3)
    tank = {"shape": "prism", "size": [0.6, 0.4], "chamfer": {"bottom": [0.1, 0.07], "top": [0.1, 0.07]}}
    layers = [
        {"name": name, "fill": fill, "density": density}
        for name, fill, density in (("a", 0.27, 1000.0), ("b", 0.25, 900.0), ("c", 0.17, 700.0))
    ]
    motion = [{"kind": "surge", "amplitude": 0.03, "omega": 8.0}, {"kind": "pitch", "amplitude_deg": 6.0, "omega": 7.0}]
    job = scene.job | {
        "dimension": 2, "spacing": 0.025, "tank": tank | {"baffles": []}, "fluids": layers, "motion": motion,
        "scheme": "papers", "probes": [], "time": {"end": 0.2},
    }  # fmt: skip
    assert hunt.ranks_fault(scene._replace(job=job), shared_path / "scene.yaml", comm) is None
