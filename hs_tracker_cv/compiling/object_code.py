"""From a kernel to its machine code, by Numba: what only compiling needs, so that a warm start need not import it.

Numba makes and optimises the LLVM code of a function as ever. What differs is where it ends: in an object file, whose
one entry Python can call. That entry reads its arguments through Python's buffer protocol and number functions, all
of the stable C interface, so object code runs in any process that has LLVM's loader and no Numba.
"""

# mypy: allow-untyped-calls, allow-untyped-decorators, disable-error-code="misc, call-overload"
from __future__ import annotations

import ctypes
import gc
import operator
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import cached_property
from types import BuiltinFunctionType, FunctionType
from typing import Any, ClassVar

import llvmlite.binding as llvm  # type: ignore[import-untyped]
import numpy as np
from llvmlite import ir
from llvmlite.binding import ffi
from numba import _dynfunc, types  # type: ignore[attr-defined]
from numba.core import (
    cgutils,
    codegen,
    compiler,
    config,
    cpu,
    externals,
    fastmathpass,
    imputils,
    registry,
    ssa,
    typed_passes,
    untyped_passes,
)
from numba.core.analysis import compute_cfg_from_blocks
from numba.core.compiler_lock import global_compiler_lock
from numba.core.funcdesc import ExternalFunctionDescriptor
from numba.core.ir_utils import build_definitions
from numba.core.transforms import canonicalize_cfg
from numba.core.typing.context import Context
from numba.np import arrayobj

from . import Kernel, Part
from .loading import C_FUNCTIONS, KEPT, LONG, PATIENCE, TURN, UNTIL, native
from .numba_function import SETTINGS, function_for, returned, signature

__all__ = ["object_codes"]

_CONFIG: Any = config

_POINTER = ir.IntType(8).as_pointer()
_INT = ir.IntType(32)
_SIZE = ir.IntType(64)
_DOUBLE = ir.DoubleType()
_BUFFER = ir.LiteralStructType([_POINTER, _POINTER, _SIZE, _SIZE, _INT, _INT, *[_POINTER] * 5])
"""``Py_buffer``: buf, obj, len, itemsize, readonly, ndim, format, shape, strides, suboffsets, internal."""

_CONTIGUOUS = 0x38 | 0x04
"""``PyBUF_C_CONTIGUOUS | PyBUF_FORMAT``."""

_SETTINGS: dict[str, Any] = {**SETTINGS, "_nrt": False, "no_rewrites": True}
# Kernels allocate nothing, so nothing in them counts references; and have no array expressions to be rewritten.

_C_FUNCTIONS = {
    "PyObject_GetBuffer": ir.FunctionType(_INT, [_POINTER, _POINTER, _INT]),
    "PyBuffer_Release": ir.FunctionType(ir.VoidType(), [_POINTER]),
    "PyFloat_AsDouble": ir.FunctionType(_DOUBLE, [_POINTER]),
    "PyLong_AsLongLong": ir.FunctionType(_SIZE, [_POINTER]),
    "PyObject_IsTrue": ir.FunctionType(_INT, [_POINTER]),
    "PyErr_Occurred": ir.FunctionType(_POINTER, []),
    "PyErr_BadArgument": ir.FunctionType(_INT, []),
    "PyEval_SaveThread": ir.FunctionType(_POINTER, []),
    "PyEval_RestoreThread": ir.FunctionType(ir.VoidType(), [_POINTER]),
    "Py_BuildValue": ir.FunctionType(_POINTER, [_POINTER], var_arg=True),
}


_PAUSES: dict[str, tuple[Any, ...]] = {"x86_64": ("llvm.x86.sse2.pause",), "aarch64": ("llvm.aarch64.hint", 1)}
_PAUSE = _PAUSES.get(llvm.get_process_triple().partition("-")[0])
"""Instruction that tells the processor of a loop that waits, and its arguments."""

