"""Formulas for all pixels of a plane, made into machine code that computes sixteen pixels at a time.

A :func:`~.formula.formula` is a Python function that says what to compute at one pixel. It is not compiled: it is
*called*, once, while its caller is being compiled, and its parameters are then not numbers but descriptions of
numbers to be: each operator of :class:`Lanes` appends a vector instruction to the program, and reading or writing
:class:`Pixels` a load or a store. What is round it, the loops over rows and over blocks of :data:`LANES` pixels, is
the same for all formulas and is written here. So a formula reads like the equation that it is, and

* runs at the processor's full width whether or not a compiler would have found out how to vectorise its loop,
* takes a fraction of the time to compile, since there is nothing to find out.

Example: half the difference of the neighbours to the right and to the left::

    @formula
    def slope(a: Pixels, out: Pixels) -> None:
        out[0] = 0.5 * (a[1] - a[-1])

Inside a Numba function, ``slope(m, height, width, stride, a, out)`` then computes that for `height` rows of `width`
pixels in the array `m`, where `a` and `out` are the indices of their first pixels and rows are `stride` elements
apart.

The last block of a row may stick out of it. There stores keep what was in memory (they store a choice of new and old
values), but loads must find memory: see :mod:`.program` for the room that planes have round them.
"""

# llvmlite has no types.
# mypy: allow-untyped-calls
from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, NamedTuple

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.np.arrayobj import make_array

__all__ = [
    "LANES",
    "Around",
    "Columns",
    "Image",
    "ImageOfTwo",
    "Index",
    "Lanes",
    "Pixels",
    "PixelsOfTwo",
    "instruction",
    "interpolate_fours",
]

LANES = 16
"""Pixels computed at a time: what AVX-512 holds; for narrower processors LLVM takes several instructions."""

FLAGS = ("contract", "nsz")
"""Freedoms of rounding: a · b + c in one instruction, and no care for −0. No others: reordered sums would break
"identical frames give exactly zero"."""

FLOAT = ir.FloatType()
INT32 = ir.IntType(32)
INT64 = ir.IntType(64)
FLOATS = ir.VectorType(FLOAT, LANES)
PAIRS = ir.VectorType(FLOAT, 2 * LANES)
DOUBLES = ir.VectorType(ir.DoubleType(), LANES)


