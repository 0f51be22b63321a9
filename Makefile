# What CI runs is what a person runs. Every target sets up what it needs.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
export CARGO_TERM_COLOR ?= auto
# As maturin sets it: else pyo3 is compiled anew whenever cargo and maturin take turns.
export PYO3_PYTHON ?= $(abspath $(BIN)/python)

.PHONY: demo test lint format rust-test python-test no-std-check fuzz attack soak kills sanitize bench bench-quick bench-check bench-record embedded-size package wheel docs site explorer clean

# What the demo needs and no more, unless everything is there already.
demo: $(if $(wildcard $(VENV)/.installed),$(VENV)/.installed,$(VENV)/.demo)
	$(BIN)/gramian demo --out out/demo

test: lint rust-test no-std-check python-test
	@echo "all tests passed"

lint: $(VENV)/.installed
	cargo fmt --all -- --check
	cargo clippy --workspace --all-targets --all-features --quiet -- -D warnings
	cargo clippy -p gramian-python --no-default-features --quiet -- -D warnings  # as the demo has it
	$(MAKE) --no-print-directory docs
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-cache
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest gramian._core --allowlist tests/stubtest-allowlist.txt

format: $(VENV)/.installed
	cargo fmt --all
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

rust-test:
	cargo test -p gramian -p gramian-capi -p gramian-explorer -p embedded-examples --features gramian/parallel,gramian/large
	cargo test -p gramian --no-default-features --features libm --lib --tests

no-std-check:
	cargo build --manifest-path rust/no-std-check/Cargo.toml --target-dir target/no-std-check

# A million random bit patterns for each function that works without std, and for
# the C interface; `make test` takes a few thousand.
fuzz: export GRAMIAN_FUZZ ?= 1000000
fuzz:
	cargo test --release -p gramian --no-default-features --features libm,alloc --test fuzz
	cargo test --release -p gramian-capi --test fuzz

# 10^5 calls of every public function with arguments gone wrong; `make test` makes 3000.
attack: $(VENV)/.installed
	$(BIN)/python tests/attack/attack.py --calls $(or $(CALLS),100000)

# Calls for ten minutes, and how the memory grows: `make soak MINUTES=3` for less.
soak: $(VENV)/.installed
	$(BIN)/python tests/attack/soak.py --minutes $(or $(MINUTES),10)

# 50 kills at random moments and 200 corruptions of a run that is resumed: the same bits.
kills: $(VENV)/.installed
	$(BIN)/python tests/attack/kills.py

# The fuzz of the C interface under AddressSanitizer, which takes a nightly toolchain.
sanitize:
	RUSTFLAGS=-Zsanitizer=address CARGO_TARGET_DIR=target/sanitize cargo +nightly test --quiet \
	  -p gramian-capi --test fuzz --target $$(rustc -vV | sed -n 's/^host: //p')

python-test: $(VENV)/.installed
	$(BIN)/python -m pytest -n auto --dist worksteal

# The peers: told by name, so that the extension is not built a second time. Where one
# cannot be installed the others are, and the run says which is missing.
PEERS = import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["bench"])
$(VENV)/.peers: $(VENV)/.installed
	peers=$$($(BIN)/python -c '$(PEERS)'); $(BIN)/python -m pip install --quiet $$peers || \
	  for peer in $$peers; do $(BIN)/python -m pip install --quiet $$peer || echo "without $$peer"; done
	touch $@

# Writes benches/results; Ctrl-C keeps what is done.
bench bench-quick: $(VENV)/.peers
	cargo bench --quiet -p gramian --bench kernels --no-run
	$(BIN)/python benches/run.py $(if $(filter bench-quick,$@),--quick)

# What moved since the counts were recorded; `make bench-record` records anew.
bench-check bench-record: $(VENV)/.installed
	$(BIN)/python benches/check.py $(if $(filter bench-record,$@),--record)

# Flash, stack and instructions of the C interface on a Cortex-M4F.
embedded-size: $(VENV)/.installed
	rustup target add thumbv7em-none-eabihf
	$(BIN)/python benches/embedded.py

# What `cargo publish` would send, built from the packages alone.
package:
	cargo package -p gramian -p gramian-capi --allow-dirty

# The wheel and the sdist, in target/wheels, each tried: the wheel in an empty environment, where
# the README's example and the demo run; the sdist by building from it what the demo needs.
wheel: $(VENV)/.dependencies
	rm -rf target/wheels && mkdir -p target/wheels
	$(PYTHON) explorer/build.py python/gramian/explorer/page.html || echo "this wheel is without the explorer's page"
	$(BIN)/maturin build --release --strip --out target/wheels
	$(BIN)/maturin sdist --out target/wheels
	$(PYTHON) tests/wheel/try_wheel.py target/wheels
	$(PYTHON) tests/wheel/try_sdist.py target/wheels $(BIN)/maturin

docs:
	RUSTDOCFLAGS='-D warnings' cargo doc --quiet -p gramian -p gramian-capi --no-deps --features gramian/parallel,gramian/large

# The site, in site/: opens from the folder, without a server or a network. A warning, a
# failing cell or example, a dead link or a public name without a page ends the build.
site: $(VENV)/.site docs
	rm -rf docs/gallery  # whose cache would not see that the package changed
	$(BIN)/python -m sphinx --builder html --fresh-env --jobs auto --fail-on-warning --keep-going --quiet --doctree-dir target/site/doctrees docs target/site/html
	rm -rf site && cp -r target/site/html site && cp -r target/doc site/rust
	$(PYTHON) explorer/build.py --or-say-why
	$(BIN)/python docs/_site/check.py site

# One page, site/explorer.html, that opens from the folder: the crate as WebAssembly; and the
# package's copy of it, for `gramian explore` and wheels. Needs the target wasm32-unknown-unknown, and says how to get it where it is missing.
explorer:
	$(PYTHON) explorer/build.py

# By name, so that the extension is not built a second time.
SITE = import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["site"])
$(VENV)/.site: $(VENV)/.installed
	$(BIN)/python -c 'import sphinx, furo, myst_nb, sphinx_gallery, sphinx_design, sphinx_copybutton, jupytext, nbclient, latex2mathml' 2>/dev/null || \
	  $(BIN)/python -m pip install --quiet $$($(BIN)/python -c '$(SITE)')
	touch $@

clean:
	rm -rf target $(VENV) out site docs/gallery docs/reference/generated docs/tutorials/notebooks

# The extension is built anew when a Rust source changed, the rest when pyproject.toml
# did.
RUST := $(shell find rust -name target -prune -o -name '*.rs' -print -o -name Cargo.toml -print) Cargo.toml Cargo.lock
EXTRAS := dev,report,files,interop,distributed
$(VENV)/.dependencies: pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit("gramian needs Python >= 3.11") if sys.version_info < (3, 11) else None'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet 'maturin>=1.9,<2'
	touch $@
$(VENV)/.demo: $(VENV)/.dependencies $(RUST)
	$(BIN)/maturin develop --profile demo --no-default-features --extras report
	touch $@
$(VENV)/.installed: $(VENV)/.dependencies $(RUST)
	$(BIN)/maturin develop --release --extras $(EXTRAS)
	touch $@
