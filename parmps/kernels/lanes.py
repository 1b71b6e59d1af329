"""Candidates of a neighbour search, as many at a time as the processor's registers hold.

Most candidates are no neighbours, in no order that could be predicted, and a loop over them spends its time storing
each and overwriting it with the next. With AVX-512 eight are looked at together and those that are near are packed by
one instruction, which no loop can be made to compile to: so it is written out here.
"""

import numpy as np
from llvmlite import binding, ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

_features = binding.get_host_cpu_features()
LANES = 8 if _features.get("avx512f") and _features.get("avx512vl") else 1
"""Candidates that `append_near` looks at in one call; the sorted particles are followed by as many entries of room."""


@njit(inline="always")
def append_nearest(xs, ys, zs, order, k, end, x, y, z, reach2, other, square, count):
    """Append candidate k to the lists if it is near; without branches, which could not be predicted.

    Parameters
    ----------
    xs, ys, zs : (n,) float64, m
        Positions of the candidates.
    order : (n,) uint32
        Their numbers.
    k, end : uint64
        The first one to look at, and the end of the stretch of candidates.
    x, y, z : float64, m
        The particle whose neighbours they may be.
    reach2 : float64, m2
        Square of the greatest distance.
    other, square
        As in `find_pairs`; there must be room for as many entries as are looked at.
    count : uint64
        Entries of the lists so far.

    Returns
    -------
    uint64
        Entries now.
    """
    dx, dy, dz = xs[k] - x, ys[k] - y, zs[k] - z
    r2 = dx * dx + dy * dy + dz * dz
    other[count], square[count] = order[k], r2
    return count + np.uint64((r2 < reach2) & (r2 > 0.0))


@intrinsic
def _append_nearest_of_eight(typing, xs, ys, zs, order, k, end, x, y, z, reach2, other, square, count):
    """Do for candidates k to k + 7, up to the end, what `append_nearest` does for one."""
    floats, singles = (ir.VectorType(kind, LANES) for kind in (ir.DoubleType(), ir.FloatType()))
    numbers, places, marks = (ir.VectorType(ir.IntType(bits), LANES) for bits in (32, 64, 1))

    def generate(context, builder, signature, given):
        names = ("xs", "ys", "zs", "order", "k", "end", "x", "y", "z", "reach2", "other", "square", "count")
        value = dict(zip(names, given, strict=True))
        kinds = dict(zip(names, signature.args, strict=True))

        def at(name, index, kind):
            data = context.make_array(kinds[name])(context, builder, value[name]).data
            return builder.bitcast(builder.gep(data, [value[index]]), kind.as_pointer())

        def load(name, kind):
            return builder.load(at(name, "k", kind), align=4)

        def all_lanes(name, kind):
            one = builder.insert_element(ir.Constant(kind, ir.Undefined), value[name], ir.Constant(ir.IntType(32), 0))
            return builder.shuffle_vector(one, one, ir.Constant(numbers, [0] * LANES))

        def append(name, what, kind, suffix):
            pack = ir.FunctionType(kind, (kind, kind, marks))
            pack = cgutils.get_or_insert_function(builder.module, pack, f"llvm.x86.avx512.mask.compress.{suffix}")
            builder.store(builder.call(pack, [what, what, near]), at(name, "count", kind), align=4)

        r2 = ir.Constant(floats, [0.0] * LANES)
        for along, here in (("xs", "x"), ("ys", "y"), ("zs", "z")):
            d = builder.fsub(load(along, floats), all_lanes(here, floats))
            r2 = builder.fadd(r2, builder.fmul(d, d, flags=["contract"]), flags=["contract"])
        lane = builder.add(all_lanes("k", places), ir.Constant(places, list(range(LANES))))
        near = builder.icmp_unsigned("<", lane, all_lanes("end", places))
        near = builder.and_(near, builder.fcmp_ordered("<", r2, all_lanes("reach2", floats)))
        near = builder.and_(near, builder.fcmp_ordered(">", r2, ir.Constant(floats, [0.0] * LANES)))
        append("other", load("order", numbers), numbers, "v8i32")
        append("square", builder.fptrunc(r2, singles), singles, "v8f32")
        found = builder.ctpop(builder.bitcast(near, ir.IntType(8)))
        return builder.add(value["count"], builder.zext(found, ir.IntType(64)))

    arguments = (xs, ys, zs, order, types.uint64, types.uint64, x, y, z, reach2, other, square, types.uint64)
    return types.uint64(*arguments), generate


append_near = append_nearest if LANES == 1 else _append_nearest_of_eight
"""What a search calls: `append_nearest` for the next `LANES` candidates."""
