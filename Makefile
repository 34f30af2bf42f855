# `make walk` and `make test` are all that a fresh machine with Python 3.11 or later needs.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
ARGS ?=
# A file's tests stay in one process, which shares their fixtures.
PYTEST = $(BIN)/python -m pytest --numprocesses logical --dist loadfile --no-loadscope-reorder

.PHONY: walk test quick lint types docs release-check clean

walk: $(VENV)/.installed  ## install, and run the default study (ARGS="--seed 1" and so on)
	$(BIN)/python -m drake_gait.optimize $(ARGS)

test: $(VENV)/.installed-dev  ## install, and run all tests
	$(PYTEST) $(ARGS)

quick: $(VENV)/.installed-dev  ## the tests that take seconds
	$(PYTEST) -m "not slow" $(ARGS)

lint: $(VENV)/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

docs: $(VENV)/.installed-docs  ## build/docs/index.html; a warning is an error
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet docs build/docs

release-check: $(VENV)/.installed-dev  ## dist/: a wheel and an sdist that pass the quick tests
	$(BIN)/python tools/check_release.py

$(VENV)/bin/python:
	@$(PYTHON) -c "import sys; sys.version_info >= (3, 11) or sys.exit('Python 3.11 or later is needed: make PYTHON=python3.11')"
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[dev]"
	touch $@

$(VENV)/.installed-docs: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[docs]"
	touch $@

clean:
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache
