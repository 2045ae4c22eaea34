# make run    set everything up and run the paper's study
# make test   set everything up and run the tests, test-fast a few, test-all the slow ones too; test-kills and
#             test-how-to run the long ones
# make docs   set everything up and build the documentation
# After either, the daily command is .venv/bin/snakemake --cores 2

# The first Python on the path that will do, or one that uv knows; expanded only when the environment is made.
GOOD := import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info < (3, 14))
PYTHON ?= $(or $(shell for p in python3.11 python3.12 python3.13 python3 python; do \
	$$p -c '$(GOOD)' >/dev/null 2>&1 && echo $$p && exit; done; uv python find '>=3.11,<3.14' 2>/dev/null),python3)
# What gets one: uv where it is there, else the system's newest package, else uv itself.
GET = $(or $(if $(UV),uv python install 3.13),$(shell for v in 3.13 3.12 3.11; do \
	apt-cache show python$$v-venv >/dev/null 2>&1 && echo sudo apt install python$$v-venv && break; \
	done),pipx install uv && uv python install 3.13)
CORES ?= 2
VENV := .venv
BIN := $(VENV)/bin
# uv, where it is there, is several times as fast; `make UV=` does without it. Hashes are checked by both.
UV := $(shell command -v uv)
INSTALL = $(if $(UV),$(UV) pip install --quiet --python $(BIN)/python,$(BIN)/python -m pip install \
	--quiet --disable-pip-version-check --no-compile) --require-hashes --no-build-isolation --requirement

export OMP_NUM_THREADS ?= 1
# Byte-code is kept whatever the shell says: without it each process compiles all that it imports, for seconds.
unexport PYTHONDONTWRITEBYTECODE
export NO_MKDOCS_2_WARNING := true

.PHONY: run test test-fast test-slow test-all seconds test-page test-how-to test-kills test-cluster cluster mutants setup developed docs lint format lock clean

run: setup
	$(BIN)/snakemake --cores $(CORES)

PYTEST := $(BIN)/python -m pytest -n $(CORES) --dist loadfile --no-loadscope-reorder

# About nine minutes on two cores; what is left to test-slow has a smaller test here.
test: developed
	$(PYTEST) -m "not slow and not long" $(ARGS)

test-slow: developed
	$(PYTEST) -m "slow and not long" $(ARGS)

test-all: developed
	$(PYTEST) -m "not long" $(ARGS)

# Processor seconds of each test that takes one or more, for tests/processor_seconds.tsv.
seconds: developed
	$(BIN)/python -m pytest -q -m "not long" --processor-seconds $(or $(OUT),results/processor_seconds.tsv) $(ARGS)

# Under a minute: rooms that do not simulate, a small loop closed once, what the code promises about itself.
FAST := architecture config designs surrogates robots cycles docs/test_tables.py closed_loop/test_one_loop.py
test-fast: developed
	$(BIN)/python -m pytest -q -n $(CORES) --dist loadfile -m "not slow and not long" $(addprefix tests/,$(FAST)) $(ARGS)

# The default study's own page in a browser, against its tables; skips, saying why, where either is not there.
test-page: developed
	$(BIN)/python -m pytest -m long -rs tests/reporting/test_default_page.py $(ARGS)

# Each how-to page's commands to their end, from an empty folder: half an hour.
test-how-to: developed
	$(BIN)/python -m pytest -m long -rs tests/cli $(ARGS)

# Kills at 20 moments, two runs at once, a full disk, 2,000 inputs a parser and command: docs/reliability.md; SLURM, as below.
test-kills: cluster
	$(BIN)/python -m pytest -m long -rs tests/workflow $(ARGS)

# The smallest study through a SLURM of one node, started for it, and through a stand-in for Kubernetes:
# docs/cluster.md. Skips, saying why, where it cannot.
test-cluster: cluster
	$(BIN)/python -m pytest -m "long or not long" -rs tests/workflow/test_cluster.py \
		tests/workflow/test_kubernetes.py $(ARGS)

# Snakemake's executors and storage for clusters, next to the locked packages.
cluster: developed
	@$(INSTALL) envs/cluster.lock

# Whether the tests notice a changed operator: docs/reliability.md. ARGS: rooms, --mutants, --seed.
mutants: developed
	@$(INSTALL) envs/mutants.lock
	$(BIN)/python -u -m benchmarks.mutants $(ARGS)

setup: $(VENV)/installed

# A changed lock makes the environment anew; a changed pyproject.toml only installs wearscope again.
$(VENV)/installed: $(VENV)/locked pyproject.toml
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@echo "Compiling what studies run (up to a minute) ..."
	@$(BIN)/python -m wearscope.jobs.compiled
	@$(BIN)/snakemake --version >/dev/null
	@touch $@

$(VENV)/locked: envs/build.lock envs/requirements.lock
	@test ! -L $(VENV) || { echo >&2 "$(VENV) is a symbolic link, and making it anew would clear what others may" \
	"use: remove the link with 'rm $(VENV)', then run make again."; exit 1; }
	@$(PYTHON) -c '$(GOOD)' 2>/dev/null || { echo >&2 "wearscope needs Python 3.11, 3.12 or 3.13 with its module" \
	"venv, which '$(PYTHON)' is not: get one with '$(GET)', or call 'make PYTHON=/path/to/python3.13'."; exit 1; }
	@echo "Installing the locked packages into $(VENV) (1 to 3 minutes) ..."
	@$(PYTHON) -m venv --clear $(VENV)
	@$(INSTALL) envs/build.lock
	@$(INSTALL) envs/requirements.lock
	@touch $@

# What tests, documentation and lint need on top, and all extras.
developed: $(VENV)/developed

$(VENV)/developed: $(VENV)/installed envs/development.lock
	@echo "Installing what the tests need ..."
	@$(INSTALL) envs/development.lock
	@touch $@

# The site, in site/; a warning is an error.
docs: developed
	$(BIN)/python -m mkdocs build --strict --quiet
	@echo "Open site/index.html; with its search: $(BIN)/python -m http.server --directory site 8000"

lint: developed
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/snakefmt --check Snakefile workflow
	$(BIN)/snakemake --lint
	$(BIN)/python tools/lint_words.py

format: setup
	$(BIN)/ruff check --fix
	$(BIN)/ruff format
	$(BIN)/snakefmt Snakefile workflow

# Needs uv, which the environment does not hold. Each lock holds for every supported Python. build.lock is what
# packages without a wheel, and wearscope itself, are built with.
COMPILE := uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
	--no-emit-find-links --no-annotate --no-header
EXTRAS := export ros test lint docs
lock:
	$(COMPILE) --upgrade pyproject.toml $(addprefix --extra ,$(EXTRAS)) --group build \
		--output-file envs/development.lock
	$(COMPILE) --constraints envs/development.lock pyproject.toml --output-file envs/requirements.lock
	$(COMPILE) --constraints envs/development.lock --group build --output-file envs/build.lock
	$(COMPILE) --constraints envs/development.lock envs/cluster.in --output-file envs/cluster.lock
	$(COMPILE) --constraints envs/development.lock envs/mutants.in --output-file envs/mutants.lock

clean:
	rm -rf $(VENV) site .pytest_cache .ruff_cache .mypy_cache
