# Two commands: make demo (fly the synchronised approach, plots, claims) and make test. Both do all set-up themselves:
# they need Python >= 3.11, a C compiler and make.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
TOOLS  := $(VENV)/.tools
READY  := $(VENV)/.ready
# cmake and ninja come as wheels into the virtual environment
RUN    := PATH="$(CURDIR)/$(BIN):$$PATH"
SOURCES := $(shell find fmus ssp harness -name '*.py' -o -name '*.c' -o -name '*.h' -o -name '*.toml' -o -name CMakeLists.txt)

.PHONY: help build demo test test-long test-interop validation sanitize lint format bench wheel dist clean
help:
	@echo "make demo | test | test-interop | test-long | validation | bench | sanitize | lint | format | wheel | dist | clean"

$(TOOLS): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed: make PYTHON=python3.x")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check "scikit-build-core>=0.10" cmake ninja "fmpy>=0.3.22" lxml "pillow>=10.1"
	@touch $@

$(READY): $(TOOLS) CMakeLists.txt $(SOURCES)
	$(RUN) $(BIN)/pip install --quiet --disable-pip-version-check --no-build-isolation --editable '.[test]'
	@touch $@

build: $(READY)

demo: build
	$(BIN)/harness run sync_approach -o results/sync_approach.csv
	$(BIN)/harness plot results/sync_approach.csv
	$(BIN)/harness report results/sync_approach.csv

test: build
	$(BIN)/pytest

test-long: build
	$(BIN)/pytest -m long

# with tools beyond the test dependencies; writes the table docs/tools.md from the run
test-interop: build
	$(RUN) $(BIN)/pip install --quiet --disable-pip-version-check --no-build-isolation --editable '.[test,interop]'
	$(BIN)/pytest -m interop -rs --tool-table docs/tools.md

# numbers by others through the FMUs; writes the page docs/validation.md from the run
validation: build
	$(BIN)/python -m harness.validation --write docs/validation.md

# FMU tests under the address and undefined behaviour sanitizers
sanitize: build
	$(RUN) cmake --preset sanitize -DPython_EXECUTABLE=$(CURDIR)/$(BIN)/python
	$(RUN) cmake --build --preset sanitize
	SERVICING_FMUS_BUILD=build/sanitize ASAN_OPTIONS=detect_leaks=0 LD_PRELOAD="$$(cc -print-file-name=libasan.so)" \
	  $(BIN)/pytest tests/fmu tests/compliance

bench: build
	$(BIN)/harness bench sync_approach

lint: build
	$(BIN)/pip install --quiet --disable-pip-version-check "clang-format>=18" "mypy>=1.10" "ruff>=0.5"
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/clang-format --dry-run --Werror $$(git ls-files '*.c' '*.h')
	$(RUN) cmake --preset developer -DPython_EXECUTABLE=$(CURDIR)/$(BIN)/python
	$(RUN) cmake --build --preset developer

format: build
	$(BIN)/pip install --quiet --disable-pip-version-check "clang-format>=18" "ruff>=0.5"
	$(BIN)/ruff check --fix . ; $(BIN)/ruff format .
	$(BIN)/clang-format -i $$(git ls-files '*.c' '*.h')

# FMUs with binaries for linux64, win64, darwin64 and aarch64-darwin in one file
dist: build
	$(BIN)/pip install --quiet --disable-pip-version-check ziglang==0.13.0
	$(BIN)/python fmus/core/build/cross_compile.py --fmus build/fmus -o dist/fmus

wheel: build
	$(RUN) $(BIN)/pip wheel --quiet --no-build-isolation --no-deps --wheel-dir dist .

clean:
	rm -rf build dist $(VENV)
