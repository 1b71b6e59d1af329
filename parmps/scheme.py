"""Numerical settings of the MPS scheme and the presets that bundle them.

Each setting is a field of :class:`Scheme`, declared once with its default, unit, range, meaning and source.
The defaults are the preset ``balanced``; another preset is the set of its differences from them.
Sources: [000] Wen & Wan, three-layer sloshing; [002] Chen & Wan 2019, LNG tank; [004] Zhang, Wan & Hino,
baffled tanks.
"""

from typing import Annotated, Literal

from pydantic import Field

from parmps.errors import InputError
from parmps.fields import Number, Section, nearest, setting, show

PRESETS = {
    "papers": {
        "wall": "line",
        "laplacian_radius": 4.01,
        "gradient": "sum",
        "position": "moved",
        "surface": "dirichlet",
        "gamma": 0.01,
        "collision_distance": 0.8,
        "volume_time": None,
        "courant": 0.2,
        "ksp_rtol": 1e-6,
    },
    "fast": {"courant": 0.6, "steady_step": 0.4},
    "balanced": {},
    "accurate": {"steady_step": 0.125},
}

PresetName = Literal["papers", "fast", "balanced", "accurate"]


class Scheme(Section):
    """The numerical method: which operators, how far they reach, how tightly the pressure is solved."""

    preset: PresetName = setting("preset that the settings not given here come from", default="balanced")
    wall: Literal["half", "line"] = setting(
        "wall particles half a spacing outside the wall (half), or on it (line; counted from [000], [004])",
        default="half",
    )
    radius: Number = setting(
        "reach of the number density, the gradient and the divergence; 2.1 in [002]", "l0", 2.1, ge=1.6, le=5
    )
    laplacian_radius: Number = setting(
        "reach of the Laplacian in the pressure equation; 4.01 in [002]", "l0", 2.1, ge=1.6, le=5
    )
    gradient: Literal["corrected", "sum", "min"] = setting(
        "pressure gradient: P_j - P_i with the inverse moment matrix (corrected; Duan 2018), "
        "P_j + P_i (sum; [002] eq. 5, [004] eq. 5) or P_j - P_min (min; [000] eq. 8); corrected goes with position "
        "start and surface ghost alone, sum with position moved: liquid at rest gains energy otherwise",
        default="corrected",
    )
    position: Literal["start", "moved"] = setting(
        "where the pressure equation is solved: at the step's start ([002] eqs. 15-18) or after the explicit "
        "move ([004]); the latter with steps of 0.1 l0 / sqrt(f h) at most, f h being the head of the liquid, "
        "without suction, and with several liquids as in [000]: smoothed density, surface tension as a force",
        default="start",
    )
    surface: Literal["ghost", "dirichlet"] = setting(
        "free surface: virtual particles of zero pressure on it (ghost; after Shibata 2015), or "
        "P = 0 on the surface particles (dirichlet; [004])",
        default="ghost",
    )
    gamma: Number = setting(
        "share of the density error in the pressure equation's source, per step (position moved); 0.01 in "
        "[000] eq. 9 and [002] eq. 11; 0.2 gives water at rest 6 % more energy in 0.1 s",
        default=0.01,
        ge=0,
        le=0.1,
    )
    overdensity: Number = setting(
        "number density, over n0, above which particles are pushed apart (position start)",
        default=1.06,
        ge=1,
        le=2,
    )
    separation: Number = setting(
        "how fast they are pushed apart: share of the excess density removed per (sqrt(f / l0) + u / l0) dt, f "
        "the body force and u the greatest speed (position start)",
        default=0.3,
        ge=0,
        le=10,
    )
    volume_time: Annotated[Number, Field(gt=0, le=1e3)] | None = setting(
        "longest relaxation time of the volume error, measured with a wide smooth weight, by the tank's longest side L "
        "and the body force f (position start); shorter in fast flow; null: none",
        "sqrt(L / f)",
        2.0,
    )
    volume_radius: Number = setting(
        "reach of the smooth weight that measures the volume error", "l0", 3.1, ge=2.6, le=5
    )
    shifting: Number = setting(
        "shifting of particles towards even spacing, over the asymmetry of their neighbours, per "
        "(sqrt(f / l0) + 1.5 u / l0) dt (position start; after Khayyer 2017)",
        default=0.6,
        ge=0,
        le=10,
    )
    damping: Number = setting(
        "damping of velocity differences that no linear field explains, per (sqrt(f / l0) + 0.2 u / l0) dt "
        "(position start)",
        default=1.1,
        ge=0,
        le=10,
    )
    predictor_limit: Number = setting(
        "greatest difference of the predicted pressure acceleration from the body force, over the body force; "
        "0 for no prediction (position start)",
        default=1.0,
        ge=0,
        le=100,
    )
    divergence_floor: Number = setting(
        "least eigenvalue of the moment matrices of the divergence", default=0.4, gt=0, le=1
    )
    gradient_floor: Number = setting(
        "least eigenvalue of the moment matrices of the pressure gradient", default=0.7, gt=0, le=1
    )
    collision_distance: Number = setting(
        "distance below which two particles that approach each other are stopped; 0 for never",
        "l0",
        0.5,
        ge=0,
        le=1,
    )
    courant: Number = setting(
        "Courant number where time.cfl gives none: greatest travel of a particle in one step", "l0", 0.4, gt=0, le=1
    )
    steady_step: Number = setting(
        "longest time step by the body force f; waves of length 2 l0 are unstable from 2 / sqrt(pi) = 1.1 on",
        "sqrt(l0 / f)",
        0.25,
        gt=0,
        le=1,
    )
    hierarchy_excess: Number = setting(
        "iterations beyond those with a fresh multigrid hierarchy, summed over steps, after which it is made anew; "
        "making it takes about as long",
        default=40,
        ge=0,
        le=1e6,
    )
    ksp_rtol: Number = setting(
        "relative tolerance of the linear solver for the pressure", default=1e-3, ge=1e-14, le=1e-1
    )


def expand_scheme(value):
    """Fill in the settings that a preset fixes.

    Parameters
    ----------
    value : str, dict or Scheme
        Preset name, or a mapping with an optional ``preset`` and any settings; settings win over the preset.

    Returns
    -------
    dict or Scheme
        Settings that are not defaults, not yet validated.

    Raises
    ------
    InputError
        The preset is unknown, or the value is neither a name nor a mapping.
    """
    if isinstance(value, Scheme):
        return value
    if isinstance(value, str):
        value = {"preset": value}
    if not isinstance(value, dict):
        raise InputError("scheme", f"got {show(value)}, must be a preset name or a mapping of settings")
    preset = value.get("preset", "balanced")
    if not isinstance(preset, str) or preset not in PRESETS:
        raise InputError(
            "scheme.preset", f"got {show(preset)}, no such preset{nearest(preset, list(PRESETS))}"
        )
    return {"preset": preset, **PRESETS[preset], **value}
