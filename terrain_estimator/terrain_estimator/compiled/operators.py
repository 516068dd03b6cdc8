# SPDX-FileCopyrightText: 2026 The terrain_estimator authors
# SPDX-License-Identifier: Apache-2.0
"""How each TorchScript operator is written in C++, by its ATen name; the C++ is in runtime/.

An argument is a C++ expression, or None where the operator was given None.
"""

from collections.abc import Callable

Argument = str | None
Writer = Callable[..., str]

KINDS = {
    "4": "Kind::kInteger",
    "6": "Kind::kSingle",
    "7": "Kind::kReal",
    "11": "Kind::kBoolean",
}
"""Kinds of a tensor by PyTorch's code of the dtype."""


def _kind(dtype: Argument, default: str) -> str:
    """Return the kind of a new tensor whose ``dtype`` may be left open."""
    if dtype is None:
        return default
    return KINDS.get(dtype, f"kind_of({dtype})")


def _place(value: Argument) -> str:
    return "Place()" if value is None else value


def _list(value: Argument) -> str:
    return "Integers()" if value is None else value


def _call(name: str, count: int) -> Writer:
    """Return a writer of a call with the first ``count`` arguments; the others do not matter."""

    def write(*arguments: Argument) -> str:
        if None in arguments[:count]:
            raise ValueError(f"{name} was given None")
        return f"{name}({', '.join(str(a) for a in arguments[:count])})"

    return write


def _infix(sign: str) -> Writer:
    return lambda a, b: f"({a} {sign} {b})"


def _scaled(name: str) -> Writer:
    """Return a writer of add or sub, whose third argument is a factor."""

    def write(a: str, b: str, factor: str) -> str:
        if factor != "1":
            raise ValueError(f"aten::{name} has a factor of {factor}")
        return f"{name}({a}, {b})"

    return write


def _clamp(x: str, low: Argument, high: Argument) -> str:
    ends = ["std::nullopt" if end is None else f"Scalar({end})" for end in (low, high)]
    return f"clamp({x}, {ends[0]}, {ends[1]})"


def _solve_triangular(a: str, b: str, upper: str, left: str, unit: str) -> str:
    if (upper, left, unit) != ("false", "true", "false"):
        raise ValueError("linalg_solve_triangular takes lower factors on the left")
    return f"linalg_solve_triangular({a}, {b})"


def _topk(x: str, k: str, _dimension: str, largest: str, is_sorted: str) -> str:
    if (largest, is_sorted) != ("true", "true"):
        raise ValueError("topk gives the largest, in order")
    return f"topk({x}, {k})"


def _pad(x: str, margins: str, mode: str, value: Argument) -> str:
    if mode != '"constant"':
        raise ValueError(f"pad has the mode {mode}")
    return f"pad({x}, {margins}, {value or '0.0'})"


def _lower(name: str, count: int) -> Writer:
    """Return a writer of an operator on a Cholesky factor, which has to be the lower one."""

    def write(*arguments: str) -> str:
        if arguments[count] != "false":
            raise ValueError(f"{name} takes lower factors")
        return f"{name}({', '.join(arguments[:count])})"

    return write


def _linear(x: str, weight: str, bias: Argument) -> str:
    if not weight.startswith("constants()."):
        raise ValueError("linear takes constant weights")
    return f"linear({x}, {weight}, {bias or 'Tensor()'})"


def _nan_to_num(x: str, nan: Argument, high: Argument, low: Argument) -> str:
    if high is not None or low is not None:
        raise ValueError("nan_to_num takes a number for NaN alone")
    return f"nan_to_num({x}, {nan or '0.0'})"


def _bounded(name: str) -> Writer:
    """Return a writer of a reduction over dimensions that may be left open."""
    return lambda x, dims, keep, *_: f"{name}({x}, {_list(dims)}, {keep})"


def _one_dimension(name: str) -> Writer:
    return lambda x, d, keep: f"{name}({x}, Integers{{{d}}}, {keep})"


def _filled(value: str) -> Writer:
    return lambda sizes, dtype, *_: f"full({sizes}, {value}, {_kind(dtype, 'Kind::kSingle')})"


def _filled_like(value: str) -> Writer:
    return lambda x, dtype, *_: f"full_like({x}, {value}, {_kind(dtype, f'{x}.kind()')})"


def _arange(start: str, end: str, step: str, dtype: Argument) -> str:
    whole = all(part.lstrip("-").isdigit() or not _is_real(part) for part in (start, end, step))
    default = "Kind::kInteger" if whole else "Kind::kSingle"
    return f"arange({start}, {end}, {step}, {_kind(dtype, default)})"


def _is_real(literal: str) -> bool:
    return "." in literal and literal.replace(".", "").replace("-", "").replace("e", "").isdigit()