class Lanes:
    """Values at the :data:`LANES` pixels of a block. Plain numbers that meet it count for all of them."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder = builder
        self.value = value

    def _of(self, other: Lanes | float) -> Any:
        return other.value if isinstance(other, Lanes) else ir.Constant(FLOATS, [float(other)] * LANES)

    def __add__(self, other: Lanes | float) -> Lanes:
        return Lanes(self.builder, self.builder.fadd(self.value, self._of(other), flags=FLAGS))

    def __sub__(self, other: Lanes | float) -> Lanes:
        return Lanes(self.builder, self.builder.fsub(self.value, self._of(other), flags=FLAGS))

    def __rsub__(self, other: float) -> Lanes:
        return Lanes(self.builder, self.builder.fsub(self._of(other), self.value, flags=FLAGS))

    def __mul__(self, other: Lanes | float) -> Lanes:
        return Lanes(self.builder, self.builder.fmul(self.value, self._of(other), flags=FLAGS))

    def __truediv__(self, other: Lanes | float) -> Lanes:
        return Lanes(self.builder, self.builder.fdiv(self.value, self._of(other), flags=FLAGS))

    def __rtruediv__(self, other: float) -> Lanes:
        return Lanes(self.builder, self.builder.fdiv(self._of(other), self.value, flags=FLAGS))

    __radd__ = __add__
    __rmul__ = __mul__

    def _call(self, name: str) -> Lanes:
        kind = ir.FunctionType(FLOATS, [FLOATS])
        function = cgutils.get_or_insert_function(self.builder.module, kind, f"{name}.v{LANES}f32")
        return Lanes(self.builder, self.builder.call(function, [self.value]))

    def sqrt(self) -> Lanes:
        """Square root."""
        return self._call("llvm.sqrt")

    def floor(self) -> Lanes:
        """Whole part of what is not negative."""
        return self._call("llvm.trunc")

    def least(self, other: Lanes | float) -> Lanes:
        """Smaller one; `other` if either is not a number."""
        return self._choose("<", other)

    def greatest(self, other: Lanes | float) -> Lanes:
        """Larger one; `other` if either is not a number."""
        return self._choose(">", other)

    def _choose(self, comparison: str, other: Lanes | float) -> Lanes:
        value = self._of(other)
        chosen = self.builder.fcmp_ordered(comparison, self.value, value)
        return Lanes(self.builder, self.builder.select(chosen, self.value, value))

    def or_zero(self) -> Lanes:
        """Value if it is finite, in so far as a hundred million times less than the largest float is, else 0."""
        size = self._call("llvm.fabs")
        chosen = self.builder.fcmp_ordered("<", size.value, self._of(1e30))
        return Lanes(self.builder, self.builder.select(chosen, self.value, self._of(0.0)))

    def equals(self, other: Lanes) -> Lanes:
        """1 where the two are equal, else 0."""
        equal = self.builder.fcmp_ordered("==", self.value, other.value)
        return Lanes(self.builder, self.builder.select(equal, self._of(1.0), self._of(0.0)))

    def joined(self, following: Lanes, first: int) -> Lanes:
        """Of this block and the `following` one in a row, LANES values beginning at number `first`."""
        return Lanes(self.builder, _shuffle(self.builder, self.value, following.value, range(first, first + LANES)))


class Columns(Lanes):
    """Parameter of a formula that is not passed: the pixels' x, counted from 0."""


class Index:
    """Number of elements between two places in memory: a parameter, and what comes of adding such."""

    def __init__(self, builder: Any, value: Any) -> None:
        self.builder = builder
        self.value = value

    def __add__(self, other: Index | int) -> Index:
        return Index(self.builder, self.builder.add(self.value, _whole(other)))

    def __sub__(self, other: Index | int) -> Index:
        return Index(self.builder, self.builder.sub(self.value, _whole(other)))

    def __rmul__(self, other: int) -> Index:
        return Index(self.builder, self.builder.mul(self.value, _whole(other)))

    def __neg__(self) -> Index:
        return Index(self.builder, self.builder.neg(self.value))


class Pixels:
    """A plane as seen from the pixels of a block: `plane[offset]` are the values that many elements further on.

    What is written is noted down and stored when the whole formula has been computed.
    """

    def __init__(self, builder: Any, pointer: Any, room: Any, written: list[_Write]) -> None:
        self.builder = builder
        self.pointer = pointer  # to the block's first pixel
        self.room = room  # pixels from there to the end of the row
        self.written = written

    def _at(self, offset: Index | int, kind: Any) -> Any:
        place = self.builder.gep(self.pointer, [_whole(offset)])
        return self.builder.bitcast(place, kind.as_pointer())

    def __getitem__(self, offset: Index | int) -> Lanes:
        return Lanes(self.builder, self.builder.load(self._at(offset, FLOATS), align=4))

    def __setitem__(self, offset: Index | int, value: Lanes) -> None:
        self._write(self._at(offset, FLOATS), value.value)

    def _write(self, place: Any, value: Any) -> None:
        self.written.append(_Write(self, place, value))

    def store_part(self, place: Any, value: Any) -> None:
        """Store as many values as there is room for, and otherwise what is there already."""
        inside = _inside(self.builder, self.room, value.type.count)
        old = self.builder.load(place, align=4)
        self.builder.store(self.builder.select(inside, value, old), place, align=4)


class _Write(NamedTuple):
    plane: Pixels
    place: Any
    value: Any


