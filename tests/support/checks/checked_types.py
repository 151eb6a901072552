"""The checker that wraps every function while tests run; see conftest.py.

Its price is paid by each call of each test, so functions are checked in the cheapest way that misses nothing: beartype
alone costs less than a microsecond. Sizes with names (``n`` of ``"n 3"``) must agree within a call, which takes a
context of jaxtyping, entered only where a signature has such names. jaxtyping's own decorator, a dozen times as dear,
is kept for what needs it: sizes that are computed from arguments (``"{count} 3"``), and generators.
"""

import inspect
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from dataclasses import is_dataclass
from functools import wraps
from io import BufferedIOBase, StringIO
from types import FunctionType, SimpleNamespace
from typing import IO, Any, get_args, get_type_hints

from beartype import BeartypeConf, FrozenDict, beartype
from jaxtyping import AbstractArray, TypeCheckError, jaxtyped, print_bindings

OVERRIDES = FrozenDict({IO[bytes]: IO[bytes] | BufferedIOBase})
"""What `zipfile` opens is IO[bytes] to type checkers, but lacks some of its methods."""
check_by_beartype = beartype(
    conf=BeartypeConf(is_pep484_tower=True, hint_overrides=OVERRIDES, violation_type=TypeCheckError)
)
"""Lets an int stand for a float, as PEP 484 does. What it refuses is a TypeError, as of a call that Python refuses."""
SIZES = jaxtyped("context")
"""Names of sizes that hold within one call; entered by each call anew."""


def check_types(made: Any) -> Any:
    """The function, checked at each call; the class, whose `__init__` is checked if it is a data class's."""
    if not inspect.isclass(made):
        return _check_calls(made)
    if is_dataclass(made) and not hasattr(made.__init__, "is_checked"):
        made.__init__ = _check_calls(made.__init__)
    return made


def _check_calls(function: Any) -> Any:
    """The checker is made at the first call: most functions of a program are never called by a test."""
    checked = None

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal checked
        if checked is None:
            checked = _make_checked(function)
        return checked(*args, **kwargs)

    call.is_checked = True  # type: ignore[attr-defined]
    return call


def _make_checked(function: Any) -> Callable[..., Any]:
    hints = {name: _resolve(hint, function.__globals__) for name, hint in function.__annotations__.items()}
    shapes = [shape for hint in hints.values() for shape in _find_shapes(hint)]
    copy = _annotate(function, hints)
    if inspect.isgeneratorfunction(function) or any("{" in shape.dim_str for shape in shapes):
        return jaxtyped(copy, typechecker=check_by_beartype)
    checked = check_by_beartype(copy)
    return _check_sizes(checked) if shapes else checked


def _check_sizes(checked: Callable[..., Any]) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        with SIZES:
            try:
                return checked(*args, **kwargs)
            except TypeCheckError as error:
                with redirect_stdout(StringIO()) as sizes:
                    print_bindings()
                error.add_note(sizes.getvalue())
                raise

    return call


def _resolve(hint: Any, names: dict[str, Any]) -> Any:
    """The type that an annotation names; Any where it is imported for type checkers only."""
    holder = SimpleNamespace(__annotations__={"value": hint})
    try:
        return get_type_hints(holder, names, include_extras=True)["value"]
    except Exception:
        return Any


def _find_shapes(hint: Any) -> Iterator[type[AbstractArray]]:
    if inspect.isclass(hint) and issubclass(hint, AbstractArray):
        yield hint
    for part in hint if isinstance(hint, list) else get_args(hint):
        yield from _find_shapes(part)


def _annotate(function: Any, hints: dict[str, Any]) -> Any:
    """A copy of the function with other annotations."""
    same = (function.__code__, function.__globals__, function.__name__, function.__defaults__, function.__closure__)
    copy = FunctionType(*same)
    copy.__kwdefaults__, copy.__qualname__, copy.__doc__ = (
        function.__kwdefaults__,
        function.__qualname__,
        function.__doc__,
    )
    copy.__module__, copy.__annotations__ = function.__module__, hints
    copy.__dict__.update(function.__dict__)
    return copy
