# Needs python3 (>= 3.12) and make. Every target sets up its own virtual environment first.
VENV   := .venv
PYTHON := $(VENV)/bin/python
STAMP  := $(VENV)/.installed
BENCH  := $(VENV)/.bench
# One file at a time on each core, in the order of the folders, which ends with short files; linear algebra on a second
# thread would take the core of another test.
SIDE_BY_SIDE := OPENBLAS_NUM_THREADS=1 OMP_NUM_THREADS=1 $(PYTHON) -m pytest -q -n auto --dist loadfile
SIDE_BY_SIDE += --no-loadscope-reorder

# Every worker and every command of a test imports the same modules: one of them compiles, the others read.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: study frontier foreign test tested test-fast consistency lint collected kernels bench docs clean

study: $(STAMP)  ## the paper's study on the container ship -> reports/study/index.html
	$(VENV)/bin/pymc-ship study --out reports/study

frontier: $(STAMP)  ## every method against the Cramer-Rao bound, 25 seeds -> reports/frontier/index.html
	$(PYTHON) -m studies.frontier --out reports/frontier

foreign: $(STAMP)  ## ships of other simulators, identified and scored, an hour and more -> reports/foreign/foreign.md
	$(PYTHON) -m studies.foreign.run

test: $(STAMP)  ## lint, and every test, a file at a time on each core
	$(MAKE) --jobs 3 lint tested

tested: collected kernels
	$(SIDE_BY_SIDE)

test-fast: $(STAMP)  ## without the slow tests, under seven minutes on two cores
	$(SIDE_BY_SIDE) -m "not slow"

consistency: $(STAMP)  ## every path to a posterior against the others and against simulated truth, with the largest z
	$(PYTHON) -m pytest -q -m consistency

lint: $(STAMP)  ## style and types
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/mypy

# The workers of a test run read what this compiled. A fault here is one of theirs.
collected: $(STAMP)
	-$(PYTHON) -m pytest -qq --collect-only > /dev/null

kernels: $(STAMP)  ## compile the kernels of the commands, once for all
	folder=$$(mktemp -d) && cd $$folder && \
	$(CURDIR)/$(VENV)/bin/pymc-ship simulate container --zigzag 20/20 --duration 100 --noise 0.01 --quiet --out trial.csv && \
	$(CURDIR)/$(VENV)/bin/pymc-ship fit trial.csv --vessel container --draws 40 --quiet --out fitted && \
	rm -r $$folder

docs: $(STAMP)  ## the pages of docs/ with the docstrings -> docs/_build/index.html
	$(PYTHON) docs/make_reference.py
	$(PYTHON) -m sphinx -q -W --keep-going -b html -d docs/_build/.doctrees docs docs/_build

bench: $(BENCH)  ## ratios against named peers, measured in this run -> reports/benchmarks/benchmarks.md
	$(PYTHON) -m benchmarks.run

# A peer that cannot be installed is a row skipped with a note. shipmmg asks for Pillow < 11, which it does not need.
$(BENCH): $(STAMP)
	-$(PYTHON) -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt --editable ".[test,bench]"
	-$(PYTHON) -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt --no-deps shipmmg
	@touch $(BENCH)

$(STAMP): pyproject.toml constraints.txt
	@python3 -c 'import sys; v = sys.version_info; v >= (3, 12) or sys.exit(f"pymc_ship needs Python 3.12 or newer; python3 is {v[0]}.{v[1]}: install a newer one or put it first on PATH.")'
	python3 -m venv --clear $(VENV)
	$(PYTHON) -m pip install --quiet --disable-pip-version-check --no-compile --constraint constraints.txt --editable ".[test]"
	@touch $(STAMP)

clean:  ## the environment, caches and compiled kernels: those that inline a changed kernel would stay old
	find src tests studies -name '*.nb[ci]' -delete
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache dist build docs/_build
