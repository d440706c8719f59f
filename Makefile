# make bench · make test: each sets up .venv by itself when it is missing.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# The other major version of OpenCV, for `make test-matrix`.
OPENCV4 := opencv-contrib-python-headless~=4.13.0
OPENCV5 := opencv-contrib-python-headless~=5.0
# The oldest that pyproject promises, for `make test-oldest`. NumPy: the oldest that has a wheel for this Python; from
# Python 3.13 on that is NumPy 2, which OpenCV 4.8 cannot work with.
OLDEST := "opencv-contrib-python-headless==4.8.*" \
	"numpy==1.24.*; python_version < '3.12'" "numpy==1.26.*; python_version >= '3.12'"
# What scores trackers of several objects. It asks for opencv-python, which would overwrite the OpenCV that is there.
TRACKEVAL := "trackeval>=1.3,<2"
# Where the extension is built, and with what: a machine without a compiler gets Clang as the wheel `ziglang` of PyPI.
# It knows nothing of OpenCV: the environment of one version builds for those of all.
BUILDER := $(VENV)
BUILD := build/$(notdir $(BUILDER))
BUILDER_BIN := $(BUILDER)/bin
COMPILER := $(shell for name in "$$CXX" c++ g++ clang++; do command -v "$$name" && break; done)
ifeq ($(COMPILER),)
ZIG := ZIG="$$($(BUILDER_BIN)/python -m pip install --quiet ziglang && $(BUILDER_BIN)/python -c \
	"import importlib.resources as r; print(r.files('ziglang') / 'zig')")"
TOOLCHAIN := -DCMAKE_TOOLCHAIN_FILE=cmake/zig.cmake
endif

.PHONY: native bench test test-opencv test-matrix test-oldest environments lint docs bench-flow clean

# The extension, built into this checkout: a moment when nothing has changed. `make native VENV=/some/.venv` builds it
# for the Python of an environment elsewhere.
native: $(BUILDER)/ready
	$(ZIG) $(BUILDER_BIN)/cmake -S . -B $(BUILD) -G Ninja -DCMAKE_MAKE_PROGRAM=$(abspath $(BUILDER_BIN))/ninja \
		-DPython_EXECUTABLE=$(abspath $(BUILDER_BIN))/python $(TOOLCHAIN)
	$(BUILDER_BIN)/cmake --build $(BUILD)
	$(BUILDER_BIN)/cmake --install $(BUILD) --prefix .

bench: native
	$(BIN)/python -m eval bench

test: native
	$(BIN)/python -m pytest -n 2 -q
	$(BIN)/python -m eval check

# The tests whose results OpenCV has a hand in: all but those marked `once`.
test-opencv: native $(VENV)/ready
	$(BIN)/python -m pytest -n 2 -q -m "not once"
	$(BIN)/python -m eval check

# All tests on OpenCV 5, and those that OpenCV has a hand in on 4.13.
test-matrix: .venv-cv4/ready .venv-cv5/ready
	$(MAKE) test VENV=.venv-cv5
	$(MAKE) test-opencv VENV=.venv-cv4 BUILDER=.venv-cv5

# The latter on the oldest OpenCV and NumPy that are promised.
test-oldest: .venv-oldest/ready
	$(MAKE) test-opencv VENV=.venv-oldest

# All environments that CI needs; with `make -j` side by side.
environments: .venv-cv4/ready .venv-cv5/ready .venv-oldest/ready

lint: $(VENV)/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/codespell
	$(BIN)/clang-format --dry-run -Werror hs_tracker_cv/_native/*.[ch]pp hs_tracker_cv/_native/*/*.[ch]pp
	$(BIN)/mypy

# The site, into build/site, with the notebooks, which are executed for it.
docs: native
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

bench-flow: native
	$(BIN)/python -m benchmarks.bench_flow

clean:
	rm -rf .venv .venv-cv4 .venv-cv5 .venv-oldest build results dist hs_tracker_cv/_native/kernels.*.so

.venv/ready: pyproject.toml
	$(call setup,.venv,)

.venv-cv4/ready: pyproject.toml
	$(call setup,.venv-cv4,"$(OPENCV4)")

.venv-cv5/ready: pyproject.toml
	$(call setup,.venv-cv5,"$(OPENCV5)")

.venv-oldest/ready: pyproject.toml
	$(call setup,.venv-oldest,$(OLDEST))

# --group needs pip 25.1.
define setup
$(PYTHON) -m venv $(1)
$(1)/bin/python -m pip install --quiet --upgrade "pip>=25.1"
$(1)/bin/python -m pip install --quiet --editable . --group dev $(2)
$(1)/bin/python -m pip install --quiet --no-deps $(TRACKEVAL)
touch $@
endef
