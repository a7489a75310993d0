# `make demo` and `make test` each work alone, from a fresh copy; `make help` lists what there is.

PYTHON ?= python3
# What the demo needs, and what the checks and the tests need, beyond the plain installation.
DEMO_EXTRAS ?= video
TEST_EXTRAS ?= dev,docs,video,render,baselines,dask,export
DEMO_OUT ?= demo-result

VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt

.DEFAULT_GOAL := help
.PHONY: help setup demo docs checks loops test dist clean

help:  ## list these targets
	@awk -F ':.*## ' '/^[a-z]+:.*## /{printf "make %-7s %s\n", $$1, $$2}' Makefile

setup: $(VENV)/installed-test  ## make .venv with all that the checks and the tests need

demo: $(VENV)/installed-demo  ## track a synthetic shot and write the whole result folder
	$(BIN)/torchsphere demo --out $(DEMO_OUT) --overwrite
	@echo "The result is in $(DEMO_OUT)/: open $(DEMO_OUT)/report.html in a browser, or read track.csv, kinematics.csv and summary.json."

docs: $(VENV)/installed-test  ## build the pages: docs/_build/index.html
	# A link that leads nowhere, a command or an object that is gone: every warning is an error.
	OMP_NUM_THREADS=1 $(BIN)/python -m sphinx -W --keep-going -q -E docs docs/_build

checks: $(VENV)/installed-test  ## ruff, mypy, import contracts and the pages
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(MAKE) docs

loops: $(VENV)/installed-test  ## compile the loops over pixels
	OMP_NUM_THREADS=1 $(BIN)/torchsphere warm-up

test: $(VENV)/installed-test  ## all checks and all tests
	# The loops compile on one core while the checks run on another.
	$(MAKE) -j2 --output-sync=target checks loops
	# The order of the files is that of tests/conftest.py, not of their numbers of tests.
	# One thread each: processes whose threads compete for the cores slow each other down many times over.
	# Compiled files are kept, whatever the environment says: a hundred of the tests' processes import the package.
	OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder --durations=10

dist: $(VENV)/installed-test  ## build sdist and wheel and check them: dist/
	rm -rf dist
	$(BIN)/python -m build --no-isolation
	$(BIN)/python -m twine check --strict dist/*

clean:  ## remove .venv, caches, builds and the demo's result
	rm -rf $(VENV) $(DEMO_OUT) docs/_build build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find torchsphere render experiments tests -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true

# One pip call with the constraints, so that no other torch is ever fetched first.
$(VENV)/installed-demo: pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) -e '.[$(DEMO_EXTRAS)]'
	@touch $@

$(VENV)/installed-test: pyproject.toml constraints.txt | $(BIN)/python
	$(INSTALL) -e '.[$(TEST_EXTRAS)]'
	@touch $@ $(VENV)/installed-demo

$(BIN)/python:
	@command -v $(PYTHON) >/dev/null || { \
		echo "torchsphere needs Python 3.11 or newer, but there is no '$(PYTHON)'. Install it, or name one: make PYTHON=/path/to/python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "torchsphere needs Python 3.11 or newer, but '$(PYTHON)' is $$($(PYTHON) --version 2>&1). Name a newer one: make PYTHON=/path/to/python3.12 ..." >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); \
		echo "'$(PYTHON) -m venv' failed: on Debian and Ubuntu, install the package python3-venv." >&2; exit 1; }