_ALLOWED = {*C_FUNCTIONS, "memcpy", "memmove", "memset"}


class _Library(codegen.AOTCodeLibrary):
    """Code of a kernel or of a part. It is optimised once, as a whole, by :func:`_emitted`."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def _optimize_final_module(self) -> None:
        defined = [function for function in self._final_module.functions if not function.is_declaration]
        if self.name not in [function.name for function in defined]:
            return
        for function in defined:
            if function.name not in (self.name, native(self.name)):
                function.linkage = "internal"


class _Codegen(codegen.JITCPUCodegen):
    """Code generator for this processor that does not load what it makes."""

    _library_class: Any = _Library

    def machine_options(self) -> dict[str, Any]:
        """Options of LLVM's target machine."""
        options: dict[str, Any] = {}
        self._customize_tm_options(options)
        return options

    def _add_module(self, module: Any) -> None:
        pass

    def _customize_tm_options(self, options: Any) -> None:
        """Use this processor's instructions, but the costs of a plain one.

        By the costs of some processors LLVM unrolls loops until they fill a cache of thousands of instructions, which
        doubles the time of compiling and makes nothing faster here.
        """
        super()._customize_tm_options(options)
        if llvm.get_process_triple().startswith("x86_64"):
            options["cpu"] = "x86-64"


_ELEMENTS = imputils.Registry("elements of arrays")


def _pointer(context: Any, builder: Any, kind: Any, array: Any, index_kind: Any, index: Any) -> Any:
    """Pointer to an element of a contiguous array; None if the index names more than one."""
    kinds = list(index_kind) if isinstance(index_kind, types.BaseTuple) else [index_kind]
    if len(kinds) != kind.ndim or not all(isinstance(one, types.Integer) for one in kinds):
        return None
    indices = cgutils.unpack_tuple(builder, index) if isinstance(index_kind, types.BaseTuple) else [index]
    model = context.data_model_manager[kind]
    shape = builder.extract_value(array, model.get_field_position("shape"))
    place = None
    for axis, (one, value) in enumerate(zip(kinds, indices, strict=True)):
        whole = context.cast(builder, value, one, types.intp)
        if place is not None:
            whole = builder.add(builder.mul(place, builder.extract_value(shape, axis)), whole)
        place = whole
    return builder.gep(builder.extract_value(array, model.get_field_position("data")), [place], inbounds=True)


