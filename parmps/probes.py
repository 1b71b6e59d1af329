"""The probes of a job: gauges (`parmps.gauges`), read at an instant, and loads (`parmps.loads`), taken step by step."""

from parmps.gauges import ElevationGauge, InterfaceGauge, LiquidProbe
from parmps.loads import ForceLoad, pressure_load


def build_probes(job, geometry):
    """Make the probes of a job.

    Parameters
    ----------
    job : Job
    geometry : Geometry

    Returns
    -------
    list
        Objects with ``columns``, the titles of their columns and what these are. Gauges have ``partial(state)`` that
        returns local sums as a 1-D float64 array of fixed length, and ``value(sums)`` that returns one value per
        column; for loads see `parmps.loads.Loads`.
    """
    names = [fluid.name for fluid in job.fluids]
    make = {
        "pressure": lambda probe, key: pressure_load(probe, geometry, key),
        "force": lambda probe, key: ForceLoad(probe, geometry, job.tank),
        "elevation": lambda probe, key: ElevationGauge(probe, geometry),
        "interface": lambda probe, key: InterfaceGauge(probe, geometry, names),
        "liquid": lambda probe, key: LiquidProbe(probe, geometry, names),
    }
    return [make[probe.kind](probe, f"probes[{number}]") for number, probe in enumerate(job.probes)]
