"""A run: the time loop of a simulation with its probes, results, checkpoints and messages."""

import contextlib
import math
import os
import platform
import resource
import sys
import time as clock
from pathlib import Path
from types import SimpleNamespace

import h5py
import numba
import numpy as np
from numba.core.event import install_listener

import parmps
from parmps import checkpoint
from parmps.cautions import cautions
from parmps.continuation import Inputs, check_arrays, check_attributes, check_particles
from parmps.errors import BeyondLimits, DivergedError, OutputError, ParmpsError, StoppedError
from parmps.interrupt import Interrupt, reason
from parmps.loader import job_text
from parmps.lock import DirectoryLock
from parmps.output import ParticleFile, prepare_directory, write_json
from parmps.particles import FIELDS, FLUID
from parmps.planning import needs
from parmps.pressure import petsc_version, unused_options
from parmps.probes import build_probes
from parmps.report import Compilation, RunLog, advice, command_line, timer_table
from parmps.samples import Samples
from parmps.simulation import COUNTERS, SUMMED, Simulation
from parmps.stages import wall_friction
from parmps.table import ProbeTable, kept_lines


class Schedule:
    """Times at which something is due: the multiples of an interval, and the end of the run.

    Parameters
    ----------
    every, end : float
        Interval and end of the run, s.
    """

    def __init__(self, every, end):
        self.every, self.end = every, end

    def due(self, time):
        """Whether something is due at this time, in s."""
        return time >= self.end or time == self._multiple(round(time / self.every))

    def after(self, time):
        """The next time due after this one, in s; past the end, the run's pace goes on."""
        if time >= self.end:
            return time + self.every
        number = math.floor(time / self.every)
        while self._multiple(number) <= time:
            number += 1
        return min(self._multiple(number), self.end)

    def _multiple(self, number):
        """A multiple of the interval, rounded so that 6 x 0.1 s, 120 x 0.005 s and an end of 0.6 s are one instant."""
        time, end = float(f"{number * self.every:.12g}"), float(f"{self.end:.12g}")
        return self.end if time == end else time

    def count(self, time):
        """Number of times due from a time, in s, to the end, both included."""
        number, last = math.floor(time / self.every), math.floor(self.end / self.every) - 1
        while self._multiple(number) < time:
            number += 1
        while self._multiple(last) < self.end:
            last += 1
        return max(last - number, 0) + 1


