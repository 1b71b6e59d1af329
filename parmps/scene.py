"""The scene of a job: tank, liquids, motion, probes and output, as validated models.

The keys, units and meanings of a job file are declared here and nowhere else; :mod:`parmps.schema` prints
them. What involves several keys at once is checked by :mod:`parmps.checks`.
"""

import math
import os
from functools import cached_property, reduce
from operator import or_
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import BeforeValidator, Discriminator, Field, Tag, ValidationInfo, model_validator

from parmps.checks import check_job, layer_depths
from parmps.fields import TAG_MARK, Coordinate, FilePath, Length, Name, Number, Point, Section, setting
from parmps.scheme import PresetName, Scheme, expand_scheme

Angle = Annotated[Number, Field(ge=-360, le=360)]
Interval = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=2)]
Legs = Annotated[tuple[Length, ...], Field(min_length=2, max_length=2)]


def _resolved(path, info: ValidationInfo):
    """Make a path absolute: paths in a job are relative to the job file."""
    if not isinstance(path, str) or not path:
        return path
    file = (info.context or {}).get("file")
    base = file.parent if file else Path.cwd()
    return os.path.normpath(base / path)


InputPath = Annotated[FilePath, BeforeValidator(_resolved)]


def _paths(value, key, field=None):
    """Yield (dotted key, path) of every path in a section."""
    if isinstance(value, Section):
        for name, inner in type(value).model_fields.items():
            yield from _paths(getattr(value, name), f"{key}.{name}" if key else name, inner)
    elif isinstance(value, tuple):
        for number, item in enumerate(value):
            yield from _paths(item, f"{key}[{number}]")
    elif isinstance(value, str) and field is not None:
        optional = (item for part in get_args(field.annotation) for item in getattr(part, "__metadata__", ()))
        if any(getattr(item, "func", None) is _resolved for item in (*field.metadata, *optional)):
            yield key, value


def _union(*members):
    """Make a type that is one of several sections, told apart by their key ``kind``."""
    by_kind = {kind: TAG_MARK + model.__name__ for model in members for kind in model.kinds()}

    def tag_of(value):
        kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
        return by_kind.get(kind) if isinstance(kind, str) else None

    tagged = [Annotated[model, Tag(TAG_MARK + model.__name__)] for model in members]
    discriminator = Discriminator(
        tag_of,
        custom_error_type="kind",
        custom_error_message="must have a known kind",
    )
    return Annotated[reduce(or_, tagged), discriminator]


class Kind(Section):
    """A section that its key ``kind`` tells apart from others in the same place."""

    @classmethod
    def kinds(cls):
        """Values of ``kind`` that mean this section.

        Returns
        -------
        tuple of str
        """
        return get_args(cls.model_fields["kind"].annotation)


class Chamfer(Section):
    """Chamfered edges of a prism tank, in its cross-section: legs [horizontal, vertical]."""

    bottom: Legs | None = setting("legs of both lower chamfers: [horizontal, vertical]", "m", None)
    top: Legs | None = setting("legs of both upper chamfers: [horizontal, vertical]", "m", None)


Corner = Annotated[tuple[Coordinate, ...], Field(min_length=2, max_length=2)]
Opening = Annotated[tuple[Corner, ...], Field(min_length=2, max_length=2)]


class Baffle(Section):
    """A rigid plate: vertical (x, bottom, top), horizontal (z, left, right) or a ring (x or z, and ring)."""

    name: Name | None = setting(
        "name of its columns in probes.csv, as in load.NAME.Fx; null: baffle1 for the first, and so on", default=None
    )
    thickness: Length = setting("thickness of the plate", "m")
    x: Coordinate | None = setting("centre of a vertical baffle along the length", "m", None)
    bottom: Coordinate | None = setting("height of the lower edge of a vertical baffle", "m", None)
    top: Coordinate | None = setting("height of the upper edge of a vertical baffle", "m", None)
    z: Coordinate | None = setting("height of the centre of a horizontal baffle", "m", None)
    left: Coordinate | None = setting("left end of a horizontal baffle", "m", None)
    right: Coordinate | None = setting("right end of a horizontal baffle", "m", None)
    width: Interval | None = setting("extent [y0, y1] across a 3D tank; null: the full width", "m", None)

    ring: Length | None = setting(
        "width of a ring along the walls of a 3D box or prism, at x or at z: a plate as large as the box around the "
        "tank with one opening",
        "m",
        None,
    )
    openings: Annotated[tuple[Opening, ...], Field(max_length=50)] = setting(
        "openings of a plate in 3D: [[y0, z0], [y1, z1]] in a vertical one, [[x0, y0], [x1, y1]] in a horizontal one",
        "m",
        (),
    )

    @property
    def vertical(self):
        """Whether the plate stands (x, bottom, top) rather than lies (z, left, right)."""
        return self.x is not None