class PixelsOfTwo(Pixels):
    """A plane of twice the resolution, at whose pixel (2 y, 2 x) one is. Its pixels come and go as pairs."""

    def __init__(self, builder: Any, pointer: Any, room: Any, written: list[_Write], stride: Index) -> None:
        super().__init__(builder, pointer, room, written)
        self.stride = stride

    def pair(self, offset: Index | int) -> tuple[Lanes, Lanes]:
        """Even and odd values that begin `offset` elements further on."""
        return _apart(self.builder, self.builder.load(self._at(offset, PAIRS), align=4))

    def set_pair(self, offset: Index | int, even: Lanes, odd: Lanes) -> None:
        """Write both."""
        self._write(self._at(offset, PAIRS), _together(even, odd))


class Image(Pixels):
    """An image (height, width, 1), as seen from the pixels of a block: `image[0]`. There is no room round it.

    So only what is inside is read or written, which makes slower instructions on some processors.
    """

    def __getitem__(self, offset: Index | int) -> Lanes:
        return Lanes(self.builder, self._load(self._at(offset, FLOATS), FLOATS))

    def _load(self, place: Any, kind: Any) -> Any:
        inside = _inside(self.builder, self.room, kind.count)
        name = f"llvm.masked.load.v{kind.count}f32.p0v{kind.count}f32"
        function = ir.FunctionType(kind, (place.type, INT32, inside.type, kind))
        function = cgutils.get_or_insert_function(self.builder.module, function, name)
        zeros = ir.Constant(kind, [0.0] * kind.count)
        return self.builder.call(function, (place, ir.Constant(INT32, 4), inside, zeros))

    def store_part(self, place: Any, value: Any) -> None:
        """Store as many values as there is room for."""
        inside = _inside(self.builder, self.room, value.type.count)
        name = f"llvm.masked.store.v{value.type.count}f32.p0v{value.type.count}f32"
        function = ir.FunctionType(ir.VoidType(), (value.type, place.type, INT32, inside.type))
        function = cgutils.get_or_insert_function(self.builder.module, function, name)
        self.builder.call(function, (value, place, ir.Constant(INT32, 4), inside))


class ImageOfTwo(Image):
    """An image (height, width, 2), like the flow: `image.pair()` are the values of both channels."""

    def pair(self) -> tuple[Lanes, Lanes]:
        """Both channels."""
        return _apart(self.builder, self._load(self._at(0, PAIRS), PAIRS))

    def set_pair(self, first: Lanes, second: Lanes) -> None:
        """Write both channels."""
        self._write(self._at(0, PAIRS), _together(first, second))


class Around:
    """What a formula's `shared` function returned: for this block, and for the blocks before and after it."""

    def __init__(self, before: list[Lanes], here: list[Lanes], after: list[Lanes]) -> None:
        self.before = before
        self.here = here
        self.after = after

    def at(self, i: int, x: int) -> Lanes:
        """Value number `i` as computed at the pixel `x` further to the right (−LANES to LANES)."""
        if x < 0:
            return self.before[i].joined(self.here[i], LANES + x)
        return self.here[i].joined(self.after[i], x) if x else self.here[i]


PARTS = {"Pixels": 1, "PixelsOfTwo": 3, "Index": 1, "Lanes": 1, "Image": 1, "ImageOfTwo": 1}
"""How many arguments are passed for a parameter of a formula, by its annotation; for other types none."""

Formula = Callable[..., "Lanes | None"]
Shared = Callable[..., list[Lanes]]


