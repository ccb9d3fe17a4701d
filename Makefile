# Two doors: `make demo` and `make test`. Both set up .venv by themselves.
# On a fresh machine: git, make and Python 3.11 or 3.12, nothing else.

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
PYTHON ?= $(shell for p in python3.12 python3.11 python3; do \
	$$p -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' 2>/dev/null \
	&& echo $$p && break; done)

.PHONY: install chromium demo test lint types floors unit bench readme clean

install: $(STAMP)

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo "dynid needs Python 3.11 or 3.12; name one: make PYTHON=/path/to/python" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(STAMP): pyproject.toml urtwin/pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[all,dev]' -e ./urtwin
	@# Numba compiles once a machine: better now than in somebody's first design.
	-@$(BIN)/dynid design ur5 -o $(VENV)/first.json --starts 1 --jobs 1 >/dev/null 2>&1
	@touch $@

demo: install
	$(BIN)/dynid demo -o runs/demo

test: lint types floors unit

# Reports and the studio are tested in a real browser. Without it, and without the right to install
# it, those tests are skipped and say so.
chromium:
	@command -v chromium >/dev/null || command -v google-chrome >/dev/null || \
	{ apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq chromium >/dev/null; } || \
	echo "no Chromium: the tests in a browser are skipped" >&2

lint: install
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/codespell src tests urtwin docs benchmarks examples README.md CHANGELOG.md CONTRIBUTING.md

types: install
	$(BIN)/pyright --warnings

floors: install
	$(BIN)/lint-imports

unit: install chromium
	$(BIN)/python -m pytest -n 2 -m "not realtime"
	$(BIN)/python -m pytest -m realtime

bench: install
	$(BIN)/python benchmarks/startup.py
	@for script in $(filter-out benchmarks/startup.py,$(wildcard benchmarks/*.py)); do \
		echo "== $$script"; $(BIN)/python $$script || exit 1; done

readme: install
	$(BIN)/python benchmarks/readme/fill_tables.py

clean:
	rm -rf $(VENV) runs dist build
