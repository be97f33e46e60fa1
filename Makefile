# make demo runs the synchronised approach, make test runs all tests. Every target installs what it
# needs in .venv; it requires Python >= 3.11, a C compiler and make.

PYTHON ?= python3
VENV   := .venv
ifeq ($(OS),Windows_NT)
  BIN  := $(VENV)/Scripts
else
  BIN  := $(VENV)/bin
endif
TOOLS   := $(VENV)/.tools
INSTALLED := $(VENV)/.installed
READY   := $(VENV)/.ready
LINTERS := $(VENV)/.linters
PIP    := $(BIN)/pip install --quiet --disable-pip-version-check
# cmake and ninja come as wheels into the virtual environment
RUN    := PATH="$(CURDIR)/$(BIN):$$PATH"
CMAKE  := $(RUN) cmake -DPython_EXECUTABLE=$(CURDIR)/$(BIN)/python
# on all cores; a worker without tests takes over tests of another one. Bytecode is stored: otherwise
# every worker and each of the thousand processes that tests start would compile all modules again.
# OpenBLAS uses one thread per worker: further threads would spin while they wait, on processors
# that the other workers need.
PYTEST := PYTHONDONTWRITEBYTECODE= OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n auto --dist worksteal
SOURCES := $(shell find fmus ssp harness -name '*.py' -o -name '*.[ch]' -o -name '*.toml' \
                     -o -name CMakeLists.txt)
CODE    := .ci examples fmus harness tests
C_FILES := $(shell find $(CODE) -name '*.[ch]')
FLIGHT_CODE := fmus/flight fmus/core/maths fmus/core/models fmus/core/ports

.PHONY: help build demo test test-browser test-wasm test-wheel test-long test-interop pil processors \
        validation gallery sanitize lint warnings format coverage bench wheel dist clean
help:
	@echo "make demo | test | test-browser | test-wasm | test-wheel | test-interop | test-long |"
	@echo "     oms OMSIMULATOR=CHECKOUT | clients |"
	@echo "     test-processors | pil |"
	@echo "     validation | gallery | quoted-values | lint | warnings | format | coverage | sanitize |"
	@echo "     proofs | evidence | requirements | misra | faults | fuzz | tests-of FILE:LINE | tests-map | bench | site | wheel | sdist | dist | release | clean"

$(TOOLS): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and \
	  "Python 3.11 or newer is needed: make PYTHON=python3.x")'
	@echo "Setting up $(VENV), once: Python packages from PyPI (1 GB on disk), then all FMUs from C;"
	@echo "2 to 5 minutes on two cores."
	$(PYTHON) -m venv $(VENV)
	$(PIP) "scikit-build-core>=0.10" cmake ninja "fmpy>=0.3.28" lxml "msgspec>=0.22" "pillow>=10.1" \
	  "setuptools>=70.1" # of dependencies without a wheel; from Python 3.12 on venv brings none
	@touch $@

$(INSTALLED): $(TOOLS) pyproject.toml
	$(RUN) $(PIP) --no-build-isolation --editable '.[test]'
	@touch $@

# the package in .venv reads FMUs and systems from build/: an edit needs a build only, no installation
$(READY): $(INSTALLED) CMakeLists.txt $(SOURCES)
	@$(RUN) cmake --build build
	@touch $@

# the tools of the extra `dev`, in the versions that pyproject.toml pins
$(LINTERS): $(TOOLS) pyproject.toml
	$(PIP) $$($(BIN)/python -c "import tomllib; p = tomllib.load(open('pyproject.toml', 'rb')); \
	  print(*p['project']['optional-dependencies']['dev'])")
	@touch $@

build: $(READY)

# one page with replay, plots and verdicts; all requirements are met. Figures as files: make demo
# FIGURES=1
demo: build
	$(BIN)/harness run sync_approach --params clear -o results/sync_approach.nc --quiet
	$(if $(FIGURES),$(BIN)/harness plot results/sync_approach.nc)
	$(BIN)/harness report results/sync_approach.nc
	@echo "Open in a browser:"
	@$(BIN)/harness report results/sync_approach.nc -o results/sync_approach.html

test: build
	$(PYTEST)

