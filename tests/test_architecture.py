"""What ARCHITECTURE.md says of the modules is true."""

import ast
import re
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "parmps"
TABLE = re.findall(r"^\| (`.*?) \| (.*) \|$", (PACKAGE / "ARCHITECTURE.md").read_text(), re.MULTILINE)
"""Modules and what they hold, the highest first."""
ROW = {name: row for row, (names, _) in enumerate(TABLE) for name in re.findall(r"`(\w+)/?`", names)}
MODULES = [(path, path.relative_to(PACKAGE).parts[0].removesuffix(".py")) for path in sorted(PACKAGE.rglob("[!_]*.py"))]
"""Files, and the modules or packages that they are of."""


def imported(path):
    """What a file imports, wherever it does: names with dots."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_the_table_has_all_modules():
    assert set(ROW) == {module for _, module in MODULES}


@pytest.mark.parametrize(("path", "module"), MODULES, ids=[path.relative_to(PACKAGE).as_posix() for path, _ in MODULES])
def test_imports_go_downwards(path, module):
    for name in imported(path):
        package, _, rest = name.partition(".")
        other = rest.split(".")[0]
        if package == "parmps" and other in ROW:
            assert other == module or ROW[other] >= ROW[module], f"{module} is below {other}, which it imports"
        assert package != "petsc4py" or module == "pressure"
        # pressure: for the handle of the communicator, which it gives to PETSc
        assert package != "mpi4py" or module in ("domain", "pressure")
