"""Installations that are read-only, without a home, or of packages that do not fit each other."""

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from parmps.errors import InputError, InstallationError
from parmps.installation import fitting
from parmps.kernels.cache import temporary_place

PACKAGE = Path(__file__).parents[1] / "parmps"


@pytest.fixture
def read_only(tmp_path):
    """A copy of the package beside which no cache can be made, not even by root; what runs Python with it."""
    shutil.copytree(PACKAGE, tmp_path / "parmps", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "parmps" / "kernels" / "__pycache__").touch()
    (tmp_path / "temporary").mkdir()
    (tmp_path / "here").mkdir()
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "XDG_"))}
    environment |= {"PYTHONPATH": str(tmp_path), "TMPDIR": str(tmp_path / "temporary"), "HOME": os.devnull}

    def run(*words, **changes):
        return subprocess.run(
            [sys.executable, "-B", *words], cwd=tmp_path / "here", env=environment | changes, capture_output=True,
            text=True, timeout=120, stdin=subprocess.DEVNULL,
        )  # fmt: skip

    return run


KERNEL = """
import numpy as np
from parmps.kernels.poisson import sort_rows
sort_rows(np.array([0, 2], np.int32), np.array([1, 0], np.int32), np.zeros(2))
"""


def test_without_a_place_of_its_own_the_cache_is_in_the_temporary_directory(read_only, tmp_path):
    done = read_only("-m", "parmps", "schema")
    assert done.returncode == 0 and "spacing" in done.stdout, done.stderr
    place = tmp_path / "temporary" / f"parmps-{os.getuid()}"
    assert place.stat().st_mode & 0o777 == 0o700
    assert read_only("-c", KERNEL).returncode == 0
    compiled = {path: path.stat().st_mtime_ns for path in place.rglob("*.nbc")}
    assert compiled
    assert read_only("-c", KERNEL).returncode == 0
    assert {path: path.stat().st_mtime_ns for path in place.rglob("*.nbc")} == compiled, "compiled anew"
    assert not list((tmp_path / "here").iterdir())


def test_a_temporary_directory_that_is_not_the_users_own_is_not_used(read_only, tmp_path, monkeypatch):
    place = tmp_path / "temporary" / f"parmps-{os.getuid()}"
    (tmp_path / "elsewhere").mkdir(mode=0o700)
    place.symlink_to(tmp_path / "elsewhere")
    done = read_only("-m", "parmps", "schema")
    assert done.returncode == 2 and done.stdout == ""
    assert re.fullmatch(r"parmps: error: NUMBA_CACHE_DIR: .*not of this user alone.*\n", done.stderr)
    assert read_only("-m", "parmps", "schema", NUMBA_CACHE_DIR=str(tmp_path / "given")).returncode == 0
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    place.unlink()
    place.mkdir(mode=0o777)
    place.chmod(0o777)
    with pytest.raises(InputError, match="not of this user alone"):
        temporary_place()


def test_packages_that_do_not_fit_give_one_message(read_only, tmp_path):
    (tmp_path / "h5py.py").write_text("raise ValueError('numpy.dtype size changed, may indicate\\nincompatibility')")
    done = read_only("-m", "parmps", "schema")
    assert done.returncode == 4 and done.stdout == ""
    assert re.fullmatch(r"parmps: error: h5py does not fit numpy [\d.]+ \(numpy.dtype .*\): install.*\n", done.stderr)
    assert read_only("-m", "parmps", "schema", OMPI_COMM_WORLD_RANK="1").stderr == ""
    with pytest.raises(InstallationError, match="x cannot be used: No module named 'x'"), fitting("x"):
        importlib.import_module("x")


def test_an_installation_has_all_packages_and_the_command():
    tomllib = pytest.importorskip("tomllib")
    content = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())
    packages = {".".join(path.parent.relative_to(PACKAGE.parent).parts) for path in PACKAGE.rglob("__init__.py")}
    assert set(content["tool"]["setuptools"]["packages"]) == packages
    assert all((PACKAGE / name).exists() for name in content["tool"]["setuptools"]["package-data"]["parmps"])
    module, function = content["project"]["scripts"]["parmps"].split(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_the_program_names_no_files_that_only_a_clone_has():
    for path in PACKAGE.rglob("*.py"):
        tree = ast.parse(path.read_text())
        docstrings = [id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)]
        texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and id(node) not in docstrings]
        found = [node.value for node in texts if re.search(r"\b(postproc|jobs|docs|tools)/", str(node.value))]
        assert not found, path
