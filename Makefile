# Two commands: `make demo` and `make test`. Everything lives in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test check venv dev coverage-campaign blind bench clean

demo: $(VENV)/.installed
	$(BIN)/hdbench demo

test: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto -q
	tools/check $(BIN)

check: $(VENV)/.dev
	tools/check $(BIN)

venv: $(VENV)/.installed
dev: $(VENV)/.dev

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: $(VENV)/bin/python pyproject.toml setup.py $(wildcard hdbench/filter/kernel/*)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev]"
	touch $@

# Slow campaigns, on demand; reduced forms are in the tests.
coverage-campaign: $(VENV)/.dev
	$(BIN)/python tools/coverage_campaign.py

blind: $(VENV)/.dev
	$(BIN)/python tools/blind.py

bench: $(VENV)/.dev
	$(BIN)/python tools/bench_filter.py
	$(BIN)/python tools/bench_plant.py

clean:
	rm -rf $(VENV) build dist *.egg-info
