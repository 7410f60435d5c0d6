# Needs only Python 3.11 or newer, pip and make. Everything else goes into .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
OUTPUT ?= demo

.PHONY: demo test coverage audit docs site lint clean

demo: $(VENV)/.installed
	$(BIN)/calibtool demo -o $(OUTPUT) --force

test: $(VENV)/.tests-installed lint
	$(BIN)/python -m pytest -n auto

coverage: $(VENV)/.tests-installed
	$(BIN)/python -m pytest -n auto --cov --cov-report=term-missing:skip-covered

# Known holes in what is installed; skipped, with the reason, where the list of them is not reached.
audit: $(VENV)/.tests-installed
	$(BIN)/python benchmarks/audit.py

docs: $(VENV)/.installed
	$(BIN)/python docs/generate.py

site: $(VENV)/.docs-installed
	$(BIN)/python docs/generate.py
	$(BIN)/python -m mkdocs build --strict

lint: $(VENV)/.tests-installed
	$(BIN)/ruff check .
	$(BIN)/mypy

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

$(VENV)/.tests-installed: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[test]'
	touch $@

$(VENV)/.docs-installed: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[docs]'
	touch $@

clean:
	rm -rf $(VENV) demo build dist site
