"""Domain decomposition: who owns which particle, migration, halo exchange, and sums over the ranks.

The only module that knows MPI. Ownership follows a recursive coordinate bisection and changes only when the
balance or the halo has become worse; which particles the neighbouring ranks need is found again when some have
come within reach that are not among them.
"""

import math
import time as clock

import numpy as np
from mpi4py import MPI

from parmps.kernels.pairs import any_within, bounds, within
from parmps.particles import FIELDS, Particles

BISECTIONS = 48
"""Reductions that find one cut: more than enough for the digits of a coordinate."""


class Domain:
    """The ranks of a run and the traffic among them.

    Parameters
    ----------
    comm : mpi4py.MPI.Comm, optional
        All ranks by default.

    Attributes
    ----------
    rank, size : int
    comm : mpi4py.MPI.Comm
    halo : int
        Number of particles in the halo of this rank.
    """

    def __init__(self, comm=None):
        self.comm = MPI.COMM_WORLD if comm is None else comm
        self.rank, self.size = self.comm.rank, self.comm.size
        self._ending = self.comm.Dup()
        self.halo = 0
        self._sent, self._sends, self._receives = {}, [], []  # by rank: masks, indices, and (begin, end)
        self._channels = {}

    # Sums over the ranks

    def sum(self, values):
        """Sum over the ranks, element by element.

        Parameters
        ----------
        values : float or array

        Returns
        -------
        array or float
        """
        return self._reduce(values, MPI.SUM)

    def max(self, values):
        """Maximum over the ranks, element by element."""
        return self._reduce(values, MPI.MAX)

    def min(self, values):
        """Minimum over the ranks, element by element."""
        return self._reduce(values, MPI.MIN)

    def _reduce(self, values, operation):
        array = np.asarray(values)
        out = np.empty_like(array)
        self.comm.Allreduce(array, out, operation)
        return out if np.ndim(values) else out.item()

    def first_of(self, count):
        """Number of items on the ranks before this one.

        Parameters
        ----------
        count : int
            Items on this rank.

        Returns
        -------
        int
        """
        return self.comm.exscan(count) or 0

    def gather(self, value):
        """Values of all ranks, on all of them; for a few numbers.

        Parameters
        ----------
        value : object

        Returns
        -------
        list
        """
        return self.comm.allgather(value)

    def share(self, value):
        """Value of rank 0, on all ranks.

        Parameters
        ----------
        value : object

        Returns
        -------
        object
        """
        return self.comm.bcast(value)

    def barrier(self):
        """Wait for all ranks."""
        self.comm.Barrier()

    def all_end(self, seconds):
        """Whether all ranks come to their end, each by itself, within some time of each other.

        Parameters
        ----------
        seconds : float
            How long to wait for the others, s.

        Returns
        -------
        bool
            False where others still run, or wait for this rank in some other call.
        """
        request, limit = self._ending.Ibarrier(), clock.monotonic() + seconds
        while not request.Test():
            if clock.monotonic() > limit:
                return False
            clock.sleep(0.001)
        return True

    def ranks_here(self):
        """Number of ranks on this rank's machine; collective.

        Returns
        -------
        int
        """
        here = self.comm.Split_type(MPI.COMM_TYPE_SHARED)
        count = here.size
        here.Free()
        return count

    def abort(self, status):
        """End all ranks at once, because this one cannot go on.

        Parameters
        ----------
        status : int
            Exit status of the run.
        """
        self.comm.Abort(status)

    # Ownership

    def distribute(self, particles, weight, cell):
        """Give every rank a box of particles of nearly equal cost, and sort them by kind and place.

        Parameters
        ----------
        particles : Particles
        weight : (owned,) float64
            Cost of each particle.
        cell : float
            Edge of the cells that the particles are sorted by, m.

        Returns
        -------
        Particles
            Those that the rank owns now, without a halo.
        """
        arrays = particles.arrays()
        if self.size > 1:
            arrays = self._migrate(arrays, self.bisect(arrays["position"], weight, self.size))
        particles = Particles(arrays)
        cells = np.floor(particles.position / cell).astype(np.int64)
        order = np.lexsort((particles.id, cells[:, 2], cells[:, 1], cells[:, 0], particles.kind % 3))
        particles.take(order)
        self.halo = 0
        return particles

    def bisect(self, position, weight, parts):
        """Recursive coordinate bisection of the particles of all ranks into boxes of nearly equal cost.

        Parameters
        ----------
        position : (n, 3) float64, m
            Of this rank's particles.
        weight : (n,) float64
            Their costs.
        parts : int
            Number of boxes.

        Returns
        -------
        (n,) int64
            Box that each particle goes to.
        """
        begin = np.zeros(len(position), np.int64)  # each particle's group of boxes [begin, end)
        end = np.full(len(position), parts, np.int64)
        groups = [(0, parts)] if parts > 1 else []
        # Ties, as in a column of the lattice, are cut along the other axes.
        skew = position @ np.array([[1.0, 1e-5, 1e-4], [1e-5, 1.0, 1e-4], [1e-4, 1e-5, 1.0]]).T
        while groups:
            index = np.full(parts, -1)
            index[[first for first, _ in groups]] = np.arange(len(groups))
            active = end - begin > 1
            group = np.where(active, index[begin], -1)
            lower = np.full((len(groups), 3), np.inf)
            upper = np.full((len(groups), 3), -np.inf)
            np.minimum.at(lower, group[active], skew[active])
            np.maximum.at(upper, group[active], skew[active])
            lower, upper = self.min(lower), self.max(upper)
            axis = np.argmax(np.where(np.isfinite(upper - lower), upper - lower, -1.0), axis=1)
            rows = np.arange(len(groups))
            low, high = lower[rows, axis].copy(), upper[rows, axis].copy()
            low[~np.isfinite(low)] = high[~np.isfinite(high)] = 0.0
            key = np.where(active, skew[np.arange(len(skew)), axis[group]], 0.0)
            total = self.sum(_sums(group[active], weight[active], len(groups)))
            target = total * np.array([((e - b) // 2) / (e - b) for b, e in groups])
            for _ in range(BISECTIONS):
                middle = 0.5 * (low + high)
                below = active & (key < middle[group])
                done = self.sum(_sums(group[below], weight[below], len(groups)))
                low = np.where(done < target, middle, low)
                high = np.where(done < target, high, middle)
            cut = np.array([b + (e - b) // 2 for b, e in groups])
            left = active & (key < high[group])
            right = active & ~left
            end[left] = cut[group[left]]
            begin[right] = cut[group[right]]
            halves = [half for (b, e), c in zip(groups, cut, strict=True) for half in ((b, int(c)), (int(c), e))]
            groups = [(b, e) for b, e in halves if e - b > 1]
        return begin

    def _migrate(self, arrays, target):
        """Send every particle to the rank ``target``."""
        record = np.dtype([(name, dtype, shape) for name, (dtype, shape) in FIELDS.items()])
        order = np.argsort(target, kind="stable")
        outgoing = np.empty(len(target), record)
        for name in FIELDS:
            outgoing[name] = arrays[name][order]
        send = np.bincount(target, minlength=self.size)
        receive = np.empty_like(send)
        self.comm.Alltoall(send, receive)
        incoming = np.empty(receive.sum(), record)
        kind = MPI.BYTE.Create_contiguous(record.itemsize).Commit()
        self.comm.Alltoallv([outgoing, (send, _starts(send)), kind], [incoming, (receive, _starts(receive)), kind])
        kind.Free()
        return {name: incoming[name] for name in FIELDS}

    # Halo

    def build_halo(self, particles, width):
        """Find the particles of other ranks within ``width`` of this rank's, and copy all their fields.

        Parameters
        ----------
        particles : Particles
            Gets the halo behind its owned particles.
        width : float
            m.
        """
        if self.size == 1:
            return
        position = particles.position[: particles.owned]
        self._sent = {other: within(position, low, high) for other, low, high in self._near_others(particles, width)}
        self._sends = [(other, np.flatnonzero(inside)) for other, inside in self._sent.items()]
        neighbours = [other for other, _ in self._sends]
        counts, requests = np.zeros(len(neighbours), np.int64), []
        for k, other in enumerate(neighbours):
            requests.append(self.comm.Irecv(counts[k : k + 1], other, 1))
        sizes = np.array([len(indices) for _, indices in self._sends], np.int64)
        for k, other in enumerate(neighbours):
            self.comm.Send(sizes[k : k + 1], other, 1)
        MPI.Request.Waitall(requests)
        ends = particles.owned + np.cumsum(counts)
        begins = ends - counts
        self._receives = [(o, int(b), int(e)) for o, b, e in zip(neighbours, begins, ends, strict=True)]
        self.halo = int(counts.sum())
        particles.resize(particles.owned + self.halo)
        self._close_channels()
        self.exchange(*(getattr(particles, name) for name in FIELDS))

    def halo_is_stale(self, particles, reach):
        """Whether some rank lacks a particle within ``reach`` of its own.

        Parameters
        ----------
        particles : Particles
        reach : float
            m.

        Returns
        -------
        bool
        """
        if self.size == 1:
            return False
        position, none, late = particles.position[: particles.owned], np.zeros(particles.owned, bool), False
        for other, low, high in self._near_others(particles, reach):
            late |= any_within(position, self._sent.get(other, none), low, high)
        return bool(self.max(int(late)))

    def _near_others(self, particles, width):
        """Ranks whose box is near this one's, and the corners of that box, wider by ``width``."""
        box, boxes = bounds(particles.position, particles.kind, particles.owned), np.empty((self.size, 2, 3))
        self.comm.Allgather(box, boxes)
        # The same differences on both ranks of a pair: if rounding told only one of them, it would wait for ever.
        near = np.all(np.maximum(boxes[:, 0] - box[1], box[0] - boxes[:, 1]) <= width, axis=1)
        near[self.rank] = False
        return [(int(k), boxes[k, 0] - width, boxes[k, 1] + width) for k in np.flatnonzero(near)]

    def exchange(self, *arrays):
        """Fill the halo's rows of arrays from the ranks that own them.

        Parameters
        ----------
        *arrays : (owned + halo, ...) array
        """
        if self.size == 1:
            return
        widths = [a.itemsize * math.prod(a.shape[1:]) for a in arrays]  # of a row: a rank may have none
        columns = [a.view(np.uint8).reshape(len(a), w) for a, w in zip(arrays, widths, strict=True)]
        width = sum(widths)
        channel = self._channels.get(width)
        if channel is None:
            channel = self._channels[width] = _Channel(self.comm, self._sends, self._receives, width)
        channel.start(columns)
        channel.finish(columns)

    def _close_channels(self):
        for channel in self._channels.values():
            channel.close()
        self._channels = {}


class _Channel:
    """Persistent requests for one number of bytes a particle."""

    def __init__(self, comm, sends, receives, width):
        self.sends = [(indices, np.empty((len(indices), width), np.uint8)) for _, indices in sends]
        self.receives = [(begin, end, np.empty((end - begin, width), np.uint8)) for _, begin, end in receives]
        pairs = zip(receives, self.receives, strict=True)
        self.requests = [comm.Recv_init(buffer, rank, 2) for (rank, _, _), (_, _, buffer) in pairs]
        pairs = zip(sends, self.sends, strict=True)
        self.requests += [comm.Send_init(buffer, rank, 2) for (rank, _), (_, buffer) in pairs]

    def start(self, columns):
        for indices, buffer in self.sends:
            at = 0
            for column in columns:
                width = column.shape[1]
                buffer[:, at : at + width] = column.take(indices, axis=0)
                at += width
        MPI.Prequest.Startall(self.requests)

    def finish(self, columns):
        MPI.Request.Waitall(self.requests)
        for begin, end, buffer in self.receives:
            at = 0
            for column in columns:
                width = column.shape[1]
                column[begin:end] = buffer[:, at : at + width]
                at += width

    def close(self):
        for request in self.requests:
            request.Free()


def _sums(group, weight, count):
    """Sum of the weights in each group: np.bincount, which would make whole numbers of no weights at all."""
    return np.bincount(group, weight, count).astype(np.float64)


def _starts(counts):
    """Where each block begins, of blocks that follow each other."""
    return np.concatenate(([0], np.cumsum(counts)[:-1]))
