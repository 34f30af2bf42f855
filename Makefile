# `make walk` and `make test` are all that a fresh machine with Python 3.11 or later needs.

PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
ARGS ?=

# One thread in each of the processes that walk: more only slow each other down.
export OPENBLAS_NUM_THREADS = 1
export OMP_NUM_THREADS = 1

.PHONY: walk test quick lint types clean

walk: $(VENV)/.installed  ## install, and run the paper's study (ARGS="--seed 1" and so on)
	$(BIN)/python -m drake_gait.optimize $(ARGS)

test: $(VENV)/.installed-dev  ## install, and run all tests
	$(BIN)/python -m pytest $(ARGS)

quick: $(VENV)/.installed-dev  ## the tests that take seconds
	$(BIN)/python -m pytest -m "not slow" $(ARGS)

lint: $(VENV)/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

$(VENV)/bin/python:
	@$(PYTHON) -c "import sys; sys.version_info >= (3, 11) or sys.exit('Python 3.11 or later is needed: make PYTHON=python3.11')"
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml constraints.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[dev]"
	touch $@

clean:
	rm -rf $(VENV) build dist .mypy_cache .pytest_cache .ruff_cache
