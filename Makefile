# make demo   simulate a drive through the bundled office and build its knowledge base in demo/
# make test   lint, types, tests          make bench  the benchmarks
PYTHON ?= python3
VENV   := .venv
PY     := $(VENV)/bin/python

.PHONY: demo test lint types pytest bench clean

$(PY):
	$(PYTHON) -c 'import sys; sys.exit("Python 3.11 or newer is needed, this is " + sys.version.split()[0] if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.core: pyproject.toml | $(PY)
	$(PY) -m pip install --quiet --disable-pip-version-check -e .
	touch $@

$(VENV)/.test: pyproject.toml | $(PY)
	$(PY) -m pip install --quiet --disable-pip-version-check -e '.[test]'
	touch $@ $(VENV)/.core

demo: $(VENV)/.core
	$(VENV)/bin/hssh demo -o demo

test: lint types pytest

lint: $(VENV)/.test
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .

types: $(VENV)/.test
	$(VENV)/bin/mypy

pytest: $(VENV)/.test
	$(PY) -m pytest -q -n 2 --cov --cov-report=term:skip-covered

bench: $(VENV)/.test
	$(PY) -m tests.bench

clean:
	rm -rf $(VENV) demo .pytest_cache .mypy_cache .ruff_cache .coverage