class Tank(Section):
    """The tank, with its origin at the inner bottom-left(-front) corner, x along the length, z up."""

    shape: Literal["box", "prism", "cylinder", "sphere", "stl"] = setting(
        "box; prism: a box with chamfered edges in its cross-section (x-z in 2D, y-z in 3D); cylinder: its "
        "cross-section is a circle, its length along x; sphere, in 3D; stl: a closed surface from a file, in 3D",
        default="box",
    )
    size: Annotated[tuple[Length, ...], Field(min_length=2, max_length=3)] = setting(
        "inner size: [length, height] in 2D, [length, width, height] in 3D; of a cylinder, a sphere or a surface "
        "that of the box around it",
        "m",
    )
    lid: bool = setting("whether the tank is closed at the top", default=True, strict=True)
    chamfer: Chamfer | None = setting("chamfers of a prism", default=None)
    surface: InputPath | None = setting(
        "STL file of a closed surface in m, relative to the job file; it is moved so that the box around it begins "
        "at the origin. Shells that overlap or touch are united; one inside another, turned the other way round, is "
        "a solid in the tank",
        default=None,
    )
    baffles: Annotated[tuple[Baffle, ...], Field(max_length=100)] = setting(
        "rigid plates inside the tank", default=()
    )

    @property
    def length(self):
        """Inner length along x, m."""
        return self.size[0]

    @property
    def height(self):
        """Inner height along z, m."""
        return self.size[-1]

    @property
    def baffle_names(self):
        """Names of the baffles, or baffle1 and so on for those without: list of str."""
        return [baffle.name or f"baffle{number}" for number, baffle in enumerate(self.baffles, start=1)]

    @property
    def bottom_centre(self):
        """Centre of the tank's bottom, m: a tuple of as many entries as there are dimensions."""
        return (*(side / 2 for side in self.size[:-1]), 0.0)


class Sphere(Section):
    """A disc (2D) or ball (3D)."""

    centre: Point = setting("centre: [x, z] in 2D, [x, y, z] in 3D", "m")
    radius: Length = setting("radius", "m")


class Region(Section):
    """The space that a liquid fills at the start: exactly one shape, cut off by chamfers and baffles."""

    box: Annotated[tuple[Point, ...], Field(min_length=2, max_length=2)] | None = setting(
        "box between two corners: [lowest coordinates, highest coordinates]", "m", None
    )
    disc: Sphere | None = setting("disc, in 2D", default=None)
    ball: Sphere | None = setting("ball, in 3D", default=None)


class Fluid(Section):
    """A liquid: its properties and the layer or region that it fills."""

    name: Name = setting("name that interfaces, probes and results refer to")
    depth: Length | None = setting(
        "thickness of the layer; layers lie on each other in the order given", "m", None
    )
    fill: Annotated[Number, Field(gt=0, le=1)] | None = setting(
        "share of the tank's volume that the layer fills, baffles not counted, instead of a depth", default=None
    )
    region: Region | None = setting("region filled, instead of a depth", default=None)
    density: Number = setting("density", "kg/m3", 1000.0, ge=1e-3, le=2e4)
    kinematic_viscosity: Number = setting("kinematic viscosity", "m2/s", 1.01e-6, ge=0, le=100)
    surface_tension: Number = setting("surface tension at the free surface", "N/m", 0.0, ge=0, le=100)


