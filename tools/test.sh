#!/usr/bin/env bash
# Runs all tests: those of several ranks on 1 to 4, then the serial ones, two at a time. Each run has a time limit far
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

# In a new clone the tests on one rank compile nearly all kernels, in one process. The other core does tests that use
# hardly any: two that compile the same at the same time gain nothing.
beside=(tests/test_loader.py tests/test_postproc.py)
check "MPI tests on 1 rank, and ${beside[*]} beside them" \
    .venv/bin/python -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder tests/mpi "${beside[@]}"
for ranks in 2 3 4; do
    check "MPI tests on $ranks ranks" \
        mpirun --oversubscribe -n "$ranks" .venv/bin/python -m pytest -q -p no:cacheprovider tests/mpi
done
check "other tests" .venv/bin/python -m pytest -q -n 2 --ignore=tests/mpi "${beside[@]/#/--ignore=}"

if [[ ${#failed[@]} -gt 0 ]]; then
    printf '\nFAILED: %s\n' "${failed[@]}"
    exit 1
fi
