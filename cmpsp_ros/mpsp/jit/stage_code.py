"""Machine code of a stage's CasADi function for all stages, several of them side by side.

CasADi's own evaluation takes ten to fifty times as long. LLVM comes with numba; the arithmetic is
that of CasADi, operation by operation, so the numbers are the same.
"""

import struct
from collections.abc import Iterable, Sequence
from functools import cache
from itertools import accumulate, pairwise
from typing import Any, Final

import llvmlite.binding as llvm
import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, entry_for
from cmpsp_ros.mpsp.jit.intrinsics import call_with_data

_LANES: Final = 4
_INPUTS: Final = 4
# Beyond this compiling takes longer than it saves.
_LONGEST: Final = 20_000
_ARITHMETIC: Final = {'ADD': 'fadd', 'SUB': 'fsub', 'MUL': 'fmul', 'DIV': 'fdiv'}
_COMPARISONS: Final = {'LT': 'olt', 'LE': 'ole', 'EQ': 'oeq', 'NE': 'une'}
_LIBRARY: Final = {
    1: ('sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'sinh', 'cosh', 'tanh', 'asinh', 'acosh',
        'atanh', 'exp', 'log', 'log1p', 'expm1', 'sqrt', 'erf', 'ceil', 'floor', 'fabs'),
    2: ('pow', 'atan2', 'hypot', 'fmin', 'fmax', 'fmod', 'copysign'),
}  # fmt: skip


class StageCode:
    """A compiled function of one stage."""

    def __init__(
        self, function: Any, lanes: int = _LANES, shapes: Sequence[tuple[int, ...]] = ()
    ) -> None:
        """Compile a CasADi function of SX with dense outputs, for at least `lanes` stages.

        It has four inputs at most. Outputs are vectors unless `shapes` are given, in which rows
        come first.

        Raises:
            NotImplementedError: It has an operation without machine code here, or too many.
        """
        sizes = [function.numel_out(i) for i in range(function.n_out())]
        self._ends = np.cumsum([0, *sizes]).tolist()
        self._shapes = shapes or [(size,) for size in sizes]
        self._none = (np.empty((0, 0)),) * (_INPUTS - function.n_in())
        self._places: dict[int, list[tuple[slice, tuple[int, ...]]]] = {}
        self._engine, self._address = _compiled(_Text(function, lanes).text)

    def __call__(self, *inputs: Array) -> list[Array]:
        """Outputs at all stages, which are their first axis, for inputs ``(stages, numbers)``."""
        stages = len(inputs[0])
        if stages not in self._places:
            parts = zip(pairwise(self._ends), self._shapes, strict=True)
            self._places[stages] = [
                (slice(stages * a, stages * b), (stages, *shape)) for (a, b), shape in parts
            ]
        whole = np.empty(stages * self._ends[-1])
        self._run(inputs, whole, stages)
        return [whole[place].reshape(shape) for place, shape in self._places[stages]]

    def roll_out(self, start: Array, *inputs: Array) -> Array:
        """States ``(stages + 1, n)``, each the only output for the last one; of a single lane."""
        stages = len(inputs[0])
        states = np.empty((stages + 1, len(start)))
        states[0] = start
        self._run((states, *inputs), states[1:].ravel(), stages)
        return states

    def _run(self, inputs: Iterable[Array], out: Array, stages: int) -> None:
        held = [np.ascontiguousarray(each, float) for each in inputs]
        _caller()(self._address, *held, *self._none, out, stages)


@allocation_free
def _call_stages(address: int, x: Array, u: Array, p: Array, w: Array, out: Array, n: int) -> None:
    call_with_data(address, (x, u, p, w, out), n)


@cache
def _caller() -> Any:
    """Entry of `_call_stages`: ctypes takes longer for an address than for the arithmetic."""
    table = np.empty((0, 0))
    return entry_for(_call_stages, 0, table, table, table, table, np.empty(0), 0)


