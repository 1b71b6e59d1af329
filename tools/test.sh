#!/usr/bin/env bash
# Runs all tests: those under mpirun on 1 to 4 ranks, then the serial ones, two at a time. Each run has a time limit far
# above what it takes, so that nothing hangs; all run, and the exit status is 1 when one failed.
set -u
cd "$(dirname "$0")/.."

limit=${TEST_LIMIT:-900} # seconds a run
failed=()

check() {
    local name=$1
    shift
    printf '\n== %s\n' "$name"
    timeout --kill-after=10 "$limit" "$@" </dev/null || failed+=("$name (exit status $?)")
}

for ranks in 1 2 3 4; do
    check "MPI tests, $ranks rank(s)" \
        mpirun --oversubscribe -n "$ranks" .venv/bin/python -m pytest -q -p no:cacheprovider tests/mpi
done
check "serial tests" .venv/bin/python -m pytest -q -n 2 --ignore=tests/mpi

if [[ ${#failed[@]} -gt 0 ]]; then
    printf '\nFAILED: %s\n' "${failed[@]}"
    exit 1
fi
