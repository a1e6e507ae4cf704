# Needs make and Python 3.11 to 3.14; everything else comes from PyPI.
#
#   VENV=/elsewhere make test     another environment than .venv
#   PYTHON=/opt/python3.12 make   another interpreter to make it with
#   JOBS=4 make test              more test processes
#   PYTEST_ARGS="-k sine" make test

VENV ?= .venv
JOBS ?= 2
PYTEST_ARGS ?=
BIN := $(VENV)/bin
CORE := $(VENV)/.installed
NETWORK := $(VENV)/.installed-network
DEV := $(VENV)/.installed-dev
DOCS := $(VENV)/.installed-docs
PLAIN_VENV := $(VENV)-plain
RELEASE_VENV := $(VENV)-release

# Run each candidate: a shim may be on the PATH and yet have no interpreter behind it.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3.14 python3 python; do \
	"$$p" -c 'import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info < (3, 15))' >/dev/null 2>&1 \
	&& echo "$$p" && break; done)

PIP_INSTALL = $(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check
COMPILE = $(BIN)/python -m compileall -q src/vibrident

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.NOTPARALLEL:
.PHONY: help demo reproduce install install-plain test test-plain quick nightly lint format bench release clean

help:  ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "make %-10s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

demo: $(CORE)  ## simulated calibration, identification and report, into demo/
	$(BIN)/vibrident demo --out demo

reproduce: $(NETWORK)  ## the paper's tables and figures beside ours, into reproduction/ (up to 20 minutes)
	$(BIN)/vibrident reproduce --out reproduction

install: pyproject.toml | $(BIN)/python  ## at once what tests, lint and docs need; each of them installs its own otherwise
	$(PIP_INSTALL) --no-compile --editable '.[dev,docs]'
	@touch $(CORE) $(NETWORK) $(DEV) $(DOCS)

# Python writes the bytecode of what demo, tests and documentation import, whatever the surroundings say: pip would
# compile all of it.
demo reproduce test test-plain quick nightly docs release: export PYTHONDONTWRITEBYTECODE :=

test: $(DEV)  ## every law once
	$(COMPILE)
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal $(if $(CI),--durations=10) $(PYTEST_ARGS)

# The way of a linear sensor from file to certificate data; tests/test_loading.py imports every module. How a shell ends
# a command and which process draws does not depend on extras.
PLAIN := tests/test_loading.py tests/result $(filter-out %_shell.py %_drawing.py,$(wildcard tests/app/cli/test_*.py))
install-plain: $(PLAIN_VENV)/.installed
test-plain: install-plain  ## tests of linear sensors on the plain install: no JAX, no extra
	$(PLAIN_VENV)/bin/python -m pytest -n $(JOBS) --dist worksteal $(PYTEST_ARGS) $(PLAIN)

ROOM ?= .
quick: $(DEV)  ## the shortest tests of one room, about 10 s: make quick ROOM=data
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal -m "unit and not slow" $(PYTEST_ARGS) tests/$(ROOM)

nightly: export JAX_DISABLE_MOST_OPTIMIZATIONS := false
nightly: $(DEV)  ## the tests that take long: Monte Carlo, every variant of a compiled network, walks through the page
	$(COMPILE)
	$(BIN)/python -m pytest -n $(JOBS) --dist worksteal -m slow --durations=10 $(PYTEST_ARGS)

lint: $(DEV)  ## style, format and types
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --pythonpath $(BIN)/python

format: $(DEV)  ## rewrite the sources in the agreed format
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(DEV)  ## benchmarks beside their targets; against peers too after make bench-peers
	$(BIN)/python -m bench $(BENCH_ARGS)

.PHONY: docs
docs: $(DOCS)  ## the documentation with its pictures, into site/
	$(BIN)/python -m docsite
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# With the lowest and the newest dependencies. PYTHONS names interpreters besides those that are found;
# RELEASE_ARGS="--only 3.12-newest" checks one environment.
release: $(RELEASE_VENV)/.installed  ## wheel, sdist and SBOM into dist/, checked on each Python that is found
	$(RELEASE_VENV)/bin/python -m release --jobs $(JOBS) $(RELEASE_ARGS) $(PLAIN)

# Environments of their own for the packages that the benchmarks compare with; nothing of them enters $(VENV).
.PHONY: bench-peers
bench-peers: $(patsubst %,bench/peers/envs/%/.installed,jax-sysid pydynamic statsmodels filterpy)

bench/peers/envs/%/.installed: bench/peers/%.txt | $(BIN)/python
	$(BIN)/python -m venv $(@D)
	$(@D)/bin/python -m pip install --quiet --disable-pip-version-check --requirement $<
	@touch $@

clean:  ## remove what make and the tools have made
	rm -rf $(CORE) $(NETWORK) $(DEV) $(DOCS) site .pytest_cache .ruff_cache .hypothesis .jax_cache build dist demo reproduction

# The pip that Python 3.11 brings takes three times as long to find the versions that suit each other. It works, too,
# where no newer one can be had.
$(BIN)/python $(PLAIN_VENV)/bin/python $(RELEASE_VENV)/bin/python:
	@test -n "$(PYTHON)" || { \
		echo "No usable Python found: expected 3.11 to 3.14 with venv (Debian: python3-venv); set PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv $(@D:/bin=)
	-$@ -m pip install --quiet --quiet --disable-pip-version-check --upgrade pip

$(CORE): pyproject.toml | $(BIN)/python
	$(PIP_INSTALL) --no-compile --editable .
	@touch $@

$(NETWORK): pyproject.toml | $(BIN)/python
	$(PIP_INSTALL) --no-compile --editable '.[network]'
	@touch $@ $(CORE)

$(DEV): pyproject.toml | $(BIN)/python
	$(PIP_INSTALL) --no-compile --editable '.[dev]'
	@touch $@ $(CORE) $(NETWORK)

$(PLAIN_VENV)/.installed: pyproject.toml | $(PLAIN_VENV)/bin/python
	$(PLAIN_VENV)/bin/python -m pip install --quiet --quiet --no-compile --editable '.[test]'
	@touch $@

$(RELEASE_VENV)/.installed: release/requirements.txt | $(RELEASE_VENV)/bin/python
	$(RELEASE_VENV)/bin/python -m pip install --quiet --quiet --requirement $<
	@touch $@

$(DOCS): pyproject.toml | $(BIN)/python
	$(PIP_INSTALL) --no-compile --editable '.[docs]'
	@touch $@ $(CORE)
