# Every target sets itself up; nothing but python3 (3.11 or newer) with venv, and make, is needed.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Of a package, the modules that are used are compiled when they first are: all of them take longer than to unpack them.
INSTALL := $(BIN)/python -m pip install --no-compile --quiet --constraint constraints.txt --editable

# An earlier revision that today's speed is held against.
REV ?= 61bf7920

.PHONY: plate wheel environments test test-all golden golden-quick golden-record lint bench bench-against fuzz docs gallery layouts clean

plate: $(VENV)/run.stamp
	$(BIN)/maskfab run layouts/upc12.toml --out build/upc12 --force

# What a file's tests share is made once, by the worker that runs the file. Slow sweeps, marked so, are left to test-all, and most examples that are drawn.
test: CHOSEN := -m "not slow"
test-all: export HYPOTHESIS_PROFILE := full
# Among them are the pages of the manual, which is built for that.
test-all: $(VENV)/docs.stamp
# Types are checked beside the tests, while those are collected; either fails the target.
# Test modules and the package are compiled once, also for the processes that tests start.
# To let every assert explain itself takes each worker ten seconds in a fresh clone: those that fail do, in a second run.
test test-all: export PYTHONDONTWRITEBYTECODE :=
test test-all: $(VENV)/dev.stamp
	$(BIN)/ruff format --check maskfab tests examples docs export_templates/referee.py
	$(BIN)/ruff check maskfab tests examples docs export_templates/referee.py
	$(BIN)/lint-imports
	$(BIN)/mypy & types=$$!; \
	export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1; \
	$(BIN)/pytest -n auto --dist loadfile --assert=plain $(CHOSEN); tests=$$?; \
	[ $$tests -ne 1 ] || $(BIN)/pytest --last-failed --last-failed-no-failures none $(CHOSEN); \
	wait $$types && exit $$tests

# What users get from every verb, held against tests/golden/: about ten minutes, a minute, or recorded anew.
golden: $(VENV)/dev.stamp
	$(BIN)/python tests/golden_set.py compare

golden-quick: $(VENV)/dev.stamp
	$(BIN)/python tests/golden_set.py compare --quick

golden-record: $(VENV)/dev.stamp
	$(BIN)/python tests/golden_set.py record

lint: $(VENV)/dev.stamp
	$(BIN)/ruff format maskfab tests examples docs export_templates/referee.py
	$(BIN)/ruff check --fix maskfab tests examples docs export_templates/referee.py
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: bench-against
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/numbers_table.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/display_table.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/eye_table.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -W ignore tests/speed_table.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python -W ignore tests/speed_plots.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/export_table.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/measure_table.py
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/restorer_table.py

# What users wait for, beside an earlier revision in an environment of its own: make bench-against REV=v0.1.0
bench-against: $(VENV)/dev.stamp
	$(BIN)/python tests/against_table.py $(REV)

fuzz: $(VENV)/dev.stamp
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/fuzz_readers.py 1000
	$(BIN)/python tests/kill_swaps.py 1000

# The manual, build/site/index.html: opens and searches from files. Its notebooks are executed now; a broken link fails it.
docs: $(VENV)/docs.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Pictures of the manual, each by the command under it; pages are photographed by Chromium.
gallery: $(VENV)/dev.stamp
	$(BIN)/python docs/gallery.py

# Layouts of the displays that ship, searched for anew.
layouts: $(VENV)/dev.stamp
	OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/keep_layouts.py

# What is installed elsewhere: dist/maskfab-VERSION-py3-none-any.whl.
wheel: $(VENV)/pip.stamp
	rm -rf dist
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

# Lowest and newest packages, every Python that is here, Debian's slim systems (as root, with mmdebstrap): an hour.
environments: wheel
	$(PYTHON) tests/environments.py

clean:
	rm -rf build dist $(VENV)

$(VENV)/pip.stamp:
	$(PYTHON) -m venv $(VENV)
	touch $@

$(VENV)/run.stamp: pyproject.toml constraints.txt $(VENV)/pip.stamp
	$(INSTALL) '.[all]'
	touch $@

$(VENV)/docs.stamp: pyproject.toml constraints.txt $(VENV)/pip.stamp
	$(INSTALL) '.[docs]'
	touch $@

$(VENV)/dev.stamp: pyproject.toml constraints.txt $(VENV)/pip.stamp
	$(INSTALL) '.[dev]'
	touch $@ $(VENV)/run.stamp
