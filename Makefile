# make run    set everything up and run the paper's study
# make test   set everything up and run the tests; make test-kills and test-how-to run the long ones, test-fast a few
# make docs   set everything up and build the documentation
# After either, the daily command is .venv/bin/snakemake --cores 2

# The first Python 3.11 on the path; expanded only when the environment is made.
IS_311 := import sys; sys.exit(sys.version_info[:2] != (3, 11))
PYTHON ?= $(or $(shell for p in python3.11 python3 python; do \
	$$p -c '$(IS_311)' >/dev/null 2>&1 && echo $$p && break; done),python3)
CORES ?= 2
VENV := .venv
BIN := $(VENV)/bin
LOCKS := envs/build.lock envs/requirements.lock

export OMP_NUM_THREADS ?= 1
export NO_MKDOCS_2_WARNING := true

.PHONY: run test test-fast test-page test-how-to test-kills test-cluster cluster mutants setup docs lint format lock clean

run: setup
	$(BIN)/snakemake --cores $(CORES)

test: setup
	$(BIN)/python -m pytest -n $(CORES) --dist loadfile $(ARGS)

# Under a minute: the rooms that neither simulate nor close a loop, and what the code promises about itself.
FAST := architecture config designs surrogates robots cycles docs/test_tables.py
test-fast: setup
	$(BIN)/python -m pytest -q -n $(CORES) --dist loadfile -m "not slow and not long" $(addprefix tests/,$(FAST)) $(ARGS)

# The default study's own page in a browser, against its tables; skips, saying why, where either is not there.
test-page: setup
	$(BIN)/python -m pytest -m long -rs tests/reporting/test_default_page.py $(ARGS)

# Each how-to page's commands to their end, from an empty folder: half an hour.
test-how-to: setup
	$(BIN)/python -m pytest -m long -rs tests/cli $(ARGS)

# Kills at 20 moments, two runs at once, a full disk, 1,000 inputs a parser: docs/reliability.md; SLURM, as below.
test-kills: cluster
	$(BIN)/python -m pytest -m long -rs tests/workflow $(ARGS)

# The smallest study through a SLURM of one node, started for it, and through a stand-in for Kubernetes:
# docs/cluster.md. Skips, saying why, where it cannot.
test-cluster: cluster
	$(BIN)/python -m pytest -m "long or not long" -rs tests/workflow/test_cluster.py \
		tests/workflow/test_kubernetes.py $(ARGS)

# Snakemake's executors and storage for clusters, beside the locked packages.
cluster: setup
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement envs/cluster.lock

# Whether the tests notice a changed operator: docs/reliability.md. ARGS: rooms, --mutants, --seed.
mutants: setup
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement envs/mutants.lock
	$(BIN)/python -u benchmarks/mutants.py $(ARGS)

setup: $(VENV)/installed

# Two stamps make the second run start at once: a changed lock makes the environment anew, a changed
# pyproject.toml only installs wearscope again.
$(VENV)/installed: $(VENV)/locked pyproject.toml
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@echo "Compiling what studies run (up to a minute) ..."
	@$(BIN)/python -m wearscope.compiled
	@touch $@

$(VENV)/locked: $(LOCKS)
	@$(PYTHON) -c '$(IS_311)' 2>/dev/null || { echo >&2 \
	"wearscope needs Python 3.11, because snakemake 9.27 needs at least 3.11 and pybullet 3.2.7 has no wheels" \
	"for anything newer; '$(PYTHON)' is not it: install it, or call 'make PYTHON=/path/to/python3.11'."; exit 1; }
	@echo "Installing the locked packages into $(VENV) (1 to 3 minutes) ..."
	@$(PYTHON) -m venv --clear $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --requirement envs/build.lock
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-build-isolation \
		--requirement envs/requirements.lock
	@touch $@

# The site, in site/; a warning is an error.
docs: setup
	$(BIN)/python -m mkdocs build --strict --quiet
	@echo "Open site/index.html; with its search: $(BIN)/python -m http.server --directory site 8000"

lint: setup
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

# Needs uv, which the environment does not hold. build.lock is what packages without a wheel are built with.
lock:
	uv pip compile --quiet --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
		--no-annotate --no-header --upgrade envs/requirements.in --output-file envs/requirements.lock
	uv pip compile --quiet --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
		--no-annotate --no-header --constraints envs/requirements.lock envs/cluster.in \
		--output-file envs/cluster.lock
	uv pip compile --quiet --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
		--no-annotate --no-header --constraints envs/requirements.lock envs/mutants.in \
		--output-file envs/mutants.lock
	awk '/^[a-z]/ {keep = /^setuptools==/} keep' envs/requirements.lock > envs/build.lock

clean:
	rm -rf $(VENV) site .pytest_cache .ruff_cache .mypy_cache
