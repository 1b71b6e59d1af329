# The commands of parmps. Each sets up first what is missing (tools/setup.sh).

python := .venv/bin/python
# --oversubscribe: MPI counts cores, and a laptop may have fewer than ranks.
mpirun := mpirun --oversubscribe

# One thread a rank: thread pools that spin on a busy core cost far more than they bring.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
# Without these two, Open MPI refuses to start for root, as in a container.
export OMPI_ALLOW_RUN_AS_ROOT := 1
export OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1

.PHONY: help setup setup-test run test lint bench extremes hunt validate validate3d trade

help:
	@echo "make run        run jobs/sloshing.yaml on 2 ranks"
	@echo "make test       run all tests, on 1 to 4 ranks"
	@echo "make lint       check the code's style"
	@echo "make bench      measure the speed (jobs/benchmarks)"
	@echo "make extremes   find out where it breaks (jobs/extremes)"
	@echo "make hunt       run random scenes against what must always hold (jobs/hunt)"
	@echo "make validate   compare with experiments and theory (jobs/validation)"
	@echo "make validate3d the same in 3D, at the default preset: almost three hours of one core"
	@echo "make trade      measure what accuracy costs, by setting (jobs/validation/trade.*)"
	@echo "make setup      only set up; every other target does so when needed"

setup:
	@tools/setup.sh

setup-test:
	@tools/setup.sh test

run: setup
	$(mpirun) -n 2 $(python) -m parmps jobs/sloshing.yaml

test: setup-test
	@tools/test.sh

lint: setup-test
	$(python) -m ruff check

bench: setup
	$(python) jobs/benchmarks/run.py

validate: setup
	$(python) jobs/validation/run.py

validate3d: setup
	$(python) jobs/validation/run.py rest_3d standing_wave_3d surge_sway baffled_3d lateral_impact_3d edge_3d lng --preset balanced

trade: setup
	$(python) jobs/validation/trade.py
	$(python) postproc/trade.py jobs/validation/trade.csv

extremes: setup
	$(python) jobs/extremes/run.py

hunt: setup-test
	$(python) jobs/hunt/hunt.py