def instruction(function: Formula, shared: Shared | None) -> Callable[..., Any]:
    """Make of a formula what Numba can call in a kernel, see :func:`~.formula.formula`."""
    kinds = {name: parameter.annotation for name, parameter in inspect.signature(function).parameters.items()}
    sums = inspect.signature(function).return_annotation == "Lanes"

    def call(typing_context: Any, m: Any, height: Any, width: Any, stride: Any, *rest: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            total = _Loops(context, builder, signature.args, values, kinds).write(function, shared)
            return total if sums else context.get_dummy_value()

        arguments: list[Any] = []
        for kind in kinds.values():
            if kind == "Lanes":
                arguments.append(types.float32)
            elif kind in ("Image", "ImageOfTwo"):
                arguments.append(rest[len(arguments)])
            else:
                arguments += [types.uint64] * PARTS.get(kind, 0)
        result = types.float64 if sums else types.void
        return result(m, types.uint64, types.uint64, types.uint64, *arguments), emit

    names = ["typing_context", "m", "height", "width", "stride"]
    for name, kind in kinds.items():
        names += [f"{name}_{i}" for i in range(PARTS.get(kind, 0))]
    call.__name__ = function.__name__
    call.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in names]
    )
    return call


class _Loops:
    """The loops over rows and blocks round a formula; `kinds` are the types of its parameters by name."""

    def __init__(self, context: Any, builder: Any, kinds_of_values: Any, values: Any, kinds: dict[str, str]) -> None:
        self.builder = builder
        self.data = make_array(kinds_of_values[0])(context, builder, values[0]).data
        self.height, self.width, self.stride = values[1:4]
        self.kinds = kinds
        self.values: dict[str, Any] = {}
        rest = list(zip(kinds_of_values[4:], values[4:], strict=True))
        for name, kind in kinds.items():
            if kind in ("Columns", "Around"):
                continue
            numba_type, value = rest.pop(0)
            if kind == "Lanes":
                value = _all_lanes(builder, value, FLOATS)
            elif kind in ("Image", "ImageOfTwo"):
                value = make_array(numba_type)(context, builder, value).data
            elif kind == "PixelsOfTwo":
                value = (value, rest.pop(0)[1], rest.pop(0)[1])
            self.values[name] = value
        self.written: list[_Write] = []

    def write(self, function: Formula, shared: Shared | None) -> Any:
        """Write them with the formula inside; return the sum of what it returns."""
        builder = self.builder
        nothing = ir.Constant(FLOATS, [0.0] * LANES)
        total = cgutils.alloca_once_value(builder, ir.Constant(DOUBLES, [0.0] * LANES))
        blocks = builder.udiv(builder.add(self.width, _whole(LANES - 1)), _whole(LANES))
        with cgutils.for_range(builder, self.height, intp=INT64) as rows:
            y = rows.index
            row_total = cgutils.alloca_once(builder, FLOATS)
            builder.store(nothing, row_total)
            places = self._begin(y, shared) if shared else []
            with cgutils.for_range(builder, blocks, intp=INT64) as columns:
                x = builder.mul(columns.index, _whole(LANES))
                parameters = self._parameters(y, x)
                if shared:
                    parameters[self._name("Around")] = self._around(y, x, shared, places)
                result = function(**parameters)
                self._store()
                if result is not None:
                    inside = _inside(builder, builder.sub(self.width, x), LANES)
                    counted = builder.select(inside, result.value, nothing)
                    builder.store(builder.fadd(builder.load(row_total), counted), row_total)
            wide = builder.fpext(builder.load(row_total), DOUBLES)
            builder.store(builder.fadd(builder.load(total), wide), total)
        return _sum(builder, builder.load(total))

    def _store(self) -> None:
        """Store what a formula has written.

        Whole blocks are told from the last one of a row: to store part of a vector takes long on some processors.
        """
        builder = self.builder
        whole = ir.Constant(ir.IntType(1), 1)
        for plane, _, value in self.written:
            whole = builder.and_(whole, builder.icmp_signed(">=", plane.room, _whole(value.type.count)))
        with builder.if_else(whole, likely=True) as (then, otherwise):
            with then:
                for _, place, value in self.written:
                    builder.store(value, place, align=4)
            with otherwise:
                for plane, place, value in self.written:
                    plane.store_part(place, value)
        self.written.clear()

    def _name(self, kind: str) -> str:
        return next(name for name in self.kinds if self.kinds[name] == kind)

    def _parameters(self, y: Any, x: Any, shift: int = 0) -> dict[str, Any]:
        """Return what the formula is called with at one block, or `shift` pixels to the right of it."""
        return {
            name: self._parameter(kind, self.values.get(name), y, x, shift)
            for name, kind in self.kinds.items()
            if kind != "Around"
        }

    def _parameter(self, kind: str, value: Any, y: Any, x: Any, shift: int) -> Any:
        builder = self.builder
        room = builder.sub(self.width, x)
        if kind == "Index":
            return Index(builder, value)
        if kind == "Lanes":
            return Lanes(builder, value)
        if kind == "Columns":
            first = _all_lanes(builder, builder.uitofp(x, FLOAT), FLOATS)
            return Lanes(builder, first) + Lanes(builder, ir.Constant(FLOATS, list(range(LANES))))
        if kind == "PixelsOfTwo":
            first, stride, width = value
            row = builder.add(first, builder.mul(builder.add(y, y), stride))
            two = builder.add(x, x)
            pointer = builder.gep(builder.gep(self.data, [row]), [two])
            return PixelsOfTwo(builder, pointer, builder.sub(width, two), self.written, Index(builder, stride))
        if kind == "Pixels":
            row = builder.gep(self.data, [builder.add(value, builder.mul(y, self.stride))])
            return Pixels(builder, builder.gep(row, [builder.add(x, _whole(shift))]), room, self.written)
        if kind == "Image":
            return Image(
                builder, builder.gep(builder.gep(value, [builder.mul(y, self.width)]), [x]), room, self.written
            )
        first = builder.gep(value, [builder.mul(builder.add(y, y), self.width)])
        return ImageOfTwo(builder, builder.gep(first, [builder.add(x, x)]), builder.add(room, room), self.written)

    def _share(self, y: Any, x: Any, shift: int, shared: Shared) -> list[Lanes]:
        """Call the shared function."""
        parameters = self._parameters(y, x, shift)
        return shared(**{name: parameters[name] for name in inspect.signature(shared).parameters})

    def _begin(self, y: Any, shared: Shared) -> list[Any]:
        """Compute what is shared of the block before the row and of its first; return the places of both."""
        first = [*self._share(y, _whole(0), -LANES, shared), *self._share(y, _whole(0), 0, shared)]
        places = [cgutils.alloca_once(self.builder, FLOATS) for _ in first]
        for value, place in zip(first, places, strict=True):
            self.builder.store(value.value, place)
        return places

    def _around(self, y: Any, x: Any, shared: Shared, places: list[Any]) -> Around:
        """Compute what is shared of the next block; what was that of this block moves on."""
        known = [Lanes(self.builder, self.builder.load(place)) for place in places]
        before, here = known[: len(known) // 2], known[len(known) // 2 :]
        after = self._share(y, x, LANES, shared)
        for value, place in zip(here + after, places, strict=True):
            self.builder.store(value.value, place)
        return Around(before, here, after)


def _whole(value: Index | int) -> Any:
    """64-bit value of an index or of a number known already."""
    return value.value if isinstance(value, Index) else ir.Constant(INT64, value)


def _shuffle(builder: Any, a: Any, b: Any, order: Any) -> Any:
    """Pick values from two vectors laid end to end."""
    order = list(order)
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(INT32, len(order)), order))


