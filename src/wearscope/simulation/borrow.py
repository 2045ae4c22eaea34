"""Arrays lent to compiled code, which then does not count who refers to them.

Numba counts references by atomic additions, also to the rows that an effect is called with; they took half of
the time of a step.
"""

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def borrow(typingctx, arrays):
    """Give a (named) tuple of arrays without owners: the calling Python, which outlives it, has them."""

    def generate(context, builder, signature, arguments):
        (value,) = arguments
        for i, kind in enumerate(arrays.types):
            array = context.make_array(kind)(context, builder, builder.extract_value(value, i))
            array.meminfo = ir.Constant(array.meminfo.type, None)
            array.parent = ir.Constant(array.parent.type, None)
            value = builder.insert_value(value, array._getvalue(), i)
        return value

    return arrays(arrays), generate


@intrinsic
def borrow_rows(typingctx, rows):
    """Give a typed list without its owner, as `borrow` does arrays."""

    def generate(context, builder, signature, arguments):
        (value,) = arguments
        lent = cgutils.create_struct_proxy(rows)(context, builder, value=value)
        lent.meminfo = ir.Constant(lent.meminfo.type, None)
        return lent._getvalue()

    return rows(rows) if isinstance(rows, types.ListType) else None, generate