@_ELEMENTS.lower(operator.getitem, types.Array, types.Integer)
@_ELEMENTS.lower(operator.getitem, types.Array, types.BaseTuple)
def _read(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """``array[i, j]``. An index is never negative in a kernel; to allow for it takes half the time of compiling."""
    kind, index_kind = signature.args
    pointer = _pointer(context, builder, kind, arguments[0], index_kind, arguments[1])
    if pointer is not None:
        return arrayobj.load_item(context, builder, kind, pointer)
    numba_way = (
        arrayobj.getitem_array_tuple if isinstance(index_kind, types.BaseTuple) else arrayobj.getitem_arraynd_intp
    )
    return numba_way(context, builder, signature, arguments)


@_ELEMENTS.lower(operator.setitem, types.Array, types.Integer, types.Number)
@_ELEMENTS.lower(operator.setitem, types.Array, types.BaseTuple, types.Number)
def _write(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """``array[i, j] = number``."""
    kind, index_kind, value_kind = signature.args
    pointer = _pointer(context, builder, kind, arguments[0], index_kind, arguments[1])
    if pointer is None:
        raise NotImplementedError("kernels set one element at a time")
    arrayobj.store_item(context, builder, kind, context.cast(builder, arguments[2], value_kind, kind.dtype), pointer)
    return context.get_dummy_value()


class _SingleAssignment:
    """Numba's static single assignment, in a fraction of the time: only blocks that name a variable are rewritten."""

    def run_pass(self, state: Any) -> bool:
        """Give every assignment a variable of its own."""
        state.func_ir.generator_info = None
        state.func_ir.blocks = blocks = canonicalize_cfg(state.func_ir.blocks)
        graph = compute_cfg_from_blocks(blocks)
        fronts = ssa._iterated_domfronts(graph)
        handler = ssa._FixSSAVars(ssa._CacheListVars())
        places = _places(blocks)
        for name in ssa._find_defs_violators(blocks, graph):
            named = {label: block for label, block in blocks.items() if label in places[name]}
            named, definitions = ssa._fresh_vars(named, name)
            work = ssa._make_states(blocks)
            joins: dict[int, list[Any]] = defaultdict(list)
            locations = ssa._compute_phi_locations(fronts, definitions)
            work.update(varname=name, defmap=definitions, phimap=joins, cfg=graph, phi_locations=locations)
            blocks.update(ssa._run_block_rewrite(named, work, handler))
            for label, added in joins.items():
                blocks[label].body = added + blocks[label].body
        state.func_ir._definitions = build_definitions(blocks)
        return True


class _WithoutJoins(typed_passes.PreLowerStripPhis):
    """Numba's removal of the joins of variables, without the lifetimes of variables, which nobody asks for."""

    def run_pass(self, state: Any) -> bool:
        """Assign what is joined at the ends of the joined blocks."""
        state.func_ir = self._strip_phi_nodes(state.func_ir)
        state.func_ir._definitions = build_definitions(state.func_ir.blocks)
        return True


def _places(blocks: Any) -> dict[str, set[int]]:
    """Labels of the blocks that name a variable, by its name."""
    places: dict[str, set[int]] = defaultdict(set)
    for label, block in blocks.items():
        for statement in block.body:
            for variable in statement.list_vars():
                places[variable.name].add(label)
    return places


class _Passes:
    """What of Numba's passes over a function a kernel needs, without the checks between them."""

    pipeline_name = "hs_tracker_cv"
    exec_times: ClassVar[dict[str, Any]] = {}
    passes = (
        untyped_passes.TranslateByteCode,
        untyped_passes.FixupArgs,
        untyped_passes.GenericRewrites,
        _SingleAssignment,
        typed_passes.NopythonTypeInference,
        _WithoutJoins,
        typed_passes.NativeLowering,
        typed_passes.NoPythonBackend,
    )

    def run(self, state: Any) -> None:
        """Compile a function."""
        for one in self.passes:
            one().run_pass(state)


class _Compiler(compiler.CompilerBase):
    """Numba's compiler with these passes."""

    def define_pipelines(self) -> list[Any]:
        """Return the one way to compile."""
        return [_Passes()]


class _Context(cpu.CPUContext):
    """Numba's compiler for the processor, whose functions have our entry and no runtime of Numba's."""

    returned: Any
    """What the kernel being compiled returns to other kernels."""

    def load_additional_registries(self) -> None:
        super().load_additional_registries()
        self.install_registry(_ELEMENTS)

    @global_compiler_lock
    def init(self) -> None:
        self.is32bit = False
        self._internal_codegen = _Codegen("hs_tracker_cv")
        externals.c_math_functions.install(self)

    def get_external_function_type(self, fndesc: Any) -> Any:
        """Type of a kernel's function for other kernels: values as they are, arrays too."""
        return ir.FunctionType(
            self.get_value_type(fndesc.restype), [self.get_value_type(one) for one in fndesc.argtypes]
        )

    def call_external_function(self, builder: Any, callee: Any, argtys: Any, args: Any) -> Any:
        """Call another kernel."""
        return builder.call(callee, args)

    def post_lowering(self, mod: Any, library: Any) -> None:
        if self.fastmath:
            fastmathpass.rewrite_module(mod, self.fastmath)

    def create_cpython_wrapper(self, library: Any, fndesc: Any, *_: Any, **__: Any) -> None:
        library.add_ir_module(_Entry(self, fndesc, library.name).module)

    def get_executable(self, library: Any, fndesc: Any, env: Any) -> Any:
        return _dynfunc.make_function(fndesc.lookup_module(), fndesc.qualname, "", 0, env, (library,))


class _Typing(Context):
    """Numba's rules for types, each asked once: it tries dozens of them at every operator of a function."""

    def __init__(self) -> None:
        super().__init__()
        self._known: dict[Any, Any] = {}

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a function for types of arguments."""
        if kws or not isinstance(func, (types.Function, BuiltinFunctionType)):
            return super().resolve_function_type(func, args, kws)
        key = (func, tuple(args))
        if key not in self._known:
            self._known[key] = super().resolve_function_type(func, args, kws)
        return self._known[key]


class _Target(registry.CPUTarget):
    """Numba's CPU target with that compiler and these rules."""

    @cached_property
    def _toplevel_typing_context(self) -> Any:
        return _Typing()

    @cached_property
    def _toplevel_target_context(self) -> Any:
        return _Context(self.typing_context, self._target_name)


class _Dispatcher(registry.CPUDispatcher):
    """Numba's dispatcher for parts of kernels, compiled for that target."""

    targetdescr = _Target("cpu")


class _Entry:
    """LLVM module of a function `name` (self, arguments, count): a ``METH_FASTCALL`` function of Python's."""

    def __init__(self, context: Any, fndesc: Any, name: str) -> None:
        self.context = context
        self.module = context.create_module("entry")
        function = ir.Function(self.module, ir.FunctionType(_POINTER, [_POINTER, _POINTER, _SIZE]), name=name)
        self.builder = ir.IRBuilder(function.append_basic_block("start"))
        self.wrong = function.append_basic_block("wrong")
        self.failed = function.append_basic_block("failed")
        arrays = sum(isinstance(kind, types.Array) for kind in fndesc.argtypes)
        room = self.builder.alloca(ir.ArrayType(_BUFFER, arrays))
        self.builder.store(ir.Constant(room.type.pointee, None), room)  # what is not filled need not be released
        self.buffers = [self.builder.gep(room, [_INT(0), _INT(i)]) for i in range(arrays)]
        self._unless("==", function.args[2], _SIZE(len(fndesc.argtypes)), self.wrong)
        result = self._run(fndesc, self._values(function.args[1], fndesc.argtypes))
        self._release()
        self.builder.ret(self._boxed(fndesc.restype, result))
        self.builder.position_at_end(self.wrong)
        self._call("PyErr_BadArgument")
        self.builder.branch(self.failed)
        self.builder.position_at_end(self.failed)
        self._release()
        self.builder.ret(_POINTER(None))
        self._define_native(fndesc, native(name))

    def _define_native(self, fndesc: Any, name: str) -> None:
        """Define the function that other kernels call."""
        outside = ExternalFunctionDescriptor(name, self.context.returned, fndesc.argtypes)
        function = self.context.declare_external_function(self.module, outside)
        builder = ir.IRBuilder(function.append_basic_block())
        _, result = self._call_compiled(builder, fndesc, list(function.args))
        builder.ret(self.context.cast(builder, result, fndesc.restype, outside.restype))

    def _call(self, name: str, *arguments: Any) -> Any:
        return self.builder.call(cgutils.get_or_insert_function(self.module, _C_FUNCTIONS[name], name), arguments)

    def _unless(self, comparison: str, a: Any, b: Any, otherwise: Any) -> None:
        """Go on if the comparison holds."""
        further = self.builder.append_basic_block()
        self.builder.cbranch(self.builder.icmp_unsigned(comparison, a, b), further, otherwise)
        self.builder.position_at_end(further)

    def _release(self) -> None:
        for buffer in self.buffers:
            self._call("PyBuffer_Release", self.builder.bitcast(buffer, _POINTER))

    def _values(self, arguments: Any, kinds: Any) -> list[Any]:
        """Convert Python's arguments to Numba's values."""
        objects = self.builder.bitcast(arguments, _POINTER.as_pointer())
        buffers = iter(self.buffers)
        values = []
        for index, kind in enumerate(kinds):
            argument = self.builder.load(self.builder.gep(objects, [_SIZE(index)]))
            if isinstance(kind, types.Array):
                values.append(self._array(argument, kind, next(buffers)))
            else:
                values.append(self._number(argument, kind))
        self._unless("==", self._call("PyErr_Occurred"), _POINTER(None), self.failed)
        return values

    def _number(self, argument: Any, kind: Any) -> Any:
        if isinstance(kind, types.Float):
            value = self._call("PyFloat_AsDouble", argument)
            return value if kind.bitwidth == 64 else self.builder.fptrunc(value, ir.FloatType())
        if isinstance(kind, types.Boolean):
            return self.builder.icmp_signed("!=", self._call("PyObject_IsTrue", argument), _INT(0))
        return self._call("PyLong_AsLongLong", argument)

    def _array(self, argument: Any, kind: Any, buffer: Any) -> Any:
        builder, context = self.builder, self.context

        def field(index: int) -> Any:
            return builder.load(builder.gep(buffer, [_INT(0), _INT(index)]))

        got = self._call("PyObject_GetBuffer", argument, builder.bitcast(buffer, _POINTER), _INT(_CONTIGUOUS))
        self._unless("==", got, _INT(0), self.failed)
        self._unless("==", field(5), _INT(kind.ndim), self.wrong)
        letter, known = builder.load(field(6)), ir.IntType(1)(0)
        for same in _letters(np.dtype(str(kind.dtype))):
            known = builder.or_(known, builder.icmp_unsigned("==", letter, letter.type(ord(same))))
        self._unless("==", known, ir.IntType(1)(1), self.wrong)
        shape, strides = (
            [
                builder.load(builder.gep(builder.bitcast(field(i), _SIZE.as_pointer()), [_INT(k)]))
                for k in range(kind.ndim)
            ]
            for i in (7, 8)
        )
        array = cgutils.create_struct_proxy(kind)(context, builder)
        data = builder.bitcast(field(0), context.get_value_type(kind.dtype).as_pointer())
        arrayobj.populate_array(array, data, shape, strides, kind.dtype.bitwidth // 8, None)
        return array._getvalue()

    def _run(self, fndesc: Any, values: list[Any]) -> Any:
        """Call the function, as a rule without the interpreter's lock; see `loading.TURN` and `loading.UNTIL`."""
        builder = self.builder
        turn = ir.GlobalVariable(self.module, _INT, TURN)
        until = ir.GlobalVariable(self.module, _SIZE, UNTIL)
        kept = builder.load(ir.GlobalVariable(self.module, _SIZE, KEPT))
        # A difference without a sign: a clock set back by a machine that slept must not keep the lock for hours.
        keeps = builder.icmp_unsigned("<", builder.sub(builder.load(until), self._ticks()), kept)
        thread = builder.alloca(_POINTER)
        with builder.if_then(builder.not_(keeps)):
            builder.store(self._call("PyEval_SaveThread"), thread)
            builder.store_atomic(_INT(0), turn, "release", 4)
        status, result = self._call_compiled(builder, fndesc, values)
        with builder.if_then(builder.not_(keeps)):
            self._wait(turn)
            before = self._ticks()
            self._call("PyEval_RestoreThread", builder.load(thread))
            after = self._ticks()
            with builder.if_then(builder.icmp_unsigned(">", builder.sub(after, before), _SIZE(LONG))):
                builder.store(builder.add(after, kept), until)
        self._unless("==", status.is_error, ir.IntType(1)(0), self.wrong)
        return result

    def _ticks(self) -> Any:
        """Time of the processor's clock; a time long past where it has none that everybody can read."""
        if not llvm.get_process_triple().startswith("x86_64"):
            return _SIZE(1 << 63)
        kind = ir.FunctionType(_SIZE, [])
        return self.builder.call(cgutils.get_or_insert_function(self.module, kind, "llvm.readcyclecounter"), [])

    def _wait(self, turn: Any) -> None:
        """Wait, for a short while and awake, until no thread is between two kernels; see `loading.TURN`."""
        builder = self.builder
        before = builder.block
        look, take, again, go = (builder.append_basic_block(name) for name in ("look", "take", "again", "go"))
        patience = builder.load(ir.GlobalVariable(self.module, _INT, PATIENCE))
        builder.branch(look)
        builder.position_at_end(look)
        looks = builder.phi(_INT)
        looks.add_incoming(_INT(0), before)
        free = builder.icmp_signed("==", builder.load_atomic(turn, "monotonic", 4), _INT(0))
        builder.cbranch(free, take, again)
        builder.position_at_end(take)
        taken = builder.icmp_signed("==", builder.atomic_rmw("xchg", turn, _INT(1), "acquire"), _INT(0))
        builder.cbranch(taken, go, again)
        builder.position_at_end(again)
        if _PAUSE:
            name, *values = _PAUSE
            kind = ir.FunctionType(ir.VoidType(), [_INT] * len(values))
            builder.call(cgutils.get_or_insert_function(self.module, kind, name), [_INT(value) for value in values])
        more = builder.add(looks, _INT(1))
        looks.add_incoming(more, again)
        builder.cbranch(builder.icmp_signed("<", more, patience), look, go)
        builder.position_at_end(go)

    def _call_compiled(self, builder: Any, fndesc: Any, values: list[Any]) -> Any:
        """Status and result of the compiled function."""
        convention = self.context.call_conv
        function_type = convention.get_function_type(fndesc.restype, fndesc.argtypes)
        function = cgutils.get_or_insert_function(self.module, function_type, fndesc.llvm_func_name)
        return convention.call_function(
            builder, function, fndesc.restype, fndesc.argtypes, values, attrs=("noinline",)
        )

    def _boxed(self, kind: Any, value: Any) -> Any:
        """Return a new Python object: a float, an integer, a tuple of such, or None."""
        kinds: list[Any] = [kind]
        values = [value]
        if isinstance(kind, types.BaseTuple):
            kinds = list(kind)
            values = [self.builder.extract_value(value, i) for i in range(len(kinds))]
        elif kind == types.none:
            kinds = []
        template = "".join("d" if isinstance(one, types.Float) else "L" for one in kinds)
        wide = [types.float64 if letter == "d" else types.int64 for letter in template]
        values = [self.context.cast(self.builder, *one) for one in zip(values, kinds, wide, strict=False)]
        if isinstance(kind, types.BaseTuple):
            template = f"({template})"
        return self._call("Py_BuildValue", self.context.insert_const_string(self.module, template), *values)


def _letters(kind: Any) -> list[str]:
    """Letters by which the buffer protocol names an element type: C has several names for one size."""
    return [letter for letter in "?bBhHiIlLqQfd" if np.dtype(letter) == kind]


def _compiled(value: Part | Kernel, function: FunctionType) -> Any:
    """Return a part as a function compiled into its callers; another kernel as one that is linked to them."""
    if isinstance(value, Kernel):
        return types.ExternalFunction(native(value.name), returned(value)(*signature(value)))
    options = {**_SETTINGS, "nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, **value.options}
    return _Dispatcher(function, targetoptions=options, pipeline_class=_Compiler)


@contextmanager
def _uncollected() -> Iterator[None]:
    """No garbage collection: it takes a sixth of the time, and the compiler keeps nearly all that it makes."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collecting:
            if not gc.get_freeze_count():
                gc.freeze()  # and what is unfrozen is old: otherwise all of it would be looked at now
                gc.unfreeze()
            gc.enable()


def object_codes(kernels: Sequence[Kernel]) -> list[bytes | None]:
    """Compile kernels to object files with the functions of their names, for Python and for other kernels.

    While Numba turns a kernel into LLVM code, a second thread has LLVM optimise the one before: that is nearly half
    of the work, and Python's lock is not needed for it.

    Returns
    -------
    list of bytes or None
        None for a kernel that cannot be had in this way.
    """
    with _uncollected(), ThreadPoolExecutor(1) as pool:
        pending = [_started(kernel, pool) for kernel in kernels]
        return [None if one is None or one.exception() else one.result() for one in pending]


def _started(kernel: Kernel, pool: Executor) -> Future[bytes] | None:
    try:
        with global_compiler_lock:
            bitcode = _bitcode(kernel)
        linked = frozenset(native(other.name) for other in kernel.called())
        return pool.submit(_emitted, kernel.name, bitcode, linked)
    except Exception:  # a Numba whose inner names have changed, or a kernel that needs more than bare code
        return None


def _bitcode(kernel: Kernel) -> bytes:
    """LLVM code of a kernel with all its parts, not optimised."""
    target = _Dispatcher.targetdescr
    flags = compiler.Flags()
    options = {**_SETTINGS, "nopython": True, "no_cfunc_wrapper": True, **kernel.options}
    target.options.parse_as_flags(flags, options)
    target.target_context.returned = returned(kernel)
    result = compiler.compile_extra(
        target.typing_context,
        target.target_context,
        function_for(kernel, _compiled),
        args=signature(kernel),
        return_type=None,
        flags=flags,
        locals={},
        library=target.target_context.codegen().create_library(kernel.name),
        pipeline_class=_Compiler,
    )
    return bytes(result.library.emit_bitcode())


def _emitted(name: str, bitcode: bytes, linked: frozenset[str]) -> bytes:
    """Optimise LLVM code and turn it into an object file.

    In an LLVM context of its own, which no other thread uses: so the two calls that take long can do without
    llvmlite's lock, which all others of its functions take.
    """
    module = llvm.parse_bitcode(bitcode, llvm.create_context())
    options = _Dispatcher.targetdescr.target_context.codegen().machine_options()
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(**options)
    tuning = llvm.create_pipeline_tuning_options(speed_level=_CONFIG.OPT)
    tuning.loop_vectorization, tuning.slp_vectorization = _CONFIG.LOOP_VECTORIZE, _CONFIG.SLP_VECTORIZE
    builder = llvm.create_pass_builder(machine, tuning)
    _unlocked("LLVMPY_RunNewModulePassManager")(builder.getModulePassManager(), module, builder)
    _check(name, str(module), linked)
    with ffi.OutputString() as error:
        buffer = _unlocked("LLVMPY_TargetMachineEmitToMemory")(machine, module, 1, error)
        if not buffer:
            raise RuntimeError(str(error))
    try:
        return ctypes.string_at(ffi.lib.LLVMPY_GetBufferStart(buffer), ffi.lib.LLVMPY_GetBufferSize(buffer))
    finally:
        ffi.lib.LLVMPY_DisposeMemoryBuffer(buffer)


def _unlocked(name: str) -> Any:
    """Return one of llvmlite's C functions without its lock."""
    return getattr(ffi.lib, name)._cfn


def _check(name: str, text: str, linked: frozenset[str]) -> None:
    """Raise where optimised code could not run in another process."""
    if "numba.dynamic.globals" in text:
        raise ValueError(f"{name} holds the address of an object of this process")
    foreign = {called for called in _called(text) if not called.startswith("llvm.")} - _ALLOWED - linked
    if foreign:  # LLVM's loader would end the process for them
        raise ValueError(f"{name} calls {', '.join(sorted(foreign))}")


def _called(code: str) -> set[str]:
    """Names of the functions that LLVM code calls and does not define."""
    return set(re.findall(r'\bcall [^@\n]*@"?([^"( ]+)', code)) - set(
        re.findall(r'\ndefine [^@\n]*@"?([^"( ]+)', code)
    )