class Level(Kind):
    """Liquid at rest in the earth frame, its layers level there."""

    kind: Literal["level", "rest"] = setting(
        "liquid at rest; the surface of each layer is level on the earth, however the motion tilts the tank at the "
        "start, and has the volume below it that it has in the upright tank; rest means the same",
        default="level",
    )


class Upright(Kind):
    """Liquid at rest in the earth frame, as it would lie in the upright tank."""

    kind: Literal["upright"] = setting(
        "liquid at rest, its layers parallel to the bottom of the tank, even where the motion tilts it at the start"
    )


class StandingWave(Kind):
    """Flat surface with the velocity field of a linear standing wave along the length."""

    kind: Literal["standing_wave"] = setting("velocity field of a linear standing wave")
    mode: int = setting("number of half wavelengths along the tank", default=1, ge=1, le=1000, strict=True)
    amplitude: Number = setting(
        "amplitude that the wave will reach at the wall, where its elevation is greatest", "m", ge=-1e3, le=1e3
    )
    branch: int = setting(
        "which of the waves of this length, one a moving boundary of the layers: 1 is the fastest, that of the "
        "free surface",
        default=1,
        ge=1,
        le=20,
        strict=True,
    )


class UniformVelocity(Kind):
    """One fluid moving at a uniform velocity."""

    kind: Literal["velocity"] = setting("uniform velocity of one fluid")
    fluid: Name = setting("name of the fluid")
    value: Annotated[
        tuple[Annotated[Number, Field(ge=-1e3, le=1e3)], ...], Field(min_length=2, max_length=3)
    ] = setting("velocity: [x, z] in 2D, [x, y, z] in 3D", "m/s")


class InitialFile(Kind):
    """State read from an earlier result."""

    kind: Literal["file"] = setting("state read from a file")
    path: InputPath = setting("HDF5 file, relative to the job file")


Initial = _union(Level, Upright, StandingWave, UniformVelocity, InitialFile)


def _expand_kind(value):
    return {"kind": value} if isinstance(value, str) else value


class Interface(Section):
    """The interface between two fluids."""

    between: Annotated[tuple[Name, ...], Field(min_length=2, max_length=2)] = setting(
        "names of the two fluids"
    )
    surface_tension: Number = setting("interfacial tension", "N/m", 0.0, ge=0, le=100)
    wetting_angle: Number = setting(
        "static angle between the interface and walls, inside the first of the two fluids", "deg", 90.0, ge=30, le=150
    )


Omega = Annotated[
    Annotated[Number, Field(ge=0, le=1e4)] | None,
    setting("angular frequency (2 pi times the frequency in Hz), or else the period", "rad/s"),
]
Period = Annotated[
    Annotated[Number, Field(ge=1e-4, le=1e6)] | None, setting("period, instead of the angular frequency", "s")
]
Ramp = Annotated[
    Annotated[Number, Field(ge=0, le=1e6)],
    setting("time in which the motion grows smoothly from rest; 0: it starts with its full speed", "s"),
]


class Law(Kind):
    """A motion by a law of time."""

    @property
    def rate(self):
        """Angular frequency, rad/s."""
        return self.omega if self.period is None else 2.0 * math.pi / self.period


class Translation(Law):
    """Sinusoidal displacement along a tank-fixed axis: amplitude sin(omega t + phase)."""

    kind: Literal["surge", "sway", "heave"] = setting(
        "displacement along x (surge), y (sway) or z (heave); in 2D surge and sway are both along x"
    )
    amplitude: Number = setting("amplitude", "m", ge=-1e3, le=1e3)
    omega: Omega = None
    period: Period = None
    phase_deg: Angle = setting("phase at the start", "deg", 0.0)
    ramp: Ramp = 0.0


class Rotation(Law):
    """Sinusoidal turn about a centre: amplitude sin(omega t + phase)."""

    kind: Literal["roll", "pitch", "yaw"] = setting(
        "turn about x (roll), y (pitch, positive: right end down) or z (yaw); in 2D roll and pitch are both "
        "the in-plane turn, positive: right end down"
    )
    amplitude_deg: Angle = setting("amplitude", "deg")
    omega: Omega = None
    period: Period = None
    phase_deg: Angle = setting("phase at the start", "deg", 0.0)
    ramp: Ramp = 0.0
    centre: Point | None = setting(
        "centre of the turn, at rest; null: the bottom centre of the tank", "m", None
    )


