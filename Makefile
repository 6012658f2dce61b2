PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed

.PHONY: help demo test test-fast check format bench reference clean

help:  ## Show this list.
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

$(INSTALLED): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --constraint constraints.txt torch
	$(BIN)/pip install --quiet --constraint constraints.txt --editable '.[test]'
	@touch $@

demo: $(INSTALLED)  ## Install, run the quickstart study, print its table and the report's path.
	$(BIN)/glossbench run quickstart

test: $(INSTALLED)  ## All tests, a process for each core and one more.
	$(BIN)/python -m pytest -n auto --dist loadfile --no-loadscope-reorder

test-fast: $(INSTALLED)  ## The tests that take no time, of every part: those that tests/slow.txt does not list.
	$(BIN)/python -m pytest -n auto --dist loadfile -m "not slow"

check: $(INSTALLED)  ## Format, lint and types.
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

format: $(INSTALLED)  ## Mend format and lint.
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(INSTALLED)  ## Measure this machine.
	$(BIN)/glossbench bench

reference: $(INSTALLED)  ## Write docs/reference from the registries.
	$(BIN)/python -m glossbench info --write docs/reference

clean:  ## Remove the environment and all results.
	rm -rf $(VENV) results build *.egg-info
