# make demo | test | validate | bench | lint | lock | clean: each target makes .venv with the own venv of Python first
# where it is missing, and needs no other tool than Python 3.11 or newer and a package index.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check -qq
OUT ?= demo
BENCH_FLAGS ?=
TEST_FLAGS ?= -n auto --dist loadfile

.PHONY: demo test validate bench lint format lock clean
.DEFAULT_GOAL := demo

demo: $(VENV)/.installed
	$(BIN)/phys4dgen demo -o $(OUT) --overwrite

test: $(VENV)/.installed-models
	$(BIN)/python -m pytest $(TEST_FLAGS)

validate: $(VENV)/.installed-dev
	$(BIN)/python -m validation
	$(BIN)/python -m validation random --count 200

bench: $(VENV)/.installed-bench
	$(BIN)/python -m benchmarks $(BENCH_FLAGS)

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check src tests benchmarks scripts validation
	$(BIN)/ruff format --check src tests benchmarks scripts validation
	$(BIN)/pyright
	$(BIN)/lint-imports --no-logo

format: $(VENV)/.installed-dev
	$(BIN)/ruff check --fix src tests benchmarks scripts validation
	$(BIN)/ruff format src tests benchmarks scripts validation

# Each stamp says that the packages of its lock and the package itself are installed in .venv.
$(VENV)/.installed: requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "phys4dgen needs Python 3.11 or newer: make PYTHON=python3.12")'
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "Installing phys4dgen into $(VENV)"
	@$(PIP) install -r requirements.lock
	@$(PIP) install --no-deps --editable .
	@touch $@

$(VENV)/.installed-dev: requirements-dev.lock $(VENV)/.installed
	@echo "Installing the development tools into $(VENV)"
	@$(PIP) install -r requirements-dev.lock
	@touch $@

# torch, for the tests of learned models; they are skipped where no CPU build of it resolves.
$(VENV)/.installed-models: requirements-models.lock $(VENV)/.installed-dev
	@$(BIN)/python scripts/install_models.py requirements-models.lock
	@touch $@

$(VENV)/.installed-bench: requirements-bench.lock $(VENV)/.installed-dev
	@echo "Installing the peers to measure against into $(VENV)"
	@$(PIP) install -r requirements-bench.lock || echo "Some peers cannot be installed here; the benchmarks skip them."
	@touch $@

# New locks from pyproject.toml: versions alone, so that they hold for every index and platform.
COMPILE := $(BIN)/pip-compile --quiet --upgrade --no-header --no-annotate --strip-extras --no-emit-options \
	--no-emit-index-url --no-emit-trusted-host --no-emit-find-links pyproject.toml
lock: $(VENV)/.installed
	$(PIP) install pip-tools
	$(COMPILE) --output-file requirements.lock
	$(COMPILE) --extra dev --output-file requirements-dev.lock
	$(COMPILE) --extra bench --constraint requirements.lock --output-file requirements-bench.lock

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find src tests benchmarks validation -name __pycache__ -type d -prune -exec rm -rf {} +
