# Two doors: `make demo` and `make test`. Both set up .venv by themselves.
# On a fresh machine: git, make and Python 3.11 to 3.13, nothing else.

VENV := .venv
BIN := $(VENV)/bin
# What users need, and the tools of developers on top of it.
LIBRARY := $(VENV)/.library-installed
COMPILED := $(VENV)/.compiled
USER := $(VENV)/.user-installed
DEV := $(VENV)/.dev-installed
PYTHON ?= $(shell for p in python3.12 python3.11 python3.13 python3; do \
	$$p -c 'import ensurepip, sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null \
	&& echo $$p && break; done)
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
# Where the environment says no, every worker, command and controller of the tests would compile all
# sources again.
export PYTHONDONTWRITEBYTECODE :=
PATHS := src tests urtwin docs benchmarks examples README.md CHANGELOG.md CONTRIBUTING.md

# What failed halfway is made again, as an environment without pip.
.DELETE_ON_ERROR:
.PHONY: install develop prepared chromium demo test lint types floors share-1 share-2 share-3 realtime bench proof rivals site readme clean

install:
	@$(MAKE) --no-print-directory --output-sync -j 2 $(USER) $(COMPILED)

develop: $(DEV) $(COMPILED)

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "dynid needs Python 3.11 to 3.13 with venv (Debian: python3-venv); name one: make PYTHON=/path/to/python" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

# Python compiles only what is imported, when it is: 15 s of CPU less for users and developers each.
$(LIBRARY): pyproject.toml urtwin/pyproject.toml | $(BIN)/python
	$(PIP) --no-compile -e .
	@touch $@

$(USER): $(LIBRARY)
	$(PIP) --no-compile 'dynid[sim,sdp]' -e ./urtwin
	@touch $@

# Numba compiles once a machine: beside the downloads, not in the middle of a demo or a test.
$(COMPILED): $(LIBRARY)
	-@$(BIN)/dynid design ur5 -o $(VENV)/first.json --starts 1 --jobs 1 --force >/dev/null 2>&1
	@touch $@

# By its name: dynid is there already, and to build it again takes 6 s.
$(DEV): $(USER)
	$(PIP) --no-compile 'dynid[all,dev]'
	@touch $@

demo: install
	$(BIN)/dynid demo -o runs/demo --force

# Tests that watch a clock mostly wait: the types and all other tests run beside them, and give way.
test: prepared lint floors
	$(MAKE) --no-print-directory --output-sync -j 5 realtime $(SHARES) types

# The packages of Python and of Debian beside each other.
prepared:
	$(MAKE) --no-print-directory --output-sync -j 3 develop chromium

# Reports and the studio are tested in a real browser. Without it, and without the right to install
# it, those tests are skipped and say so. What it recommends are 90 packages: printing, Samba, Perl.
chromium:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || \
	{ apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq \
	--no-install-recommends chromium fonts-liberation >/dev/null; } || \
	echo "no Chromium: the tests in a browser are skipped" >&2

lint: develop
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/codespell $(PATHS)

types: develop
	$(ASIDE) $(BIN)/pyright --warnings --pythonpath $(BIN)/python

floors: develop
	$(BIN)/lint-imports

# Gives way to what keeps time. On a machine that computes for others too: make test ASIDE=
ASIDE ?= nice -n 19

# Three processes, each of which collects its own folders alone, for two processors: the second
# waits for servers and browsers. Workers of pytest-xdist would collect all folders each. Each share
# takes a third of the CPU time.
share-1 := $(addprefix tests/,identification robot workflow)
share-2 := $(addprefix tests/,cli drivers studio recording) urtwin/tests
SHARES := share-1 share-2 share-3

share-1 share-2: develop chromium
	$(ASIDE) $(BIN)/python -m pytest -m "not realtime and not long" $($@)

share-3: develop chromium
	$(ASIDE) $(BIN)/python -m pytest -m "not realtime and not long" tests \
	$(addprefix --ignore=,$(share-1) $(share-2))

# Only the files that have such tests are collected.
realtime: develop chromium
	$(BIN)/python -m pytest -m "realtime and not long" \
	$$(grep -rl --include='test_*.py' mark.realtime tests urtwin/tests)

bench: develop
	@for script in $(wildcard benchmarks/*.py); do \
		echo "== $$script"; $(BIN)/python $$script || missed="$$missed $$script"; done; \
	test -z "$$missed" || { echo "missed or failed:$$missed" >&2; exit 1; }

# What is too long for every commit; writes docs/proof.md. ONLY="answers benchmarks" takes some.
proof: develop
	$(BIN)/python benchmarks/proof/proof.py $(ONLY)

# dynid beside other tools, in an environment of their own; writes docs/benchmarks.md and its figure.
# ONLY="UR10 Panda" measures the recordings whose names begin so, and writes nothing.
RIVALS := .venv-rivals
rivals: $(RIVALS)/.installed
	$(BIN)/python benchmarks/rivals/rivals.py $(ONLY)

$(RIVALS)/.installed: benchmarks/rivals/requirements.txt $(USER)
	@# The recordings include a bag.
	$(PIP) -e '.[ros]'
	$(BIN)/python -m venv $(RIVALS)
	$(RIVALS)/bin/python -m pip install --quiet --disable-pip-version-check -r $<
	@touch $@

# The documents as pages, with a reference and executed notebooks: build/site/index.html.
site: develop
	$(BIN)/python benchmarks/proof/build_site.py

readme: develop
	$(BIN)/python benchmarks/readme/fill_tables.py

clean:
	rm -rf $(VENV) .venv-rivals runs dist build
