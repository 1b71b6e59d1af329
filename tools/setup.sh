#!/usr/bin/env bash
# Sets up what parmps needs on Debian: system packages, then a virtual environment in .venv.
# usage: tools/setup.sh [test]      "test" adds what `make test` and `make lint` need
# Does nothing when all is in place; see the README for other systems.
set -euo pipefail
cd "$(dirname "$0")/.."

level=${1:-run}
# MPI, PETSc and HDF5 come from Debian, built for each other; the rest from the Python package index.
packages=(make openmpi-bin python3-venv python3-mpi4py python3-petsc4py python3-h5py)
declare -A imports=([run]='matplotlib.pyplot, numba, parmps.figures.command, parmps.run, scipy.stats')
imports[test]="${imports[run]}, pytest, xdist.plugin, hypothesis, vtk, trimesh, manifold3d"
python=/usr/bin/python3 # Debian's own: its packages serve no other Python on the PATH

fail() {
    printf 'parmps setup: %s\n' "$*" >&2
    exit 1
}

install_packages() {
    local package missing=() root=()
    command -v apt-get dpkg-query >/dev/null || fail "this is not a Debian system (no apt-get)." \
        "Install MPI, mpi4py, petsc4py with PETSc and h5py by other means (README, \"Other systems\")," \
        "then: pip install '.[plot]'"
    for package in "${packages[@]}"; do
        [[ $(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) == installed ]] || missing+=("$package")
    done
    [[ ${#missing[@]} -gt 0 ]] || return 0
    if [[ $EUID -ne 0 ]]; then
        if sudo -n true 2>/dev/null; then
            root=(sudo -n)
        elif [[ -t 0 ]] && command -v sudo >/dev/null; then
            root=(sudo)
        else
            fail "needs an administrator once, for: apt-get install ${missing[*]}"
        fi
    fi
    echo "parmps setup: installing ${missing[*]}"
    "${root[@]}" apt-get update -qq || fail "apt-get update failed"
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive \
        apt-get install -qq -y --no-install-recommends "${missing[@]}" >/dev/null \
        || fail "could not install: ${missing[*]}"
}

# Prints the versions that packages in .venv must keep: Debian's are built for each other and for its NumPy.
constraints() {
    "$python" - "$1" <<'PYTHON'
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

sys.path.append(sys.argv[1])
major = int(version("numpy").split(".")[0])
print(f"numpy>={major},<{major + 1}")
for name in ("mpi4py", "petsc4py", "h5py"):
    with suppress(PackageNotFoundError):  # Debian 12 hides from pip which h5py there is
        print(f"{name}=={version(name)}")
PYTHON
}

# Prints the requirements of pyproject.toml, less those that Debian provides.
requirements() {
    "$python" - "$level" <<'PYTHON'
import re
import sys
import tomllib

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
wanted = project["dependencies"] + project["optional-dependencies"]["plot"]
if sys.argv[1] == "test":
    wanted += project["optional-dependencies"]["test"]
for requirement in wanted:
    if re.match(r"[\w-]+", requirement)[0] not in ("mpi4py", "petsc4py", "h5py"):
        print(requirement)
PYTHON
}

make_environment() {
    local stamp=.venv/setup-$level key kept needed petsc site
    # Without its -dev package, Debian's petsc4py lies where Python does not look.
    petsc=$({ compgen -G '/usr/lib/petscdir/petsc*/*-real/lib/python3/dist-packages' || true; } | sort -V | tail -n 1)
    [[ $petsc ]] || fail "found no petsc4py with real numbers in /usr/lib/petscdir"
    kept=$(constraints "$petsc") || fail "$python does not find what Debian's packages installed"
    key=$(cat pyproject.toml tools/setup.sh <(pwd; "$python" -V; echo "$petsc $kept") | sha256sum)
    [[ -x .venv/bin/python && -f $stamp && $(<"$stamp") == "$key" ]] && return
    echo "parmps setup: making .venv"
    "$python" -m venv --system-site-packages .venv || fail "could not make .venv"
    # pip obeys these in .venv whatever is installed there later.
    printf '%s\n' "$kept" >.venv/constraints.txt
    "$python" -c 'from pathlib import Path; print("[global]\nconstraint =", Path(".venv/constraints.txt").resolve().as_uri())' \
        >.venv/pip.conf
    mapfile -t needed < <(requirements)
    # --no-compile: Python compiles the modules that are used when they first are, in a third of the time.
    .venv/bin/python -m pip install --quiet --disable-pip-version-check --no-input --no-compile "${needed[@]}" \
        || fail "could not install: ${needed[*]}"
    site=$(.venv/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')
    # numba supports NumPy up to some version, which pip forgets when something else is installed.
    .venv/bin/python -c 'from importlib.metadata import requires
print(*(word for word in requires("numba") if word.startswith("numpy")), sep="\n")' >>.venv/constraints.txt
    printf '%s\n' "$petsc" >"$site/petsc4py-debian.pth"
    pwd >"$site/parmps.pth"
    # What every command imports is compiled here, since later processes may be forbidden to write what they compile.
    env -u PYTHONDONTWRITEBYTECODE .venv/bin/python -c "import ${imports[$level]}; numba.njit(lambda: 0)()" \
        || fail ".venv does not work"
    printf '%s' "$key" >"$stamp"
    echo "parmps setup: done"
}

install_packages
make_environment
