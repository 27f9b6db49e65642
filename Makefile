# `make` prepares .venv; `make help` lists the rest.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PIP := $(BIN)/python -m pip -qq --disable-pip-version-check
OLDEST_PIP = $(OLDEST)/bin/python -m pip -qq --disable-pip-version-check
# Ask nothing of the caller's shell: no packages and ROS libraries but those of .venv, which Python
# compiles once and not in each process.
unexport PYTHONPATH PYTHONHOME PYTHONDONTWRITEBYTECODE LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE AMENT_PREFIX_PATH

# Ubuntu 24.04 has Python 3.12. matplotlib 3.6.3 has wheels up to 3.11 and is built above that,
# which needs freetype and qhull (libfreetype-dev, libqhull-dev).
OLDEST_PYTHON ?= $(PYTHON)
OLDEST := .venv-oldest
OLDEST_STAMP := $(OLDEST)/.installed

# Three workers on two cores, of one thread each, as nodes wait for each other half of the time; then
# what the wall clock judges has the machine for itself. 5 is pytest's code where nothing is to run.
WORKERS ?= $(shell expr $$(nproc) \* 3 / 2)
PYTEST_ARGS ?=
# What test does first; .ci/run leaves it out and lints beside the tests.
LINT ?= lint
WITH_ALONE = $(shell grep -rl --include='*.py' 'pytest.mark.alone' test)
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
define run_tests
@$(ONE_THREAD) $(1)/python -m pytest -ra -n $(WORKERS) --dist worksteal -m 'not alone$(2)' $(PYTEST_ARGS) || [ $$? = 5 ]
@$(1)/python -m pytest -ra -m 'alone$(2)' $(or $(PYTEST_ARGS),$(WITH_ALONE)) || [ $$? = 5 ]
endef
BASE ?= main
BENCH_ARGS ?=
DEMO_OUT ?= demo_out
FAULTS_ARGS ?= --runs 200 --json faults.json
SWEEP_ARGS ?= --region front --runs 200 --compare paper,corrected,full
DEMO_ARGS ?= --out $(DEMO_OUT)
REPRODUCE_OUT ?= reproduce_out

.DEFAULT_GOAL := setup
.PHONY: setup test test-long test-oldest test-colcon colcon lint format demo sweep reproduce peers-figure theory-figures calibration-figure mounts-figure data-flow-figure parameters ablation bench golden faults clean help

setup: $(STAMP) ## make .venv with ROS 2 Jazzy, all tools and this package, editable (default)

# --no-compile: Python compiles what it imports; pip would compile all, for half a minute.
$(STAMP): setup.py setup.cfg constraints.txt
	@echo 'Preparing $(VENV): some 150 wheels, 0.8 GB, one to three minutes ...'
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) install --no-compile --constraint constraints.txt setuptools
	@$(PIP) install --no-compile --constraint constraints.txt --no-build-isolation --editable '.[ros,test,lint,colcon]'
	@touch $@
	@echo 'Ready: $(BIN)/visual_servo --help'

test: $(STAMP) $(LINT) ## lint, then the tests of ten minutes; PYTEST_ARGS='-x test/core' for some
	$(call run_tests,$(BIN), and not long)

test-long: $(STAMP) ## what test leaves out: closed loops of benchmarks, clusters, colcon
	$(call run_tests,$(BIN), and long)

test-oldest: $(OLDEST_STAMP) ## all tests on the oldest versions that are supported; OLDEST_PYTHON=python3.12
	$(call run_tests,$(OLDEST)/bin)

$(OLDEST_STAMP): export MPLSETUPCFG := $(CURDIR)/$(OLDEST)/mplsetup.cfg
$(OLDEST_STAMP): setup.py setup.cfg constraints-oldest.txt
	@echo 'Preparing $(OLDEST): one to four minutes ...'
	@$(OLDEST_PYTHON) -m venv $(OLDEST)
	@printf '[libs]\nsystem_freetype = true\nsystem_qhull = true\n' >$(MPLSETUPCFG)
	@$(OLDEST_PIP) install --no-compile --constraint constraints-oldest.txt setuptools wheel
	@$(OLDEST_PIP) install --no-compile --constraint constraints-oldest.txt matplotlib  # built apart
	@$(OLDEST_PIP) install --no-compile --constraint constraints-oldest.txt --no-build-isolation --editable '.[ros,test,colcon]'
	@touch $@