def _all_lanes(builder: Any, value: Any, vector: Any) -> Any:
    """Fill a vector with one value."""
    none = ir.Constant(vector, ir.Undefined)
    return _shuffle(builder, builder.insert_element(none, value, ir.Constant(INT32, 0)), none, [0] * vector.count)


def _inside(builder: Any, room: Any, count: int) -> Any:
    """Which of `count` lanes are among the first `room` ones."""
    vector = ir.VectorType(INT32, count)
    limit = _all_lanes(builder, builder.trunc(room, INT32), vector)
    return builder.icmp_signed("<", ir.Constant(vector, list(range(count))), limit)


def _sum(builder: Any, value: Any) -> Any:
    """Add up the lanes, halves first."""
    while value.type.count > 1:
        half = value.type.count // 2
        low, high = (_shuffle(builder, value, value, range(i, i + half)) for i in (0, half))
        value = builder.fadd(low, high)
    return builder.extract_element(value, ir.Constant(INT32, 0))


def _apart(builder: Any, pairs: Any) -> tuple[Lanes, Lanes]:
    """Even and odd values of a vector."""
    even, odd = (_shuffle(builder, pairs, pairs, range(i, 2 * LANES, 2)) for i in (0, 1))
    return Lanes(builder, even), Lanes(builder, odd)