# opens pages and the documentation site in a headless Chromium, which must be installed (Debian:
# apt-get install chromium)
test-browser: build site
	$(RUN) $(PIP) --no-build-isolation --editable '.[test,browser,live]'
	$(BIN)/pytest -m browser -rs

# compares every system as a WebAssembly module in node, which must be installed, with a run here
test-wasm: build
	$(RUN) $(PIP) --no-build-isolation --editable '.[test,live]'
	$(BIN)/pytest -m wasm -rs

# installs the wheel in dist/ by pip into fresh environments without a compiler
test-wheel: build
	$(BIN)/pytest -m wheel -rs tests/site tests/journeys

# long studies, and the property tests with many random examples; SEED=... repeats the examples
test-long: build
	$(PYTEST) -m "long or hypothesis" --hypothesis-profile=random \
	  --hypothesis-seed=$${SEED:-$$(date +%s)}

# tests with third-party tools; writes the table docs/tools.md from the run
test-interop: build
	$(RUN) $(PIP) --no-build-isolation --editable '.[test,interop]'
	$(BIN)/pytest -m interop -rs --tool-table=docs/tools.md

# every .ssp in OMSimulator, built in a checkout of its sources: make oms OMSIMULATOR=CHECKOUT
.PHONY: oms
oms: build
	$(RUN) cmake -S $(OMSIMULATOR) -B $(OMSIMULATOR)/build -G Ninja -DCMAKE_BUILD_TYPE=Debug \
	  -DCMAKE_POLICY_VERSION_MINIMUM=3.5
	$(RUN) cmake --build $(OMSIMULATOR)/build --target OMSimulator
	OMSIMULATOR=$(OMSIMULATOR)/build/src/OMSimulator/OMSimulator \
	  $(BIN)/pytest -m interop -rs --tool-table=docs/tools.md tests/interop/test_omsimulator.py

# Python clients of FMUs, each in a virtual environment in the folder CLIENTS, whose packages
# exclude each other
.PHONY: clients
CLIENTS ?= build/clients
clients: build
	@for client in fmuloader cofmupy fmugym pathsim-fmi "sofirpy setuptools<81"; do \
	  folder=$(CLIENTS)/$${client%% *}; test -f $$folder/.ready || \
	  { $(PYTHON) -m venv $$folder && touch $$folder/.ready.new && \
	    $$folder/bin/pip install --quiet --disable-pip-version-check $$client && \
	    mv $$folder/.ready.new $$folder/.ready; } || exit 1; done
	CLIENTS=$(abspath $(CLIENTS)) $(BIN)/pytest -m interop -rs --tool-table=docs/tools.md \
	  tests/interop/test_clients.py

# flight software on emulated processors; on Debian (and Ubuntu) the packages are installed
PIL_PACKAGES := gcc-arm-none-eabi picolibc-arm-none-eabi qemu-system-arm \
                gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf qemu-system-misc
PIL_TOOLS    := arm-none-eabi-gcc qemu-system-arm riscv64-unknown-elf-gcc \
                qemu-system-riscv32 qemu-system-riscv64
pil: build
	@for tool in $(PIL_TOOLS); do command -v $$tool > /dev/null || missing="$$missing $$tool"; done; \
	 test -z "$$missing" || { echo "missing:$$missing; packages of Debian: $(PIL_PACKAGES)"; \
	   command -v apt-get > /dev/null && $$(test "$$(id -u)" = 0 || echo sudo) \
	     apt-get install -y --no-install-recommends $(PIL_PACKAGES); }
	$(BIN)/pytest -rs -m "pil or not pil" tests/link

# numerical tests with other kernels of OpenBLAS, without vectors of numpy, with FMUs for other
# instruction sets and on an emulated processor (Linux on x86-64); on Debian (and Ubuntu) the package
# of the emulator is installed. Writes the page lab/processors.md from the runs
.PHONY: test-processors
test-processors: build
	@command -v qemu-x86_64 > /dev/null || { echo "missing: qemu-x86_64; package of Debian: qemu-user"; \
	   command -v apt-get > /dev/null && $$(test "$$(id -u)" = 0 || echo sudo) \
	     apt-get install -y --no-install-recommends qemu-user; }
	$(RUN) $(BIN)/python .ci/processors.py lab/processors.md