_TENSOR_PAIRS = {
    "mul": "mul",
    "div": "div",
    "lt": "lt",
    "le": "le",
    "gt": "gt",
    "ge": "ge",
    "eq": "eq",
    "ne": "ne",
    "remainder": "remainder",
}
_SAME_NAME = [
    "neg", "abs", "sign", "square", "reciprocal", "sqrt", "sin", "cos", "tan", "asin", "tanh",
    "exp", "expm1", "log", "erfc", "floor", "isfinite", "isnan", "isinf", "logical_not", "numpy_T",
    "nonzero",
]  # fmt: skip
_NUMBERS = {
    "add": "+",
    "sub": "-",
    "mul": "*",
    "lt": "<",
    "le": "<=",
    "gt": ">",
    "ge": ">=",
    "eq": "==",
    "ne": "!=",
}

WRITERS: dict[str, Writer] = {
    **{f"aten::{name}": _call(name, 1) for name in _SAME_NAME},
    **{
        f"aten::{name}.{form}": _call(own, 2)
        for name, own in _TENSOR_PAIRS.items()
        for form in ("Tensor", "Scalar")
    },
    **{
        f"aten::{name}.{form}": _scaled(name)
        for name in ("add", "sub")
        for form in ("Tensor", "Scalar")
    },
    "aten::__and__.Tensor": _call("logical_and", 2),
    "aten::__or__.Tensor": _call("logical_or", 2),
    **{f"aten::{name}.int": _infix(sign) for name, sign in _NUMBERS.items()},
    **{f"aten::{name}.float": _infix(_NUMBERS[name]) for name in ("add", "sub", "mul", "lt")},
    "aten::mul.float_int": _infix("*"),
    "aten::rsub.Scalar": lambda a, b, factor: f"rsub({a}, {b})" if factor == "1" else "",
    "aten::minimum": _call("minimum", 2),
    "aten::hypot": lambda a, b: f"sqrt(add(square({a}), square({b})))",
    "aten::maximum": _call("maximum", 2),
    "aten::atan2": _call("atan2", 2),
    "aten::pow.Tensor_Scalar": _call("pow", 2),
    "aten::pow.Tensor_Tensor": _call("pow", 2),
    "aten::igamma": _call("igamma", 2),
    "aten::addcmul": _call("addcmul", 4),
    "aten::lerp.Scalar": _call("lerp", 3),
    "aten::where.self": _call("where", 3),
    "aten::where.ScalarOther": _call("where", 3),
    "aten::where.ScalarSelf": _call("where", 3),
    # two numbers become singles, as torch's default
    "aten::where.Scalar": lambda x, a, b: f"where({x}, full_like({x}, {a}, Kind::kSingle), {b})",
    "aten::clamp": _clamp,
    "aten::clone": _call("clone", 1),
    "aten::nan_to_num": _nan_to_num,
    # views
    "aten::size": _call("size", 1),
    "aten::size.int": _call("size", 2),
    "aten::dim": lambda x: f"int64_t{{{x}.dimensions()}}",
    "aten::narrow": _call("narrow", 4),
    "aten::slice.Tensor": lambda x, d, a, b, s: f"slice({x}, {d}, {_place(a)}, {_place(b)}, {s})",
    "aten::select.int": _call("select", 3),
    "aten::unsqueeze": _call("unsqueeze", 2),
    "aten::squeeze.dim": _call("squeeze", 2),
    "aten::permute": _call("permute", 2),
    "aten::transpose.int": _call("transpose", 3),
    "aten::movedim.intlist": _call("movedim", 3),
    "aten::movedim.int": lambda x, a, b: f"movedim({x}, Integers{{{a}}}, Integers{{{b}}})",
    "aten::expand": _call("expand", 2),
    "aten::diagonal": _call("diagonal", 4),
    "aten::broadcast_tensors": _call("broadcast_tensors", 1),
    "aten::expand_as": lambda x, other: f"expand({x}, size({other}))",
    "aten::view": _call("view", 2),
    "aten::reshape": _call("reshape", 2),
    "aten::flatten.using_ints": _call("flatten", 3),
    "aten::unflatten.int": _call("unflatten", 3),
    "aten::unbind.int": _call("unbind", 2),
    "aten::split_with_sizes": _call("split_with_sizes", 3),
    # new tensors
    "aten::full": lambda n, v, t, *_: f"full({n}, {v}, {_kind(t, 'Kind::kSingle')})",
    "aten::full_like": lambda x, v, t, *_: f"full_like({x}, {v}, {_kind(t, f'{x}.kind()')})",
    "aten::zeros": _filled("0.0"),
    "aten::ones": _filled("1.0"),
    "aten::zeros_like": _filled_like("0.0"),
    "aten::ones_like": _filled_like("1.0"),
    "aten::eye": lambda n, t, *_: f"eye({n}, {n}, {_kind(t, 'Kind::kSingle')})",
    "aten::eye.m": lambda n, m, t, *_: f"eye({n}, {m}, {_kind(t, 'Kind::kSingle')})",
    "aten::arange": lambda end, t, *_: _arange("0", end, "1", t),
    "aten::arange.start": lambda start, end, t, *_: _arange(start, end, "1", t),
    "aten::arange.start_step": lambda start, end, step, t, *_: _arange(start, end, step, t),
    # TorchScript rounds the number to a single, whatever the dtype
    "aten::tensor.float": lambda v, t, *_: (
        f"as_kind(as_kind(Tensor::of(Scalar({v})), Kind::kSingle), {_kind(t, 'Kind::kSingle')})"
    ),
    "aten::to.dtype": lambda x, t, *_: f"as_kind({x}, {_kind(t, '')})",
    "aten::cat": _call("cat", 2),
    "aten::stack": _call("stack", 2),
    "aten::repeat": _call("repeat", 2),
    "aten::repeat_interleave.self_int": lambda x, n, d, _: (
        f"repeat_interleave({x}, {n}, {_place(d)})"
    ),
    "aten::diag": lambda x, k: f"diag({x})" if k == "0" else "",
    "aten::diag_embed": lambda x, k, a, b: (
        f"diag_embed({x})" if (k, a, b) == ("0", "-2", "-1") else ""
    ),
    "aten::copy_": lambda to, source, _: f"copy_into({to}, {source})",
    # choosing
    "aten::index_select": _call("index_select", 3),
    "aten::index.Tensor": _call("index", 2),
    "aten::gather": _call("gather", 3),
    "aten::topk": _topk,
    "prim::tolist": _call("tolist", 1),
    # reductions
    "aten::sum": _call("sum", 1),
    "aten::sum.dim_IntList": _bounded("sum"),
    "aten::mean": _call("mean", 1),
    "aten::mean.dim": _bounded("mean"),
    "aten::amax": _bounded("amax"),
    "aten::amin": _bounded("amin"),
    "aten::any": _call("any", 1),
    "aten::any.dim": _one_dimension("any"),
    "aten::all": _call("all", 1),
    "aten::all.dim": _one_dimension("all"),
    "aten::argmax": lambda x, d, _: f"argmax({x}, {_place(d)})",
    "aten::softmax.int": _call("softmax", 2),
    "aten::log_softmax.int": _call("log_softmax", 2),
    # linear algebra
    "aten::matmul": _call("matmul", 2),
    "aten::dot": _call("dot", 2),
    "aten::mv": _call("mv", 2),
    "aten::linear": _linear,
    "aten::linalg_cholesky_ex": _lower("linalg_cholesky_ex", 1),
    "aten::cholesky_solve": _lower("cholesky_solve", 2),
    "aten::cholesky_inverse": _lower("cholesky_inverse", 1),
    "aten::linalg_solve_triangular": _solve_triangular,
    # numbers, lists and dictionaries
    "aten::Bool.Tensor": _call("truth", 1),
    "aten::Int.Tensor": _call("integer", 1),
    "aten::__and__.bool": _infix("&&"),
    "aten::__not__": lambda a: f"(!{a})",
    "aten::neg.float": lambda a: f"(-{a})",
    "aten::div": lambda a, b: f"(Scalar({a}).value / Scalar({b}).value)",
    "aten::div.float": _infix("/"),
    "aten::pow.float_int": lambda a, b: f"elementary::pow({a}, static_cast<double>({b}))",
    "aten::floordiv.int": lambda a, b: f"({a} / {b})",
    "prim::max.float": lambda a, b: f"std::max<double>({a}, {b})",
    "prim::min.int": lambda a, b: f"std::min<int64_t>({a}, {b})",
    "prim::dtype": _call("dtype", 1),
    "aten::__is__": lambda a, b: f"is_none({a})" if b is None else "",
    "aten::__isnot__": lambda a, b: f"(!is_none({a}))" if b is None else "",
    "aten::len.t": lambda a: f"{a}.count()",
    "aten::__getitem__.t": lambda a, k: f"{a}[{k}]",
    "aten::append.t": lambda a, x: f"{a}.append({x})",
    "aten::add.t": _call("joined", 2),
    "aten::mul.left_t": _call("repeated", 2),
    "aten::slice.t": lambda a, x, y, step: f"part({a}, {_place(x)}, {_place(y)}, {step})",
    "aten::count.int": _call("occurrences", 2),
    "aten::__contains__.int_list": lambda a, x: f"(occurrences({a}, {x}) > 0)",
    "aten::list.t": lambda a: f"{a}",
    **{f"aten::__getitem__.Dict_{k}": lambda a, x: f"{a}[{x}]" for k in ("int", "str")},
    **{f"aten::_set_item.{k}": lambda a, x, v: f"{a}.set({x}, {v})" for k in ("int", "str")},
    **{f"aten::__contains__.{k}": lambda a, x: f"{a}.contains({x})" for k in ("int", "str")},
    "aten::copy.Dict_str": lambda a: f"{a}.copy()",
    "aten::keys.int": lambda a: f"{a}.keys()",
}

LIBRARY: dict[str, Writer] = {
    "torch.nn.functional.pad": _pad,
}
"""The same for functions of torch that are TorchScript themselves."""