class MotionFile(Kind):
    """Motion recorded in a file."""

    kind: Literal["file"] = setting("recorded motion")
    path: InputPath = setting(
        "text file, relative to the job file, with the columns time [s] and any of surge [m], sway [m], "
        "heave [m], roll [deg], pitch [deg], yaw [deg], or OpenFOAM's tabulated6DoFMotion"
    )
    start: Annotated[Number, Field(ge=-1e6, le=1e6)] | None = setting(
        "time in the record at which the run begins; null: its zero", "s", None
    )
    centre: Point | None = setting(
        "centre of the turns, at rest; null: the bottom centre of the tank", "m", None
    )


MotionItem = _union(Translation, Rotation, MotionFile)


class TimeControl(Section):
    """How long to run, and the limits of the time step."""

    end: Number = setting("simulated time at which the run ends", "s", gt=0, le=1e6)
    max_step: Annotated[Number, Field(gt=0, le=1e3)] | None = setting(
        "longest time step; null: only the stability limits", "s", None
    )
    cfl: Annotated[Number, Field(gt=0, le=1)] | None = setting(
        "Courant number: greatest travel of a particle in one step, in spacings; null: that of the scheme "
        "(scheme.courant)",
        "",
        None,
    )


class PressureProbe(Kind):
    """Pressure, averaged over an area around a point."""

    name: Name = setting("column name in probes.csv")
    kind: Literal["pressure"] = setting("pressure, averaged over an area around a point")
    at: Point = setting("position in the tank: [x, z] in 2D, [x, y, z] in 3D", "m")
    radius: Length | None = setting("radius of the averaging area; null: two spacings", "m", None)


class PanelProbe(Kind):
    """Mean pressure over a rectangle of a wall or a baffle."""

    name: Name = setting("column name in probes.csv")
    kind: Literal["panel"] = setting("mean pressure over a rectangle of a wall or a baffle")
    corners: Annotated[tuple[Point, ...], Field(min_length=2, max_length=2)] = setting(
        "opposite corners: [x, z] in 2D, [x, y, z] in 3D, on a wall or a face of a baffle at right angles to x, y or z",
        "m",
    )


Columns = Annotated[tuple[Coordinate, ...], Field(min_length=1, max_length=2)]


FixedTo = Annotated[
    Literal["tank", "earth"], setting("what the gauge stands on; on the earth, where it is in the tank at rest")
]


class ElevationProbe(Kind):
    """Height of the free surface above the tank bottom."""

    name: Name = setting("column name in probes.csv")
    kind: Literal["elevation"] = setting("height of the free surface above the tank bottom")
    at: Columns = setting("position of the gauge: [x] in 2D, [x, y] in 3D", "m")
    fixed_to: FixedTo = "tank"


class InterfaceProbe(Kind):
    """Height of the interface between two fluids above the tank bottom."""

    name: Name = setting("column name in probes.csv")
    kind: Literal["interface"] = setting("height of the interface between two fluids")
    between: Annotated[tuple[Name, ...], Field(min_length=2, max_length=2)] = setting(
        "names of the two fluids"
    )
    at: Columns = setting("position of the gauge: [x] in 2D, [x, y] in 3D", "m")
    fixed_to: FixedTo = "tank"


class LiquidProbe(Kind):
    """Volume, centre of mass and energy of one liquid, and its share that strayed into others."""

    name: Name = setting("column name in probes.csv")
    kind: Literal["liquid"] = setting(
        "volume, centre of mass and energy of one liquid, and its share that strayed into others"
    )
    fluid: Name = setting("name of the fluid")


class ForceProbe(Kind):
    """Force and moment of the liquid on the tank and its baffles, in all and one by one."""

    name: Name = setting("column name in probes.csv")
    kind: Literal["force"] = setting(
        "force and moment on the tank and its baffles, in all (NAME.Fx), on the tank alone (NAME.tank.Fx) and on each "
        "baffle (NAME.baffle1.Fx), by pressure and, where viscosity acts, by friction"
    )
    about: Point | None = setting(
        "point of the tank that moments are about: [x, z] in 2D, [x, y, z] in 3D; null: its bottom centre", "m", None
    )
    frame: Literal["tank", "earth"] = setting("whose axes the components are along", default="tank")