class Run:
    """One run of a job into a directory.

    Parameters
    ----------
    job : Job
    domain : Domain
    directory : path-like
        Where results go.
    restart : path-like, optional
        Directory of the run to continue. Where it is ``directory``, its results are continued in place; elsewhere new
        ones begin at the time of its checkpoint.
    interrupt : Interrupt, optional
        Tells when to stop before the end; never by default.

    Raises
    ------
    InputError, OutputError
        On all ranks.
    """

    def __init__(self, job, domain, directory, restart=None, interrupt=None):
        self.job, self.domain, self.interrupt = job, domain, interrupt or Interrupt()
        self.directory = Path(directory)
        self.main = domain.rank == 0
        self._lock = None
        self.warnings = cautions(job) if self.main else []
        self.simulation = Simulation(job, domain)
        self.inputs = self._on_main(lambda: Inputs(job))
        end, out = job.time.end, job.output
        self.schedule = Schedule(out.probes_every, end)
        self.frames = Schedule(out.particles_every, end)
        self.saves = Schedule(out.checkpoint_every, end)
        probes = build_probes(job, self.simulation.geometry)
        viscous = "viscosity" in self.simulation.seconds
        self.samples = Samples(probes, domain, self.simulation.particles, self.schedule, viscous)
        in_place = restart is not None and self.directory.resolve() == Path(restart).resolve()
        try:
            self._begin(restart, in_place)
        except ParmpsError:
            self._release()
            raise

    def _begin(self, restart, in_place):
        if in_place:
            self._hold()
        if restart is not None:
            self._read_checkpoint(Path(restart) / "checkpoint.h5")
        if not in_place:  # a checkpoint that is refused leaves no directory behind
            self._hold()
        self._on_main(lambda: prepare_directory(self.directory, in_place))
        self._open_results(in_place)
        self.log = self._on_main(lambda: RunLog(self.directory / "run.log", _watched()))
        self._first_step = self.simulation.step_number
        self._compilation = Compilation(self.log.line if self.main else None)
        self._seconds_of_results = 0.0
        self._keep()

    def _hold(self):
        """Take the directory, which another run may have."""
        self._lock = self._on_main(lambda: DirectoryLock(self.directory))

    def _release(self):
        if self._lock is not None:
            self._lock.close()

    def _on_main(self, action):
        """Do something on rank 0 alone; its error, if any, is raised on all ranks."""
        result = error = None
        if self.main:
            try:
                result = action()
            except ParmpsError as problem:
                error = problem
        error = self.domain.share(error)
        if error is not None:
            raise error
        return result

    def _everywhere(self, action):
        """Do something on every rank; an error of any rank is raised on all."""
        result = error = None
        try:
            result = action()
        except ParmpsError as problem:
            error = problem
        errors = [e for e in self.domain.gather(error) if e is not None]
        if errors:
            raise errors[0]
        return result

    # Results

    def _open_results(self, in_place):
        columns, began = list(self.samples.columns), self.simulation.time
        if not in_place and self.samples.sampled != began:
            self.samples.forget_row()
        table, path = self.directory / "probes.csv", self.directory / "particles.vtkhdf"
        total, frames = self.simulation.totals["total"], self.frames.count(began)

        def begin():
            if in_place:
                lines = kept_lines(table, columns, self._results["table"])
                self.frame = ParticleFile.resume(path, total, frames, self._results["particles"])
                return ProbeTable(table, columns, lines)
            self.frame = 0
            texts = {"job": job_text(self.job), "version": parmps.__version__}
            ParticleFile.create(path, total, frames, texts)
            return ProbeTable(table, columns)

        self.table = self._on_main(begin)
        self.frame = self.domain.share(self.frame if self.main else None)
        self.particle_file = self._everywhere(lambda: ParticleFile(path))

    def _keep(self):
        """Keep the state and what is in the results, to come back to if the solution goes wrong."""
        self._good = self.simulation.snapshot(), self.samples.state(), self._mark()

    def _mark(self):
        """What is in the results, for a checkpoint of rank 0, which writes them."""
        return {"table": self.table.mark(), "particles": self.particle_file.mark()} if self.main else None

    def _state(self):
        """What gauges see: the rank's own particles."""
        s, p = self.simulation, self.simulation.particles
        own = slice(0, p.owned)
        return SimpleNamespace(
            **{name: getattr(p, name)[own] for name in ("position", "velocity", "kind", "fluid", "compression")},
            surface=s.work.surface[own],
            frame=s.frame,
            density=s.liquids.density[p.fluid[own]],
            volume=(s.particle_mass / s.liquids.density)[p.fluid[own]],
            fraction=s.fraction[own],
        )

    def _measure(self):
        """Let the probes see the step, and write the rows of samples that are whole then."""
        s = self.simulation
        if s.step_number > 0 or s.scheme.position == "start":  # the papers' first step brings the first pressure
            friction = wall_friction(s) if self.samples.loads.friction else None
            self.samples.step(s.time, s.particles, s.liquids.density, s.frame, friction)
        if not self.schedule.due(s.time):
            return
        s.note_energy()
        self._write_rows(self.samples.take(s.time, self._state()))
        self._keep()

    def _write_rows(self, rows):
        for row in rows:
            self._on_main(lambda row=row: self.table.write(*row))

    def _write_frame(self):
        s, p = self.simulation, self.simulation.particles
        own = slice(0, p.owned)
        arrays = {name: getattr(p, name)[own] for name in ("position", "id", "fluid", "velocity", "pressure")}
        arrays["type"], arrays["surface"] = p.kind[own], s.work.surface[own]
        start = self.domain.first_of(p.owned)
        self._everywhere(lambda: self.particle_file.write(self.frame, start, arrays))
        self._on_main(lambda: self.particle_file.commit(self.frame, s.time))
        self.frame += 1

    # Checkpoints

    def _save(self, results):
        """Write a checkpoint with what was in the results then, and forget what a restart from it could not know."""
        s, p = self.simulation, self.simulation.particles
        path = self.directory / "checkpoint.h5"
        self.samples.flush()
        ends = np.cumsum(self.domain.gather(p.owned)).tolist()
        slabs = list(zip([0, *ends[:-1]], ends, strict=True))
        s.ledger.settle(self.domain)
        counters = {name: getattr(s, name) for name in COUNTERS}
        counters |= {name: self.domain.sum(counters[name]) for name in SUMMED}
        attributes = {
            "job": self.job.model_dump(mode="json"),
            "version": parmps.__version__,
            "inputs": self.inputs.until(s.time) if self.main else {},
            "results": results,
            "counters": counters,
            "samples": self.samples.state(),
            "left": [item for part in self.domain.gather(s.left) for item in part],
            "ledger": s.ledger.state,
        }
        self._on_main(lambda: self.table.sync())
        self._everywhere(self.particle_file.sync)
        self._on_main(lambda: checkpoint.create(path, FIELDS, s.totals["total"], slabs, attributes))
        arrays = {name: np.ascontiguousarray(a) for name, a in p.arrays().items()}
        try:
            self._everywhere(lambda: checkpoint.write_slab(path, self.domain.rank, arrays))
            self._on_main(lambda: checkpoint.commit(path))
        except OutputError:
            self._on_main(lambda: checkpoint.discard(path))
            raise
        s.distribute()

    def _read_checkpoint(self, path):
        s, domain = self.simulation, self.domain
        header = self._everywhere(lambda: checkpoint.read_header(path))
        job, counters = self.job.model_dump(mode="json"), {name: getattr(s, name) for name in COUNTERS}
        self._on_main(lambda: check_attributes(path, header, job, parmps.__version__, self.inputs, counters))

        def read():
            check_arrays(path, header, s.totals)
            arrays = checkpoint.read_slabs(path, checkpoint.share_slabs(len(header.slabs), domain.size, domain.rank))
            check_particles(path, arrays, s.totals, self.job)
            return arrays

        arrays = self._everywhere(read)
        if domain.sum(int(arrays["id"].sum())) != header.total * (header.total - 1) // 2:
            raise OutputError(path, "is damaged: some of its particles are there twice")
        self._results = header.attributes["results"]
        counters, left = dict(header.attributes["counters"]), header.attributes["left"]
        if not self.main:
            counters |= {name: type(counters[name])(0) for name in SUMMED}
            left = []
        self.samples.restore(header.attributes["samples"])
        s.restore({"counters": counters, "arrays": arrays, "left": left, "ledger": header.attributes["ledger"]})

    # The loop

    def go(self):
        """Run to the end of the job.

        Raises
        ------
        DivergedError
            On all ranks, after a checkpoint of the last good state.
        StoppedError
            On all ranks, after a checkpoint of the present state.
        BeyondLimits
            On all ranks, after all results.
        OutputError
            On all ranks.
        """
        s, job = self.simulation, self.job
        if self.main:
            self._greet()
            self.log.start(s.time, job.time.end)
        self.domain.barrier()
        start = clock.perf_counter(), clock.process_time()
        try:
            with install_listener("numba:compile", self._compilation):
                self._loop()
            self._finish("done", start)
            if s.ledger.warnings():
                raise BeyondLimits("; ".join(s.ledger.warnings()))
        except StoppedError as end:
            self._save(self._mark())
            self._write_rows(self.samples.rows())
            self._finish(str(end), start)
            raise
        except DivergedError as error:
            # a checkpoint of the last sample, from before the solution went wrong
            state, samples, results = self._good
            s.restore(state)
            self.samples.restore(samples)
            self._save(results)
            self._write_rows(self.samples.rows())
            self._finish(f"diverged: {error}", start)
            raise

    def _loop(self):
        s, end = self.simulation, self.job.time.end
        schedules = (self.schedule, self.frames, self.saves)
        s.start()
        began = s.time
        while True:
            if self.saves.due(s.time) and s.time > began:
                with self._writing():
                    self._save(self._mark())
            s.balance()
            request = s.choose_step(min(schedule.after(s.time) for schedule in schedules), self.interrupt.request())
            if request and s.time < end:
                raise StoppedError(f"stopped by {reason(request)} at t = {s.time:g} s, step {s.step_number}")
            s.solve()
            with self._writing():
                self._measure()
                if self.frames.due(s.time):
                    self._write_frame()
            if s.time >= end:
                self._write_rows(self.samples.rows())
                break
            s.move()
            if self.main:
                if s.step_number == self._first_step + 1:
                    self._tell_unused_options()
                self.log.progress(s.time, s.step_number, s.dt, s.solver.iterations)

    @contextlib.contextmanager
    def _writing(self):
        """Count the time that results take."""
        start = clock.perf_counter()
        yield
        self._seconds_of_results += clock.perf_counter() - start

    def _greet(self):
        s, line = self.simulation, self.log.line
        line(f"parmps {parmps.__version__}: {self.job.title or 'untitled job'}")
        line(
            f"{s.totals['fluid']} fluid and {s.totals['total'] - s.totals['fluid']} boundary particles, "
            f"spacing {s.l0:g} m, {self.domain.size} rank(s), scheme {self.job.scheme.preset}"
        )
        memory, disk = needs(self.job, self.domain.size)
        line(f"about {memory / 1e6:.3g} MB of memory a rank and {sum(disk.values()) / 1e6:.3g} MB of disk")
        if not self._lock.holds:
            line(f"The file system of {self.directory} has no locks: nothing keeps another run from writing there too.")
        for warning in self.warnings:  # which the command line has shown before it placed the particles
            self.log.note(f"warning: {warning}")

    def _tell_unused_options(self):
        """Say which options of the solvers none of them knows, once they have solved; for one process only."""
        for option in unused_options():
            self.warnings.append(f"{option}: no solver has used this option; is its name misspelt?")
            self.log.line(f"warning: {self.warnings[-1]}")

    def _finish(self, status, start):
        self.wall, self.cpu = clock.perf_counter() - start[0], clock.process_time() - start[1]
        record = {"status": status, **self.record()}
        # measured by the fields of a solved step, which only a run that came to its end holds at this point
        record["volume_drift"] = self.simulation.volume_drift() if status == "done" else None
        if not self.main:
            return
        self.log.stop()
        write_json(self.directory / "run.json", record)
        line = self.log.line
        line(timer_table(record["stage_seconds"], record["wall_seconds"]))
        for sentence in advice(record, self.simulation.step_number - self._first_step):
            line(sentence)
        for item in record["left_tank"]:
            line(f"particle {item['id']} left the tank at {item['position']} m in step {item['step']}")
        tense = self.simulation.liquids.capillary_rate > 0.0
        put_back = record["put_back_from_walls"]
        if put_back:
            share = put_back / max(record["particles"]["fluid"] * record["steps"], 1)
            line(
                f"{put_back} times a particle was put back that a wall should have stopped, {share:.2%} of all "
                "particles and steps; below 1 % is normal where liquid strikes walls"
            )
        line(self.simulation.ledger.account())
        for sentence in record["warnings"]:
            line(f"warning: {sentence}")
        line(
            f"{record['steps']} steps, {record['ksp']['iterations_mean']:.1f} iterations a step, "
            f"{record['ksp']['rebuilds']} multigrid set-ups; energy drift {record['energy_drift']:+.2%}"
            f"{', which counts what surface tension gives' if tense else ''}"
        )
        if status == "done":
            line(f"volume drift {record['volume_drift']:+.2%}")
        else:
            line(f"{status}; to continue: --restart {command_line(self.directory)}")
        plot = ("-m", "parmps", "plot", "probes" if self.job.probes else "particles")
        line(f"Results are in {self.directory}; plot them: {command_line(sys.executable, *plot, self.directory)}")

    def close(self):
        """Close all files and free the solvers."""
        self.simulation.close()
        self.particle_file.close()
        if self.main:
            self.table.close()
            self.log.close()
            self._release()

    def record(self):
        """What run.json holds; collective.

        Returns
        -------
        dict
        """
        s, domain = self.simulation, self.domain
        spent = {**s.seconds, "results": self._seconds_of_results}
        names, seconds = list(spent), np.array(list(spent.values()))
        largest, mean = domain.max(seconds), domain.sum(seconds) / domain.size
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        p = s.particles
        kinds = domain.sum(np.bincount(p.kind[: p.owned], minlength=4))
        left = [item for part in domain.gather(s.left) for item in part]
        total = int(kinds.sum())
        return {
            "ranks": domain.size,
            "steps": s.step_number,
            "simulated_seconds": s.time,
            "wall_seconds": self.wall,
            "cpu_seconds": domain.sum(self.cpu),
            "compile_seconds": domain.max(self._compilation.seconds),
            "particles": {
                "fluid": int(kinds[FLUID]),
                "wall": int(kinds[1]),
                "dummy": int(kinds[2]),
                "total": total,
            },
            "particles_lost": s.totals["total"] - total,
            "left_tank": [{"id": i, "position": x, "step": step} for i, x, step in left],
            "put_back_from_walls": int(domain.sum(s.put_back)),
            "contacts": int(domain.sum(s.contacts)),
            "stage_seconds": {
                name: {"max": float(a), "mean": float(b)} for name, a, b in zip(names, largest, mean, strict=True)
            },
            "ksp": {
                "iterations_mean": s.iterations / max(s.step_number, 1),
                "iterations_max": s.iterations_max,
                "rebuilds": s.solver.rebuilds,
            },
            "time_step": {"min": s.step_min if s.step_number else None, "max": s.step_max},
            "energy_drift": s.energy_drift(),
            "columns": self.samples.columns,
            "energy": s.ledger.summary(
                s.kinetic_energy() - s.initial_energy, s.potential_energy() - s.initial_potential
            ),
            "volume_most": s.ledger.volume_most,
            "put_back": int(domain.sum(s.put_back)),
            "warnings": [*self.warnings, *s.ledger.warnings()],
            "peak_memory_bytes": domain.gather(memory),
            "versions": {
                "parmps": parmps.__version__,
                "python": platform.python_version(),
                "numpy": np.__version__,
                "numba": numba.__version__,
                "petsc": petsc_version(),
                "h5py": h5py.__version__,
            },
        }


def _watched():
    """Whether a person watches: both outputs are a terminal, and so is that of mpirun, which passes them on."""
    if not (sys.stdout.isatty() and sys.stderr.isatty()):
        return False
    try:
        return os.readlink(f"/proc/{os.getppid()}/fd/1").startswith(("/dev/pts/", "/dev/tty"))
    except OSError:
        return True