test-colcon: $(STAMP) ## build with colcon in a scratch workspace, run what it installed
	@$(BIN)/python -m pytest -ra -m colcon test/packaging $(PYTEST_ARGS)

colcon: test-colcon

lint: $(STAMP) ## style, types, and who may import whom
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/lint-imports --no-logo

format: $(STAMP) ## put the source into the form that lint checks
	@$(BIN)/ruff check --select I --fix .
	@$(BIN)/ruff format .

demo: $(STAMP) ## four real nodes drive to the desired view; results in demo_out/; DEMO_ARGS for others
	@$(BIN)/visual_servo demo $(DEMO_ARGS)

reproduce: $(STAMP) ## the figures of the paper and a table, paper against us; in reproduce_out/
	@$(BIN)/visual_servo reproduce all --out $(REPRODUCE_OUT)

sweep: $(STAMP) ## 200 starts, three laws: table and maps in sweep_out/; SWEEP_ARGS for others
	@$(BIN)/visual_servo sweep $(SWEEP_ARGS)

peers-figure: $(STAMP) ## the figure and the table of docs/results.md, minutes
	@$(BIN)/python docs/measurements/peers_figure.py

theory-figures: $(STAMP) ## the figures of docs/theory.md
	@$(BIN)/python docs/theory_figures.py

calibration-figure: $(STAMP) ## the figure and the tables of docs/calibration.md, minutes
	@$(BIN)/python docs/calibration_figure.py

mounts-figure: $(STAMP) ## the figure and the tables of docs/results.md, half an hour
	@$(BIN)/python docs/measurements/mounts_figure.py

ablation: $(STAMP) ## each departure from the paper left out, and each alone; half an hour
	@$(BIN)/visual_servo bench ablation

parameters: $(STAMP) ## docs/parameters.md and upgrading.md from the settings
	@$(BIN)/python docs/parameters.py

data-flow-figure: $(STAMP) ## the picture of nodes and topics
	@$(BIN)/python docs/data_flow_figure.py

bench: $(STAMP) ## accuracy and speed beside the peers, minutes; BENCH_ARGS='estimation --quick'
	@$(PIP) install --no-compile --constraint constraints.txt --no-build-isolation --editable '.[bench]'
	@$(BIN)/visual_servo bench $(BENCH_ARGS)

golden: $(STAMP) ## 18 runs at BASE and now, compared step by step to the last bit; BASE=<commit>, default main
	@$(BIN)/python test/support/golden.py $(BASE)

faults: $(STAMP) ## 200 closed loops with faults, an hour; broken bags, messages; random transitions; kill -9 the recorder
	@$(BIN)/visual_servo faults $(FAULTS_ARGS)
	@BAG_MUTATIONS=200 $(BIN)/python -m pytest -ra test/bags/reading/test_fuzz.py
	@FUZZ_MESSAGES=2000 $(BIN)/python -m pytest -ra test/nodes/fuzz
	@$(BIN)/python -m pytest -ra test/nodes -k random
	@RECORDER_KILLS=20 $(BIN)/python -m pytest -ra test/nodes/recording/test_recorder_process.py -k killed

clean: ## remove .venv and all that make, the tools and colcon left
	rm -rf $(VENV) $(OLDEST) build install log dist demo_out sweep_out reproduce_out *.egg-info
	rm -rf .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

help: ## list these targets
	@awk -F ' ## ' '/^[a-z-]+:.* ## / {sub(/:.*/, "", $$1); printf "  make %-18s %s\n", $$1, $$2}' Makefile