# instructions and memory of every flight FMU on every processor; writes docs/processor_figures.md
# from the runs. A run with the same files is not repeated, so the target may be interrupted.
FLIGHT_FMUS := $(sort $(basename $(notdir $(wildcard fmus/flight/*.c))))
processors: build
	$(BIN)/python .ci/processor_figures.py docs/processor_figures.md $(FLIGHT_FMUS)

# FMUs against published reference values; writes the page docs/validation.md from the run
validation: build
	$(BIN)/python .ci/validation.py docs/validation.md

# runs the systems; writes docs/gallery.md and its pictures from the runs
gallery: build
	$(BIN)/python .ci/gallery.py docs

# FMUs and both ends of the link, with its damaged and random frames, under the address and undefined
# behaviour sanitizers
sanitize: build
	$(CMAKE) --preset sanitize
	$(RUN) cmake --build --preset sanitize
	SERVICING_FMUS_BUILD=$(CURDIR)/build/sanitize ASAN_OPTIONS=detect_leaks=0 \
	  LD_PRELOAD="$$(cc -print-file-name=libasan.so)" $(BIN)/pytest tests/fmu tests/compliance tests/link

# checks spelling, style and types in seconds, with the same result on every machine
lint: build $(LINTERS)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run --Werror $(C_FILES)
	$(BIN)/codespell
	$(BIN)/python .ci/words.py
	$(BIN)/python .ci/subjects.py
	$(BIN)/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/python .ci/licence_lines.py --check $(CODE)
	$(BIN)/python .ci/size.py
	$(BIN)/lizard --CCN 15 --length 1000 --arguments 100 --warnings_only $(FLIGHT_CODE)
	$(BIN)/mypy

# every C file with all warnings as errors; which warnings there are depends on the compiler
warnings: build
	$(CMAKE) --preset developer
	$(RUN) cmake --build --preset developer

format: build $(LINTERS)
	$(BIN)/python .ci/licence_lines.py $(CODE)
	$(BIN)/ruff check --fix . ; $(BIN)/ruff format .
	$(BIN)/clang-format -i $(C_FILES)

# lines of Python and of C (build/coverage: FMUs and executor with counters) that the tests reach;
# a test that fails because the counters slow it down does not prevent the report
COVERING ?= tests/fmu tests/compliance tests/harness tests/systems
coverage: build $(LINTERS)
	$(CMAKE) --preset coverage
	$(RUN) cmake --build --preset coverage
	find build/coverage -name '*.gcda' -delete
	-SERVICING_FMUS_BUILD=$(CURDIR)/build/coverage $(PYTEST) --cov --cov-report=term \
	  --cov-report=html:build/coverage/python $(COVERING) \
	  --ignore-glob='*/test_static.py' --ignore-glob='*/test_rebuild.py'
	mkdir -p build/coverage/c
	$(BIN)/gcovr build/coverage --exclude fmus/core/build --txt \
	  --html-details build/coverage/c/index.html

# the documentation pages in build/site: first runs what they quote, then writes the Markdown, then
# HTML, strictly; readers need no network. The first package of the extra `live` compiles live pages
SITE_TOOLS := $(VENV)/.site
PAGES := $(shell find .ci/pages docs examples -type f) $(wildcard ssp/*/*.md) mkdocs.yml \
  CONTRIBUTING.md CHANGELOG.md
$(SITE_TOOLS): $(TOOLS) pyproject.toml
	$(PIP) $$($(BIN)/python -c "import tomllib; p = tomllib.load(open('pyproject.toml', 'rb')); \
	  e = p['project']['optional-dependencies']; print(*e['site'], e['live'][0])")
	@touch $@

build/site-facts/facts.json: $(READY) $(SITE_TOOLS)
	$(BIN)/python .ci/pages build/site-facts --facts

# values in pages, from the runs that .ci/pages/quoted.py names, and claims as on the site;
# make quoted-values writes them
build/site-facts/quoted.json: $(READY) .ci/pages/quoted.py $(wildcard .ci/pages/results/*.py) \
  docs/processor_figures.md
	$(BIN)/python .ci/pages build/site-facts --quoted

.PHONY: quoted-values
quoted-values: build/site-facts/facts.json build/site-facts/quoted.json
	$(BIN)/python .ci/pages build/site-facts --fill

build/site/index.html: build/site-facts/facts.json build/site-facts/quoted.json $(PAGES) $(SITE_TOOLS)
	$(BIN)/python .ci/pages build/site-facts build/site-pages
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet

.PHONY: site
site: build/site/index.html

bench: build
	$(BIN)/python -m tests.bench sync_approach

# tests COUNT random deliberate faults in harness/, drawn with SEED; continues after an interruption
.PHONY: faults-python
faults-python: build $(LINTERS)
	test -f build/faults/costs.json || \
	  $(BIN)/python -m tests.mutation.reached -n auto tests/harness
	$(BIN)/python -m tests.mutation --python --seed $${SEED:-1} --count $${COUNT:-300} --jobs 2 \
	  -o build/faults/python-$${SEED:-1}.jsonl

# lists the tests that reach a line: make tests-of harness/files/archive.py:70. make tests-map
# records this by running all tests once, later only the tests that an edit affects
.PHONY: tests-of tests-map
ifeq ($(firstword $(MAKECMDGOALS)),tests-of)
AT := $(wordlist 2,$(words $(MAKECMDGOALS)),$(MAKECMDGOALS))
$(eval $(subst :,\:,$(AT)):;@:)
endif
tests-of:
	@$(BIN)/python -m tests.mutation.tests_of $(AT)

tests-map: build $(LINTERS)
	$(CMAKE) --preset coverage
	$(RUN) cmake --build --preset coverage
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.mutation.tests_of --record $(FILES)

# compares sin, cos, atan2, exp, log of the models with the C library
.PHONY: bench-maths
bench-maths: build
	$(BIN)/python -m tests.bench.maths

# the rules of flight code: writes the page docs/flight_code.md, then checks them
.PHONY: flight-rules
flight-rules: build
	$(BIN)/python fmus/core/build/flight_rules.py > build/flight_code.md
	mv build/flight_code.md docs/flight_code.md
	$(BIN)/pytest -q -rs -n 0 -m "" tests/compliance/test_flight_code.py

# FMUs of FMI 2.0 and FMI 3.0 with binaries for linux64, win64, darwin64 and aarch64-darwin in one file
dist: build
	$(PIP) ziglang==0.13.0
	$(BIN)/python fmus/core/build/cross_compile.py --fmus build/fmus build/fmus3 -o dist

# one wheel in dist/, in a minute; make wheel SITE=1 builds the documentation first, an hour of runs
wheel: build $(if $(SITE),site)
	$(RUN) $(BIN)/pip wheel --quiet --no-build-isolation --no-deps --wheel-dir dist .

# verdicts of the tests for every FMU and parameter set, as resource meta data (.srmd), in one archive
.PHONY: traceability
traceability: build
	$(BIN)/python .ci/traceability.py build -o build/traceability.zip

sdist: $(TOOLS)
	cd "$(CURDIR)" && $(BIN)/python -c 'import scikit_build_core.build as b; b.build_sdist("dist")'

# absence of run-time errors in flight software by Frama-C Eva; on Debian (and Ubuntu) the package is
# installed. An analysis ends after 600 s at most; the logs are in build/proofs
.PHONY: proofs
proofs: build
	@command -v frama-c > /dev/null || { echo "missing: frama-c; package of Debian: frama-c-base"; \
	   command -v apt-get > /dev/null && $$(test "$$(id -u)" = 0 || echo sudo) \
	     apt-get install -y --no-install-recommends frama-c-base; }
	$(BIN)/python .ci/proofs.py build/proofs $(COMPONENTS)

# evidence per component of flight software: statements, branches and conditions that the tests reach
# (clang with counters), and absence of run-time errors (Frama-C Eva); on Debian (and Ubuntu) the
# packages are installed. Writes docs/evidence_figures.md and build/evidence from the runs. An analysis
# of the same files is not repeated, so the target may be interrupted.
.PHONY: evidence
EVIDENCE_PACKAGES := clang-19 llvm-19 libclang-rt-19-dev frama-c-base cppcheck
COUNTERS := -fprofile-instr-generate -fcoverage-mapping -fcoverage-mcdc
evidence: build $(LINTERS)
	@for tool in clang-19 llvm-cov-19 frama-c cppcheck; do command -v $$tool > /dev/null || missing="$$missing $$tool"; done; \
	 test -z "$$missing" || { echo "missing:$$missing; packages of Debian: $(EVIDENCE_PACKAGES)"; \
	   command -v apt-get > /dev/null && $$(test "$$(id -u)" = 0 || echo sudo) \
	     apt-get install -y --no-install-recommends $(EVIDENCE_PACKAGES); }
	$(CMAKE) --preset mcdc
	LLVM_PROFILE_FILE=/dev/null $(RUN) cmake --build --preset mcdc
	rm -rf build/mcdc/profiles build/mcdc/tmp
	SERVICING_FMUS_BUILD=$(CURDIR)/build/mcdc CC="clang-19 -w $(COUNTERS)" \
	  LLVM_PROFILE_FILE=$(CURDIR)/build/mcdc/profiles/%m-%p.profraw \
	  $(PYTEST) --basetemp=build/mcdc/tmp tests/fmu tests/unit
	$(BIN)/python .ci/evidence.py build/mcdc build/evidence docs/evidence_figures.md

# deliberate faults in every component of flight software: COUNT per component, drawn with SEED, whose
# outcomes go into lab/component_faults.jsonl; only of components whose code has changed (half an hour)
.PHONY: faults
faults: build
	$(BIN)/python .ci/component_faults.py --seed $(or $(SEED),43) --count $(or $(COUNT),4) --jobs 2 \
	  lab/component_faults.jsonl

# random inputs for every component of flight software by libFuzzer with sanitizers (clang-19), SECONDS
# per component; the corpus in build/fuzz grows, outcomes go into lab/component_fuzz.jsonl. At night: make
# fuzz SECONDS=60
.PHONY: fuzz
fuzz: build
	$(BIN)/python .ci/fuzz.py --seconds $(or $(SECONDS),10) build/fuzz lab/component_fuzz.jsonl

# flight software against MISRA C:2012: places per rule, and the deviations of .ci/misra.toml both ways;
# on Debian (and Ubuntu) the package is installed
.PHONY: misra
misra: build
	@command -v cppcheck > /dev/null || { echo "missing: cppcheck; package of Debian: cppcheck"; \
	   command -v apt-get > /dev/null && $$(test "$$(id -u)" = 0 || echo sudo) \
	     apt-get install -y --no-install-recommends cppcheck; }
	$(BIN)/python .ci/misra.py

# requirements of flight software: runs their tests with functions that record their calls and writes
# docs/evidence_requirements.md; a requirement without code, or whose test does not enter it, fails
.PHONY: requirements
requirements: build
	$(BIN)/python .ci/requirements.py build/requirements docs/evidence_requirements.md

# compiles examples/cfs and examples/fprime with checkouts of the frameworks; F Prime needs its
# requirements.txt in the environment: make flight-examples CFE=... OSAL=... PSP=... ELF2CFETBL=...,
# make flight-examples FPRIME=...
.PHONY: flight-examples
flight-examples: build
	$(RUN) $(BIN)/python .ci/flight_examples.py build/flight-examples \
	  $(if $(CFE),--cfs $(CFE) $(OSAL) $(PSP) $(ELF2CFETBL)) $(if $(FPRIME),--fprime $(FPRIME))

# all files of a release that this machine can build (docs/release.md); the wheel contains the FMUs of
# all platforms and is built in a folder of its own. Ends with a check and the commands that publish.
.PHONY: sdist release
release: build site dist sdist
	$(RUN) SERVICING_FMUS_PACKED=$(CURDIR)/dist $(BIN)/pip wheel --quiet --no-build-isolation \
	  --no-deps --wheel-dir dist -C build-dir=build/release .
	mkdir -p dist/ssp && cp build/release/ssp/*.ssp dist/ssp
	$(BIN)/python .ci/reference_systems.py dist
	$(BIN)/python .ci/reference_set.py dist
	$(BIN)/python .ci/traceability.py dist -o dist/traceability.zip
	$(BIN)/python .ci/release.py dist
	$(BIN)/python .ci/release.py dist --check

clean:
	rm -rf build dist $(VENV)