def _together(even: Lanes, odd: Lanes) -> Any:
    """Vector of values taken from both in turn."""
    order = [i // 2 + i % 2 * LANES for i in range(2 * LANES)]
    return _shuffle(even.builder, even.value, odd.value, order)


def interpolate_fours(typing_context: Any, m: Any, fours: Any, table: Any, stride: Any, plane: Any, out: Any) -> Any:
    """Interpolate `plane`, four pixels at a time, at the places and with the weights that a table has.

    A plane's 4 × 4 pixels round a place are read a row at a time. So the rows are added up first, for each pixel with
    its weights down; then the four sums of four pixels, transposed, with the pixels' weights across.

    `table` is the row of y, and the other rows follow `stride` apart: x, four weights down, four across; `plane` is
    the pixel up and left of its first one.
    """
    vector = ir.VectorType(FLOAT, 4)

    def emit(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        data = make_array(signature.args[0])(context, builder, values[0]).data
        fours, table, stride, plane, out = values[1:]

        def pointer(at: Any, kind: Any) -> Any:
            return builder.bitcast(cgutils.gep(builder, data, at), kind.as_pointer())

        def entry(row: int, x: Any, kind: Any) -> Any:
            at = builder.add(builder.add(table, x), builder.mul(stride, _whole(row)))
            return builder.load(pointer(at, kind), align=4)

        def multiply_add(a: Any, b: Any, c: Any) -> Any:
            product = builder.fmul(a, b, flags=FLAGS)
            return product if c is None else builder.fadd(c, product, flags=FLAGS)

        with cgutils.for_range(builder, fours, intp=INT64) as loop:
            x = builder.mul(loop.index, _whole(4))
            sums = []
            for i in range(4):
                xi = builder.add(x, _whole(i))
                iy, ix = (builder.fptosi(entry(row, xi, FLOAT), INT64) for row in (0, 1))
                at = builder.add(builder.add(plane, ix), builder.mul(iy, stride))
                total = None
                for row in range(4):
                    weight = _all_lanes(builder, entry(2 + row, xi, FLOAT), vector)
                    total = multiply_add(builder.load(pointer(at, vector), align=4), weight, total)
                    at = builder.add(at, stride)
                sums.append(total)
            low = [_shuffle(builder, sums[i], sums[i + 1], (0, 4, 1, 5)) for i in (0, 2)]
            high = [_shuffle(builder, sums[i], sums[i + 1], (2, 6, 3, 7)) for i in (0, 2)]
            total = None
            for j in range(4):
                pairs = low if j < 2 else high
                column = _shuffle(builder, pairs[0], pairs[1], (0, 1, 4, 5) if j % 2 == 0 else (2, 3, 6, 7))
                total = multiply_add(column, entry(6 + j, x, vector), total)
            builder.store(total, pointer(builder.add(out, x), vector), align=4)
        return context.get_dummy_value()

    return types.void(m, *(types.uint64,) * 5), emit