Probe = _union(PressureProbe, ElevationProbe, InterfaceProbe, LiquidProbe, ForceProbe, PanelProbe)

Every = Annotated[Number, Field(gt=0, le=1e6)]


class Output(Section):
    """Where results go and how often they are written."""

    directory: InputPath = setting(
        "directory of the results, relative to the job file; left out: out/ and the job file's name",
        default="out/job",
        validate_default=True,
    )
    particles_every: Every = setting("interval between particle snapshots", "s", 0.1)
    probes_every: Every = setting("interval between probe samples", "s", 0.005)
    checkpoint_every: Every = setting("interval between checkpoints", "s", 1.0)


class Job(Section):
    """A whole job file.

    Build one with :func:`parmps.loader.load_job`, which turns every mistake into an
    :class:`~parmps.errors.InputError`. Paths are made absolute on the way in, so that ``model_dump()`` gives
    plain data that ``Job.model_validate`` turns back into an equal job wherever it runs.

    Raises
    ------
    InputError
        Keys that are valid one by one contradict each other, or a file that they name is missing or wrong.
    """

    title: str = setting("what the job is about", default="", max_length=500)
    dimension: Literal[2, 3] = setting("number of space dimensions")
    spacing: Number = setting("initial particle spacing l0", "m", gt=0, le=1e3)
    gravity: Number = setting("gravitational acceleration", "m/s2", 9.8, ge=0, le=1e3)
    tank: Tank = setting("the tank")
    fluids: Annotated[tuple[Fluid, ...], Field(min_length=1, max_length=20)] = setting(
        "the liquids, bottom layer first"
    )
    initial: Annotated[
        Initial, BeforeValidator(_expand_kind, json_schema_input_type=Literal["level", "rest", "upright"] | Initial)
    ] = setting("state at the start; level is short for {kind: level}", default=Level())
    interfaces: Annotated[tuple[Interface, ...], Field(max_length=100)] = setting(
        "interfaces between fluids", default=()
    )
    motion: Annotated[tuple[MotionItem, ...], Field(max_length=100)] = setting(
        "motions of the tank, superposed", default=()
    )
    time: TimeControl = setting("duration and time step")
    scheme: Annotated[Scheme, BeforeValidator(expand_scheme, json_schema_input_type=PresetName | Scheme)] = (
        setting(
            "numerical settings: a preset name, or a mapping of a preset and single settings",
            default=Scheme(),
        )
    )
    probes: Annotated[tuple[Probe, ...], Field(max_length=1000)] = setting("measurements", default=())
    output: Output = setting("results", default_factory=dict, validate_default=True)

    @property
    def courant(self):
        """Courant number that bounds the time step."""
        return self.scheme.courant if self.time.cfl is None else self.time.cfl

    @cached_property
    def depths(self):
        """Thickness of each liquid's layer, m: tuple of float, None for a region."""
        return layer_depths(self)

    @property
    def full(self):
        """Whether layers of liquid, which regions displace, fill the tank to its lid: there is no free surface."""
        return self.tank.lid and sum(depth or 0.0 for depth in self.depths) > self.tank.height * (1.0 - 1e-9)

    @property
    def input_files(self):
        """Files that the job reads: dict of absolute path (str) by dotted key."""
        return {key: path for key, path in _paths(self, "") if not key.startswith("output.")}

    @model_validator(mode="before")
    @classmethod
    def _name_output_after_job_file(cls, data, info: ValidationInfo):
        file = (info.context or {}).get("file")
        if file is None or not isinstance(data, dict):
            return data
        output = {} if data.get("output") is None else data["output"]
        if not isinstance(output, dict) or "directory" in output:
            return data
        return {**data, "output": {**output, "directory": f"out/{file.stem}"}}

    @model_validator(mode="after")
    def _consistent(self):
        check_job(self)
        return self
