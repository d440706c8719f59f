# make bench · make test: each sets up .venv by itself when it is missing.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# The other major version of OpenCV, for `make test-matrix`.
OPENCV4 := opencv-contrib-python-headless~=4.13.0
OPENCV5 := opencv-contrib-python-headless~=5.0

.PHONY: bench test test-matrix lint bench-flow clean

bench: $(VENV)/ready
	$(BIN)/python -m eval bench

test: $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -q
	$(BIN)/python -m eval check

# The same tests on both major versions of OpenCV.
test-matrix: .venv-cv4/ready .venv-cv5/ready
	$(MAKE) test VENV=.venv-cv4
	$(MAKE) test VENV=.venv-cv5

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/mypy

bench-flow: $(VENV)/ready
	$(BIN)/python -m benchmarks.bench_flow

clean:
	rm -rf .venv .venv-cv4 .venv-cv5 results dist

.venv/ready: pyproject.toml
	$(call setup,.venv,)

.venv-cv4/ready: pyproject.toml
	$(call setup,.venv-cv4,"$(OPENCV4)")

.venv-cv5/ready: pyproject.toml
	$(call setup,.venv-cv5,"$(OPENCV5)")

# --group needs pip 25.1.
define setup
$(PYTHON) -m venv $(1)
$(1)/bin/python -m pip install --quiet --upgrade "pip>=25.1"
$(1)/bin/python -m pip install --quiet --editable . --group dev $(2)
touch $@
endef
