# Two commands: `make demo` and `make test`. Everything lives in .venv.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo test campaigns check venv dev coverage-campaign blind bench faults faults-all firmware-check formats import-formats bench-import real wheel docs clean

demo: $(VENV)/.installed
	$(BIN)/hdbench demo

# The checks run beside the tests, which wait for devices and deadlines; `make check` looks at types for all three systems.
# Compiled modules are kept: every worker and some hundred commands would compile them again.
test: $(VENV)/.formats
	@mkdir -p build; tools/check $(BIN) "$$($(BIN)/python -c 'import sys; print(sys.platform)')" >build/check.txt 2>&1 & check=$$!; \
	PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal -q; tests=$$?; \
	wait $$check; checks=$$?; cat build/check.txt; exit $$((tests + checks))

# What the tests leave out: many records for one figure, and more cases of the same kind.
campaigns: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal -q -m campaign

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
	$(BIN)/python tools/coverage.py loop

blind: $(VENV)/.dev
	$(BIN)/python tools/blind --full --processes $$(nproc) --out build/blind
	$(BIN)/python tools/blind --rivals 150 --processes $$(nproc) --out build/blind
	$(BIN)/python tools/blind/null.py --records 2100 --processes $$(nproc) --out build/blind
	$(BIN)/python tools/blind --report build/blind --write

# Break what can be broken: a twentieth of the campaign, and the whole with its table written.
faults: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python tools/faults/campaign.py --share 0.05

faults-all: $(VENV)/.dev
	OMP_NUM_THREADS=1 $(BIN)/python tools/faults/campaign.py --share 1 --write docs/reliability.md
	OMP_NUM_THREADS=1 $(BIN)/python tools/faults/soak.py --hours 8

# The exported filter on this machine and on an emulated Cortex-M4F; says what is missing.
firmware-check: $(VENV)/.installed
	@for tool in cc arm-none-eabi-gcc qemu-system-arm; do \
	    command -v $$tool >/dev/null || echo "missing: $$tool (Debian: gcc, gcc-arm-none-eabi, qemu-system-arm)"; \
	done
	$(BIN)/hdbench export --model report-6 --out build/firmware
	$(MAKE) -C build/firmware all double sanitize
	@if command -v arm-none-eabi-gcc >/dev/null && command -v qemu-system-arm >/dev/null; then \
	    $(MAKE) -C build/firmware target; \
	else echo "not run on a Cortex-M4F: tools are missing"; fi

# Readers of logs with the libraries that they need; `import-formats` adds 2 000 mutated files of each format.
formats: $(VENV)/.formats
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist worksteal -q tests/importing/test_formats.py

import-formats: formats
	$(BIN)/python tools/import_fuzz.py

$(VENV)/.formats: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev,logs]" mcap netCDF4 polars XlsxWriter
	touch $@

# Sdist and wheel: built, looked into, installed into a bare environment and used there. `cibuildwheel` builds the
# wheels of all three systems by [tool.cibuildwheel] of pyproject.toml.
wheel: $(VENV)/.dev
	$(BIN)/python tools/wheel.py

$(VENV)/.bench: $(VENV)/.dev
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable ".[dev,bench]"
	touch $@

# Reading a million rows of each format, beside the library alone.
bench-import: $(VENV)/.formats
	$(BIN)/python tools/bench_import.py

# docs/public-logs.md: every public record in HDBENCH_DATA, from its raw file to a diagnosis.
real: $(VENV)/.formats
	OMP_NUM_THREADS=1 $(BIN)/python tools/real.py

# Speed beside the libraries that do the same; the table goes to docs/performance.md.
bench: $(VENV)/.bench
	$(BIN)/python tools/bench.py --write docs/performance.md

# The documentation as a site in build/site; the reference pages are made from the code first.
docs: $(VENV)/.dev
	$(BIN)/python tools/docs_reference.py --write
	$(BIN)/zensical build --strict

clean:
	rm -rf $(VENV) build dist *.egg-info