class _Text:
    """A function in LLVM's language; the last lanes overlap others where stages are left over."""

    def __init__(self, function: Any, lanes: int) -> None:
        if function.n_instructions() > _LONGEST:
            raise NotImplementedError(f'{function.n_instructions()} operations')
        self._function, self._lanes, self._count = function, lanes, 0
        self._type = f'<{lanes} x double>' if lanes > 1 else 'double'
        self._bits = f'<{lanes} x i1>' if lanes > 1 else 'i1'
        self._lines: list[str] = []
        self._work: dict[int, str] = {}
        self._loaded: dict[tuple[int, int], str] = {}
        names = _names()
        for k in range(function.n_instructions()):
            self._instruction(names[function.instruction_id(k)], k)
        self.text = self._whole()

    def _instruction(self, name: str, k: int) -> None:
        f, work = self._function, self._work
        if name == 'OUTPUT':
            array, index = f.instruction_output(k)
            self._store(array, index, work[f.instruction_input(k)[0]])
            return
        if name == 'CONST':
            found = self._constant(f.instruction_constant(k))
        elif name == 'INPUT':
            found = self._load(*f.instruction_input(k))
        else:
            found = self._operation(name, [work[i] for i in f.instruction_input(k)])
        work[f.instruction_output(k)[0]] = found

    def _operation(self, name: str, of: list[str]) -> str:
        kind, one = self._type, self._constant(1.0)
        if name in _ARITHMETIC:
            return self._line(f'{_ARITHMETIC[name]} {kind} {of[0]}, {of[1]}')
        if name in _COMPARISONS:
            return self._number(self._line(f'fcmp {_COMPARISONS[name]} {kind} {of[0]}, {of[1]}'))
        if name in {'SQ', 'TWICE'}:
            return self._operation('MUL' if name == 'SQ' else 'ADD', [of[0], of[0]])
        if name == 'INV':
            return self._operation('DIV', [one, of[0]])
        if name == 'ASSIGN':
            return of[0]
        if name == 'NEG':
            return self._line(f'fneg {kind} {of[0]}')
        if name == 'NOT':
            return self._operation('EQ', [of[0], self._constant(0.0)])
        if name in {'AND', 'OR'}:
            bits = [self._is_true(each) for each in of]
            return self._number(self._line(f'{name.lower()} {self._bits} {bits[0]}, {bits[1]}'))
        if name == 'IF_ELSE_ZERO':
            zero = self._constant(0.0)
            chosen = f'{self._bits} {self._is_true(of[0])}, {kind} {of[1]}, {kind} {zero}'
            return self._line(f'select {chosen}')
        if name == 'SIGN':
            above, below = (
                self._operation('LT', pair)
                for pair in ([self._constant(0.0), of[0]], [of[0], self._constant(0.0)])
            )
            return self._operation('SUB', [above, below])
        name = 'pow' if name == 'CONSTPOW' else name.lower()
        if name in _LIBRARY[len(of)]:
            return self._each(name, of)
        raise NotImplementedError(name)

    def _is_true(self, number: str) -> str:
        return self._line(f'fcmp une {self._type} {number}, {self._constant(0.0)}')

    def _number(self, bits: str) -> str:
        return self._line(f'uitofp {self._bits} {bits} to {self._type}')

    def _line(self, code: str) -> str:
        self._count += 1
        self._lines.append(f'%r{self._count} = {code}')
        return f'%r{self._count}'

    def _each(self, name: str, of: list[str]) -> str:
        """Call of a library function for each lane."""
        return self._joined(
            self._line(f'call double @{name}({", ".join(f"double {each}" for each in arguments)})')
            for arguments in zip(*map(self._split, of), strict=True)
        )

    def _split(self, vector: str) -> list[str]:
        if self._lanes == 1:
            return [vector]
        picked = (f'extractelement {self._type} {vector}, i32 {i}' for i in range(self._lanes))
        return [self._line(each) for each in picked]

    def _joined(self, numbers: Any) -> str:
        *rest, last = [*numbers] if self._lanes == 1 else ['undef', *numbers]
        if not rest:
            return str(last)
        vector = str(rest[0])
        for lane, number in enumerate([*rest[1:], last]):
            vector = self._line(f'insertelement {self._type} {vector}, double {number}, i32 {lane}')
        return vector

    def _place(self, array: str, size: int, index: int, lane: int) -> str:
        offset = lane * size + index
        return self._line(f'getelementptr double, ptr {array}, i64 {offset}')

    def _load(self, array: int, index: int) -> str:
        size = self._function.numel_in(array)
        if (array, index) not in self._loaded:
            places = [self._place(f'%x{array}', size, index, i) for i in range(self._lanes)]
            self._loaded[array, index] = self._joined(
                self._line(f'load double, ptr {place}') for place in places
            )
        return self._loaded[array, index]

    def _store(self, array: int, index: int, value: str) -> None:
        size, first = self._function.numel_out(array), self._function.n_in()
        for lane, number in enumerate(self._split(value)):
            place = self._place(f'%x{first + array}', size, index, lane)
            self._lines.append(f'store double {number}, ptr {place}')

    def _constant(self, value: float) -> str:
        bits = f'0x{struct.unpack("<Q", struct.pack("<d", value))[0]:016X}'
        same = ', '.join([f'double {bits}'] * self._lanes)
        return f'<{same}>' if self._lanes > 1 else bits

    def _whole(self) -> str:
        f, lanes = self._function, self._lanes
        sizes = [f.numel_in(i) for i in range(f.n_in())]
        outputs = [f.numel_out(i) for i in range(f.n_out())]
        declared = [
            f'declare double @{name}({", ".join(["double"] * count)}) nounwind readnone'
            for count, names in _LIBRARY.items()
            for name in names
        ]
        arrays = [
            line
            for i, before in enumerate(accumulate(outputs[:-1], initial=0), len(sizes))
            for line in (
                f'%b{i} = mul i64 %n, {before}',
                f'%a{i} = getelementptr double, ptr %out, i64 %b{i}',
            )
        ]
        starts = [
            line
            for i, size in enumerate(sizes + outputs)
            for line in (
                f'%o{i} = mul i64 %k, {size}',
                f'%x{i} = getelementptr double, ptr %a{i}, i64 %o{i}',
            )
        ]
        given = ', '.join(
            f'ptr %a{i}' if i < len(sizes) else f'ptr %none{i}' for i in range(_INPUTS)
        )
        return '\n'.join([
            *declared,
            f'define void @stages({given}, ptr %out, i64 %n) {{', 'entry:', *arrays,
            f'%last = sub i64 %n, {lanes}', 'br label %loop', 'loop:',
            '%at = phi i64 [0, %entry], [%next, %loop]',
            '%over = icmp sgt i64 %at, %last', '%k = select i1 %over, i64 %last, i64 %at',
            *starts, *self._lines,
            f'%next = add i64 %at, {lanes}', '%more = icmp slt i64 %next, %n',
            'br i1 %more, label %loop, label %exit', 'exit:', 'ret void', '}', '',
        ])  # fmt: skip


@cache
def _names() -> dict[int, str]:
    """CasADi's operations by number."""
    import casadi  # noqa: PLC0415 (an optional extra)

    return {getattr(casadi, name): name[3:] for name in dir(casadi) if name.startswith('OP_')}


def _compiled(text: str) -> tuple[Any, int]:
    """The engine that holds the machine code, and its address."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly(text)
    machine = llvm.Target.from_default_triple().create_target_machine(
        opt=1,
        cpu=llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten(),
        jit=True,
    )
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return engine, int(engine.get_function_address('stages'))
