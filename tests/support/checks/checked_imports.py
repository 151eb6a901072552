"""Puts the checker of `checked_types` on every function and class of chosen modules as they are imported."""

import ast
import hashlib
import sys
from collections.abc import Collection
from importlib.abc import MetaPathFinder
from importlib.machinery import SourceFileLoader
from importlib.util import decode_source
from pathlib import Path
from types import CodeType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

MARK = f".checked-{hashlib.md5(Path(__file__).read_bytes()).hexdigest()[:8]}.pyc"
"""Ending of the compiled modules with checks: they lie beside those without."""


class _Checks(ast.NodeVisitor):
    def visit_Module(self, node: ast.Module) -> None:
        self.generic_visit(node)
        start = 0
        while start < len(node.body) and _comes_first(node.body[start]):
            start += 1
        node.body.insert(start, ast.Import([ast.alias("checked_types")]))

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        self.generic_visit(node)
        node.decorator_list.insert(0, _name_check(node))  # sees the class when `dataclass` has made its `__init__`

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.generic_visit(node)
        node.decorator_list.append(_name_check(node))  # sees the function itself: other decorators hide its types


def _comes_first(statement: ast.stmt) -> bool:
    """Whether it is a docstring or an import from `__future__`."""
    if isinstance(statement, ast.ImportFrom):
        return statement.module == "__future__"
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _name_check(place: ast.stmt) -> ast.expr:
    check = ast.Attribute(ast.Name("checked_types", ast.Load()), "check_types", ast.Load())
    return ast.fix_missing_locations(ast.copy_location(check, place))


class _CheckedLoader(SourceFileLoader):
    def source_to_code(self, data: bytes, path: str, *, _optimize: int = -1) -> CodeType:  # type: ignore[override]
        tree = ast.parse(decode_source(data), path)
        _Checks().visit(tree)
        return compile(ast.fix_missing_locations(tree), path, "exec", dont_inherit=True, optimize=_optimize)

    def get_data(self, path: str) -> bytes:
        return super().get_data(path.removesuffix(".pyc") + MARK if path.endswith(".pyc") else path)

    def set_data(self, path: str, data: "ReadableBuffer", *, _mode: int = 0o666) -> None:
        super().set_data(path.removesuffix(".pyc") + MARK, data, _mode=_mode)


class CheckedFinder(MetaPathFinder):
    """Finds the modules of these names, and has them checked."""

    def __init__(self, modules: Collection[str]) -> None:
        self._modules = frozenset(modules)

    def find_spec(self, fullname, path=None, target=None):
        """The module as it is found without checks, with another loader; None for all others."""
        if fullname not in self._modules:
            return None
        for finder in sys.meta_path:
            if finder is not self and (spec := finder.find_spec(fullname, path, target)) is not None:
                if isinstance(spec.loader, SourceFileLoader):
                    spec.loader = _CheckedLoader(spec.loader.name, spec.loader.path)
                return spec
        return None
